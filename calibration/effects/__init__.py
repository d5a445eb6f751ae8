"""The catalogue of physical effects that a calibrated model leaves out (docs/reference/effects.md)."""
