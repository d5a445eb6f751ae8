"""Servo drives by CiA 402: one drive, all drives of a machine, their compensation tables."""

__all__ = [
    "bus_load",
    "cia402",
    "cyclic_path",
    "drive_group",
    "drive_messages",
    "drive_profile",
    "drive_records",
    "drive_setup",
    "group_stop",
    "homing",
    "objects",
    "pdo",
    "profile_move",
    "reference",
    "servo_drive",
    "sync_sampler",
    "table_bank",
    "table_group",
    "table_image",
]
