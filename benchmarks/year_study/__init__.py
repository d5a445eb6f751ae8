"""Simulated machine-years: calibration intervals decided by `calibration.intervals` on readings of the mock plant."""
