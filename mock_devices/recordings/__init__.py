"""Recordings straight from the plant, without any wire."""

__all__ = ["columns", "design", "effect_size", "files", "maker", "moved_station", "timeline", "visible_size"]
