"""Fits the constants of the diagnosis' verdict crosswise, on cases that the figures to be judged are not made of."""

__all__ = ["fit", "run", "sources", "table"]
