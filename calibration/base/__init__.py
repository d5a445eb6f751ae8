"""What everything computes with: arrays, errors, checked files, rotations and rigid motions."""

__all__ = ["arrays", "csv_table", "errors", "frame", "outliers", "rotation", "rounding", "toml_file", "toml_text"]
