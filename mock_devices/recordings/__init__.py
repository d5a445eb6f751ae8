"""Recordings straight from the plant, without any wire."""
