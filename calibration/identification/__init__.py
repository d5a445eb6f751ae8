"""From readings to parameters with their uncertainty: estimators, what the data decide, which poses to measure."""

__all__ = [
    "calibration",
    "combinations",
    "estimators",
    "explanations",
    "fit",
    "from_prior",
    "gate",
    "held_out",
    "joint_covariance",
    "leave_one_out",
    "linear_system",
    "measured_gate",
    "model_comparison",
    "observability",
    "pose_selection",
    "prediction",
    "problem",
    "remarks",
    "rigid",
    "step_size",
]
