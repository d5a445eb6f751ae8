"""The station: GeoCOM on a serial line."""

__all__ = [
    "atmosphere",
    "coordinates",
    "geocom",
    "interim_test",
    "laser_tracker",
    "polar",
    "return_codes",
    "serial_line",
    "single_measurement",
    "station_setup",
]
