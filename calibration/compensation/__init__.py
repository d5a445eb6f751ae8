"""Tables of drive corrections that put the tool where it is commanded, and what they leave of its error."""

__all__ = ["error_map", "grid", "tables"]
