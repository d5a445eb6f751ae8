"""The twin of a rig: the fitted model with the effects that a diagnosis found, simulated and scored."""
