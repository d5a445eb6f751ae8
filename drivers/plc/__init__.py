"""The PLC on Modbus: its registers and the way to them."""

__all__ = ["modbus_connection", "modbus_line", "own_words", "plc", "plc_registers"]
