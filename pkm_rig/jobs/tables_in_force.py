"""Whether the drives use the tables of the calibration in force, or the host its correction, and no others."""

from __future__ import annotations

from calibration.compensation.host import HostCorrection
from drivers.drives.table_bank import CompensationMode
from drivers.drives.table_image import decode_table
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.former_correction import verified_correction
from pkm_rig.results.callbacks import Notify
from pkm_rig.rig.drive_tables import Table, as_image, read_states, serial_of, table_of, whole_tables
from pkm_rig.rig.host_state import host_in_use
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.table_change import changes_of
from pkm_rig.store.store import Store


def parse_tables(tables: str) -> dict[str, Table]:
    """Drive to generation and CRC, of a stored calibration ("left:3:7/right:3:9")."""
    parts = [part.rsplit(":", 2) for part in tables.split("/") if part]
    return {drive: (int(generation), int(crc)) for drive, generation, crc in parts}


def wrong_tables(rig: Rig, tables: str) -> str | None:
    """Why the drives do not use these tables for good; None if they do."""
    wanted = parse_tables(tables)
    for bank, state in zip(rig.banks, read_states(rig), strict=True):
        name = bank.drive.name
        used = (state.generation, state.crc) if state.mode is CompensationMode.KEPT else None
        if used != wanted.get(name):
            return f"drive {name} uses {'no table' if used is None else f'generation {used[0]}'}"
    return None


def require_tables(rig: Rig, store: Store, campaign: str, tables: str, notify: Notify) -> None:
    """Refuse drives that do not use a calibration's tables, or a payload that these are not for.

    Drives that hold them but came back without power are told to use them again, where nobody has switched them off
    since. The drives of the embedded mock rig, which forget everything between commands, are given them.
    """
    why = wrong_tables(rig, tables)
    if why is not None and _only_restarted(rig, store, tables):
        images = stored_images(rig, store, tables)
        rig.bring_tables_to([images[bank.drive.name] for bank in rig.banks], on=True)
        notify(f"the drives were without power and used no table: those of calibration {campaign} are in use again")
        why = wrong_tables(rig, tables)
    if why is not None and rig.file.can.interface == "embedded":
        _give(rig, store, campaign, tables, notify)
        why = wrong_tables(rig, tables)
    if why is not None:
        raise CampaignRefused(
            f"the drives do not use the tables of calibration {campaign}: {why}; see `pkm-rig tables`, then "
            "`pkm-rig verify` or calibrate anew"
        )
    states = read_states(rig)
    if not all(state.valid for state in states):
        mass_kg = states[0].payload_kg
        raise CampaignRefused(
            f"the tables of calibration {campaign} are not for the payload that is on ({mass_kg:g} kg); put on theirs"
        )
    rig.compensation = states[0].generation


def _only_restarted(rig: Rig, store: Store, tables: str) -> bool:
    """Whether the same drives hold these tables, active but not used, and the last change left them in use."""
    wanted, changes = parse_tables(tables), changes_of(rig, store)
    if not changes or set(wanted) != {bank.drive.name for bank in rig.banks}:
        return False
    serials = {record["drive"]: record["serial"] for record in changes[-1].former}
    return changes[-1].left_in_use() == wanted and all(
        state.mode is CompensationMode.OFF
        and (state.generation, state.crc) == wanted[bank.drive.name]
        and wanted[bank.drive.name] in whole_tables(state)
        and serials.get(bank.drive.name) == serial_of(bank)
        for bank, state in zip(rig.banks, read_states(rig), strict=True)
    )


def require_host(rig: Rig, store: Store, campaign: str) -> HostCorrection:
    """The host's correction of a calibration for the payload that is on; refused where another one is in force.

    Raises CampaignRefused and InputError.
    """
    state = host_in_use(store, rig.file.rig, rig.machine.name)
    if state is None or not state.on or state.campaign != campaign:
        why = "the host has none in use" if state is None else state.in_words()
        raise CampaignRefused(
            f"the correction of calibration {campaign} is not in use: {why}; see `pkm-rig tables`, or calibrate anew"
        )
    payload = rig.supervisor.state().payload
    if payload is None:
        raise CampaignRefused("the payload is being changed; check the machine when it is on")
    return verified_correction(store, campaign, payload)


def stored_images(rig: Rig, store: Store, tables: str) -> dict[str, bytes]:
    """The images of a calibration's tables by drive, as far as this store has them."""
    wanted = parse_tables(tables)
    found: dict[str, bytes] = {}
    for change in changes_of(rig, store):
        for trial in change.trials:
            for drive, text in trial["images"].items():
                image = as_image(text)
                if image is not None and wanted.get(drive) == table_of(image):
                    found[drive] = image
    return found


def _give(rig: Rig, store: Store, campaign: str, tables: str, notify: Notify) -> None:
    found = stored_images(rig, store, tables)
    if set(found) != set(parse_tables(tables)):
        return
    notify(f"the embedded drives begin without tables: those of calibration {campaign} are written to them")
    mass_kg = decode_table(next(iter(found.values()))).payload_kg
    payload = next(number for number, entry in enumerate(rig.file.payloads) if entry.mass_kg == mass_kg)
    rig.change_payload(payload)
    rig.bring_tables_to([found[bank.drive.name] for bank in rig.banks], on=True)
