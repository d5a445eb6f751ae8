"""Mock servo drives: CiA 402 states, motion, compensation tables, on a CAN node."""
