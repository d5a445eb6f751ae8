"""What everything computes with: arrays, errors, checked files, rotations and rigid motions."""

__all__ = [
    "arrays",
    "csv_table",
    "errors",
    "frame",
    "local_level",
    "outliers",
    "plain_file",
    "rotation",
    "rounded_values",
    "rounding",
    "text_bounds",
    "toml_file",
    "toml_text",
]
