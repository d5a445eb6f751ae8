"""From stored readings to poses of the platform: drift, report frame, pose filter, and figures of measured error."""

__all__ = [
    "data_checks",
    "drift_filter",
    "figures",
    "grouped_readings",
    "left_out",
    "nest_gate",
    "pose_filter",
    "reduction",
    "report_frame",
]
