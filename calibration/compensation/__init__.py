"""Compensation: corrections of drives that put the tool where it is commanded, as tables in drives or for controls."""

__all__ = [
    "correction",
    "decomposition",
    "error_map",
    "formats",
    "free_part",
    "grid",
    "host",
    "kinematics",
    "limits",
    "measured_range",
    "piecewise",
    "remaining_error",
    "samples",
    "tables",
]
