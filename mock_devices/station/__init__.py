"""The mock station: telescope, GeoCOM answers, lines."""

__all__ = ["geocom_line", "mock_station", "station_server", "telescope"]
