"""What instruments read of a machine: reflectors in a station's frame, coordinates of the tool, distances."""

__all__ = ["distances", "readings", "smr_positions", "station_geometry", "tool_coordinates"]
