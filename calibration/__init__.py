"""Pure computation: from a machine description and readings to parameters and tables."""

__all__ = [
    "axis",
    "base",
    "comparison",
    "compensation",
    "diagnosis",
    "effects",
    "identification",
    "instruments",
    "intervals",
    "machine",
    "model",
    "recording",
    "reduction",
]
