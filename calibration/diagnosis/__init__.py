"""The gap between the calibrated model and the machine: where it is, which effect causes it, how far it shrinks."""
