"""Calibrated geometry for controls that compute the drives' positions from poses themselves."""

__all__ = ["catalogue", "fit", "genhexkins", "linear_delta"]
