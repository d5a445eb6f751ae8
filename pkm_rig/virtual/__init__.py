"""Rigs without hardware: the mock rig, and a diagnosed twin behind the real protocols."""

__all__ = ["embedded_bus", "hil_rig", "mock_rig", "new_rig", "ownership", "served_rig", "twin_files", "twin_rig"]
