"""Recordings straight from the plant, without any wire."""

__all__ = ["columns", "design", "effect_size", "files", "maker", "timeline", "visible_size"]
