"""The catalogue of physical effects that a calibrated model leaves out (docs/reference/effects.md)."""

__all__ = [
    "api",
    "base",
    "basis_functions",
    "basis_sets",
    "catalogue",
    "columns",
    "context",
    "control",
    "departures",
    "drive_train",
    "former_names",
    "guides",
    "instrument",
    "memory",
    "partial_context",
    "reversal",
    "stated_values",
    "structure",
    "strut_laws",
    "thermal",
]
