"""Errors of the application beside those of inputs (`calibration.base.errors`) and devices (`drivers.errors`)."""

from __future__ import annotations


class CampaignRefused(Exception):
    """The rig works but must not be calibrated now, or its result is refused; one line with what to do."""


class StoreError(RuntimeError):
    """The store could not be written or read; one line."""
