"""A second simulator of campaigns, written from the description of the recording folder (other-simulator.md)."""
