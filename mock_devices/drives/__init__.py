"""Mock servo drives: CiA 402 states, motion, compensation tables, on a CAN node."""

__all__ = [
    "axis_limits",
    "axis_motion",
    "cia402",
    "compensation",
    "cyclic_position",
    "drive_axis",
    "drive_node",
    "drive_objects",
    "following_error",
    "homing",
    "lasting_drive",
    "mock_axis",
    "mock_drive",
    "motion_profile",
    "table_bank",
    "trial",
]
