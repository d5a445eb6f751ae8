"""The twin of a rig: the fitted model with the effects that a diagnosis found, simulated and scored."""

__all__ = ["answers", "folder_twin", "joint_fit", "plain_data", "score", "twin", "twin_model"]
