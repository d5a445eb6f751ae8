"""What instruments read of a machine: reflectors in a station's frame, coordinates of the tool, distances."""

__all__ = [
    "air",
    "distances",
    "readings",
    "setups",
    "smr_positions",
    "station_geometry",
    "tool_coordinates",
    "visibility",
]
