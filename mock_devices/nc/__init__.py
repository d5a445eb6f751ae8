"""A numerical control that leads the mock's drives by itself: its program, its own correction, and its player."""

__all__ = ["correction", "player", "program"]
