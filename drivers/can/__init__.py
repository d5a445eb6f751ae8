"""CAN: one line, SDO transfers."""

__all__ = ["bus", "can_line", "drive_object", "other_master", "sdo", "sdo_block"]
