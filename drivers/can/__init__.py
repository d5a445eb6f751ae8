"""CAN: one line, SDO transfers."""

__all__ = ["bus", "can_line", "drive_object", "sdo", "sdo_block"]
