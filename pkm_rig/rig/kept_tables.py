"""The tables that the store knows of a rig, for the header of its next campaign: one that is on unsaid is found."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from calibration.recording.header import KnownTable
from drivers.drives.table_image import TableImage, decode_table
from drivers.errors import TableError
from pkm_rig.rig.drive_tables import as_image
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.table_change import TableChange, changes_of
from pkm_rig.store.store import Store

MOST_GENERATIONS = 6  # the newest: a header stays small
DIGITS = 12  # of metres: below an increment


def kept_tables(rig: Rig, store: Store) -> tuple[KnownTable, ...]:
    """The tables of the newest generations that were tried or found in the rig's drives, as this store knows them."""
    increments = {bank.drive.name: bank.drive.metres_per_increment for bank in rig.banks}
    if len(increments) != 2:  # a table's second axis is the other drive
        return ()
    found: dict[tuple[int, str], KnownTable] = {}
    for change in changes_of(rig, store):
        if change.machine != rig.machine.name:
            continue
        for drive, data in _images(change):
            if drive in increments:
                with suppress(TableError, ValueError):  # of another make, or none at all
                    image = decode_table(data, increments[drive])
                    (partner,) = set(increments) - {drive}
                    found[image.generation, drive] = _known_table(image, drive, partner)
    newest = sorted({generation for generation, _ in found})[-MOST_GENERATIONS:]
    return tuple(found[key] for key in sorted(found) if key[0] in newest)


def _images(change: TableChange) -> Iterator[tuple[str, bytes]]:
    """Drives and images of a change: of before, then those that were tried."""
    for drive, image in change.before.images.items():
        if image is not None:
            yield drive, image
    for trial in change.trials:
        for drive, text in trial["images"].items():
            if (data := as_image(text)) is not None:
                yield drive, data


def _known_table(image: TableImage, drive: str, partner: str) -> KnownTable:
    corrections = np.round(image.corrections_m, DIGITS)
    own, other = (
        tuple(np.round(start + step * np.arange(count), DIGITS).tolist())
        for start, step, count in zip(
            (image.own_start_m, image.partner_start_m),
            (image.own_step_m, image.partner_step_m),
            corrections.shape,
            strict=True,
        )
    )
    return KnownTable(
        generation=image.generation,
        drive=drive,
        own_m=own,
        partner=partner,
        partner_m=other,
        corrections_m=tuple(tuple(row) for row in corrections.tolist()),
    )
