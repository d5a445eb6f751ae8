"""On-machine calibration of over-constrained parallel kinematic machines."""

__version__ = "0.1.0"
