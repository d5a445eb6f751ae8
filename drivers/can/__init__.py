"""CAN: one line, SDO transfers."""
