"""When a machine is calibrated again: what is due, doing it within limits, waiting for approval, telling others."""

__all__ = ["decisions", "envelope", "journal", "proposals", "run", "situation", "units", "watch", "windows"]
