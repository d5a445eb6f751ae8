"""One rig: its file, its devices behind one set of verbs, its supervision, its clock, its record."""

__all__ = [
    "campaign_sections",
    "capabilities",
    "clock",
    "config",
    "connection",
    "device_sections",
    "devices",
    "plans",
    "plc_connection",
    "previous_tables",
    "rig",
    "rig_checks",
    "rig_lock",
    "runner",
    "schedule",
    "session_record",
    "standstill",
    "station_air",
    "supervision",
    "worker",
]
