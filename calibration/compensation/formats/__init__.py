"""Files with the correction as tables for controls that lead the drives themselves."""

__all__ = [
    "beckhoff_plane",
    "catalogue",
    "control",
    "csv_tables",
    "heidenhain_com",
    "linuxcnc_comp",
    "siemens_cec",
]
