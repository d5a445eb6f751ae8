"""Drivers of the rig's devices: station (GeoCOM), servo drives (CiA 402) and PLC (Modbus TCP).

Plain classes with SI units at the surface and typed errors, usable alone from a script.
"""

__all__ = ["can", "clock", "drives", "errors", "plc", "station"]
