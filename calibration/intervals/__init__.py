"""Calibration intervals (ILAC-G24 / OIML D 10): when to calibrate again, from stored facts of a machine's life.

Every function is pure: it takes facts and a time and returns a result with its reasons in words. None reads a clock.
"""

__all__ = [
    "charts",
    "check_design",
    "check_effects",
    "check_estimate",
    "decision",
    "drift",
    "envelope",
    "extent",
    "facts",
    "health",
    "kalman",
    "limits",
    "partial",
    "prediction",
    "rules",
    "sequential",
    "settings",
    "validity",
    "watched",
]
