"""Rigs without hardware: the mock rig, and a diagnosed twin behind the real protocols."""
