"""Campaigns and measurement folders as plain files, and the same in memory: checked before anything uses them."""

__all__ = [
    "axis_header",
    "axis_recording",
    "axis_wrong_samples",
    "columns",
    "delta_printer",
    "folder",
    "hdf5",
    "header",
    "klipper",
    "measurement_conditions",
    "measurement_folder",
    "measurement_header",
    "recording",
    "sessions",
]
