"""The mock PLC: its registers, served on Modbus."""
