"""Servo drives by CiA 402: one drive, all drives of a machine, their compensation tables."""
