"""The formats of tables by name."""

from __future__ import annotations

from calibration.base.errors import InputError
from calibration.compensation.formats import (
    beckhoff_plane,
    csv_tables,
    heidenhain_com,
    linuxcnc_comp,
    siemens_cec,
)
from calibration.compensation.formats.control import TableFormat

FORMATS: dict[str, TableFormat] = {
    form.name: form
    for form in (
        csv_tables.FORMAT,
        *linuxcnc_comp.FORMATS.values(),
        siemens_cec.FORMAT,
        beckhoff_plane.FORMAT,
        heidenhain_com.FORMAT,
    )
}


def table_format(name: str) -> TableFormat:
    """A format by its name; InputError if there is none."""
    if name not in FORMATS:
        raise InputError(f"format '{name}' is unknown; known: {', '.join(FORMATS)}")
    return FORMATS[name]
