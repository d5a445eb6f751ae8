"""The gap between the calibrated model and the machine: where it is, which effect causes it, how far it shrinks."""

__all__ = [
    "any_change",
    "channels",
    "curve_fit",
    "departure_evidence",
    "diagnose",
    "disturbances",
    "effect_inputs",
    "evidence",
    "findings",
    "linear_model",
    "non_parametric",
    "observed_model",
    "outlying_readings",
    "periodogram",
    "ranking",
    "result",
    "search",
    "settings",
    "twin",
    "verdict",
]
