"""Rigid models of the same readings, for comparison: none of them knows that parts deform."""

__all__ = ["closure", "models"]
