"""The record of all campaigns of a folder."""

__all__ = ["sessions", "store"]
