"""What a command does, from the rig or the store to a result."""

__all__ = [
    "acceptance",
    "added_visits",
    "axis",
    "calibrate",
    "campaign_file",
    "check",
    "compensate",
    "diagnose",
    "disturbance_levels",
    "homing",
    "identify",
    "interim",
    "measure",
    "measured_machine",
    "next_command",
    "planning",
    "session",
    "setup_tie",
    "tables",
    "verify",
]
