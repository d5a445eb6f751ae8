"""Proposals that wait for approval, and tables that are taken back: what somebody decides by name."""

from __future__ import annotations

from collections.abc import Callable

from calibration.base.errors import InputError
from drivers.drives.table_image import decode_table, machine_id_of
from pkm_rig.jobs.former_correction import activated_events, verified_correction
from pkm_rig.jobs.life_record import DRIVE_REPLACED, utc_text
from pkm_rig.jobs.tables import last_change, require_standstill, roll_back
from pkm_rig.jobs.tables_in_force import parse_tables
from pkm_rig.recalibration.situation import APPROVED
from pkm_rig.rig.drive_tables import WantedTables, as_image, serial_of, table_of, telling_tables
from pkm_rig.rig.host_state import HOST, state_of
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.table_change import TableChange, begin, changes_of
from pkm_rig.store.life import ACCEPTED, LifeRow, add_life_row, life_rows
from pkm_rig.store.life_facts import ROLLED_BACK
from pkm_rig.store.store import Store


def approve(
    rig: Rig, store: Store, proposal: LifeRow, who: str, why: str, now_s: Callable[[], float]
) -> dict[str, str]:
    """Bring a proposal's tables into all drives for good, or have the host correct by it, and record who approved that.

    Drive (or `host`) to generation.

    InputError where drives or machine are not those that it was measured on, or its tables are not whole in the store.
    """
    change = _change_of(rig, store, proposal)
    host = state_of(change.trials[-1].get(HOST))
    if host is not None:
        _require_same_drives(rig, store, proposal)
        for payload in activated_events(store, str(proposal.campaign)):
            verified_correction(store, str(proposal.campaign), payload)
    images = change.before.images if host is not None else _images(rig, proposal, change)
    with telling_tables(rig, store):
        require_standstill(rig)
        with rig.supervisor.during_motion():
            target = WantedTables(images, on=host is None)
            begin(rig, store, "approve", target=target, host=lambda _: host).bring_to_target()
    created = utc_text(now_s())
    data = {**proposal.data, "t_utc_s": now_s(), "approved_by": who}
    with store.writing() as connection:
        own = {"rig": rig.file.rig, "machine": proposal.machine, "created": created, "campaign": str(proposal.campaign)}
        add_life_row(connection, "machine_events", kind=APPROVED, data={"who": who, "why": why}, **own)
        add_life_row(connection, "calibrations", kind=ACCEPTED, data=data, **own)
    if host is not None:
        return {HOST: f"generation {host.generation}"}
    return {drive: f"generation {table_of(image)[0]}" for drive, image in images.items() if image is not None}


def _change_of(rig: Rig, store: Store, proposal: LifeRow) -> TableChange:
    found = [c for c in changes_of(rig, store) if c.id == proposal.data["table_change"]]
    if not found or not found[0].trials:
        raise InputError(f"proposal {proposal.campaign}: its tables are not in this store; calibrate anew")
    return found[0]


def _require_same_drives(rig: Rig, store: Store, proposal: LifeRow) -> None:
    """InputError where a drive was replaced since a proposal was measured."""
    for row in life_rows(store, "machine_events", rig.file.rig, proposal.machine):
        if row.kind == DRIVE_REPLACED and row.created > proposal.created:
            raise InputError(
                f"proposal {proposal.campaign}: drive {row.data['part']} was replaced since; calibrate anew"
            )


def _images(rig: Rig, proposal: LifeRow, change: TableChange) -> dict[str, bytes | None]:
    serials = {record["drive"]: record["serial"] for record in change.former}
    wanted = {name: (t["generation"], t["crc"]) for name, t in proposal.data["tables"].items()}
    found: dict[str, bytes | None] = {}
    for bank in rig.banks:
        name = bank.drive.name
        if serials.get(name) != serial_of(bank):
            raise InputError(f"proposal {proposal.campaign}: drive {name} was replaced since; calibrate anew")
        images = [as_image(trial["images"][name]) for trial in change.trials if name in trial["images"]]
        own = [image for image in images if image is not None and table_of(image) == wanted[name]]
        if not own:
            raise InputError(f"proposal {proposal.campaign}: the table of drive {name} is not whole; calibrate anew")
        if decode_table(own[-1]).machine_id != machine_id_of(rig.machine.name):
            raise InputError(f"proposal {proposal.campaign}: its tables are of another machine; not written")
        found[name] = own[-1]
    return found


def take_back(rig: Rig, store: Store, key: str, campaign: str, tables: str, who: str, why: str) -> str:
    """Bring the drives back to before the last change of tables, and the calibration out of force; what is in use then.

    InputError where the last change is not that of the calibration in force.
    """
    change = last_change(rig, store)
    if not _is_of(change, campaign, tables):
        raise InputError(
            f"the last change of tables is not that of calibration {campaign}; see `pkm-rig tables`, and "
            "`pkm-rig tables rollback` to go back by hand"
        )
    roll_back(rig, store, change)
    with store.writing() as connection:
        add_life_row(
            connection,
            "machine_events",
            rig=rig.file.rig,
            machine=key,
            kind=ROLLED_BACK,
            data={"campaign": campaign, "who": who, "why": why},
            campaign=campaign,
        )
    if change.host_former is not None:
        return change.host_former.in_words()
    return "the former tables" if change.before.on else "no compensation, as before"


def _is_of(change: TableChange, campaign: str, tables: str) -> bool:
    """Whether a change has left a calibration's tables, or the host's correction by it."""
    if not tables:
        hosts = [change.host_target, *(state_of(trial.get(HOST)) for trial in change.trials)]
        return any(host is not None and host.campaign == campaign for host in hosts)
    tried = {drive: tuple(table) for trial in change.trials for drive, table in trial["tables"].items()}
    wanted = {drive: table_of(image) for drive, image in change.target.images.items() if image is not None}
    return parse_tables(tables) in (tried, wanted)
