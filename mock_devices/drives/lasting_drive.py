"""A mock drive's part of what outlives it, and how a drive starts from it."""

from __future__ import annotations

from dataclasses import asdict

from mock_devices.drives.axis_motion import AxisMotion
from mock_devices.drives.drive_axis import DriveAxis
from mock_devices.lasting_state import DriveState


def drive_state(axis: DriveAxis, t_s: float) -> DriveState:
    """What a drive would have kept if it lost its power at rig time `t_s`. Its lock must be held."""
    comp, count_inc = axis.compensation, axis.encoder_inc(t_s)
    return DriveState(
        count_inc=count_inc,
        shift_inc=axis.true_position_inc(t_s) - count_inc,
        referenced=axis.homing.referenced,
        active_bank=comp.active_bank,
        images=(comp.banks[1].image.hex(), comp.banks[2].image.hex()),
        limits=asdict(axis.limits),
        swaps=axis.swaps,
    )


def restore_drive(axis: DriveAxis, state: DriveState) -> None:
    """Power on where the state was kept: an incremental encoder counts from zero and has lost its reference."""
    lost_inc = 0.0 if axis.absolute else state.count_inc
    axis.motion = AxisMotion(state.count_inc - lost_inc, state.shift_inc + lost_inc)
    axis.target_inc = round(state.count_inc - lost_inc)
    axis.homing.referenced = axis.absolute and state.referenced
    for number, image in zip((1, 2), state.images, strict=True):
        axis.compensation.banks[number].write(bytes.fromhex(image))
    axis.compensation.active_bank = state.active_bank
    axis.swaps = state.swaps
    for name in asdict(axis.limits):
        setattr(axis.limits, name, state.limits.get(name, getattr(axis.limits, name)))
