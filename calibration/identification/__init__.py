"""From readings to parameters with their uncertainty: estimators, what the data decide, which poses to measure."""
