"""The mock PLC: its registers, served on Modbus."""

__all__ = ["plc_registers", "plc_server"]
