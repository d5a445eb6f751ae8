"""The diagnosis of one drive alone: what makes a second position differ from its motor's."""

__all__ = [
    "diagnose",
    "effects",
    "likelihood",
    "model",
    "noise",
    "result",
    "ripple",
    "search",
    "signals",
    "withheld_stretches",
]
