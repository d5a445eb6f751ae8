"""Protocol servers around one simulated machine: station, servo drives, PLC.

Written without `calibration`, `drivers` and `pkm_rig`, so that agreement with them means something.
"""

__all__ = [
    "axis",
    "can",
    "clock",
    "commands",
    "control_port",
    "drives",
    "effects",
    "faults",
    "known_tables",
    "lasting_state",
    "machine_file",
    "nc",
    "plant",
    "plc",
    "pty_link",
    "recordings",
    "rig",
    "seeds",
    "settings",
    "spatial_file",
    "station",
    "stepped_clock",
]
