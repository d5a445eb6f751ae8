"""The model of a fit: the machine's parameters, its visits and its loads, and the poses that they give."""

__all__ = ["model", "operating_conditions", "parameters", "payload", "visits"]
