"""The diagnosis of one drive alone: what makes a second position differ from its motor's."""

__all__ = [
    "diagnose",
    "effects",
    "likelihood",
    "model",
    "noise",
    "non_parametric",
    "result",
    "ripple",
    "scale",
    "search",
    "signals",
    "smooth_function",
    "withheld_stretches",
]
