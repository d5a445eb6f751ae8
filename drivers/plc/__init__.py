"""The PLC on Modbus: its registers and the way to them."""

__all__ = ["modbus_line", "plc", "plc_registers"]
