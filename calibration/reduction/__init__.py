"""From stored readings to poses of the platform: drift, report frame, pose filter, and figures of measured error."""

__all__ = [
    "budget",
    "common_points",
    "data_checks",
    "drift_filter",
    "figures",
    "grouped_readings",
    "left_out",
    "nest_checks",
    "nest_distances",
    "nest_gate",
    "part_temperatures",
    "pose_filter",
    "range_constant",
    "recording_setups",
    "reduction",
    "report_frame",
    "setups",
    "standard_figures",
    "station_drift",
]
