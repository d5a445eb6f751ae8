"""The PLC on Modbus: its registers and the way to them."""
