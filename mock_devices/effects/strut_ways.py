"""Where struts, carriages and the platform are by the nominal geometry and without turning the platform."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Complex, MotionState, Site
from mock_devices.machine_file import MachineFile


def way_of_strut(machine: MachineFile, place: int, q_m: Array) -> Complex:
    """From a strut's joint on the slider to that on the platform (n,), if the platform does not turn."""
    mine = machine.struts[place]
    other = next(strut for strut in machine.struts if strut.drive != mine.drive)
    here, there = (
        strut.base_joint - strut.platform_joint + machine.sliders[strut.drive].axis * q_m[:, strut.drive]
        for strut in (mine, other)
    )
    apart = np.abs(there - here)
    along = (apart**2 + mine.length_m**2 - other.length_m**2) / (2.0 * apart)
    across = 1j * np.sqrt(np.maximum(mine.length_m**2 - along**2, 0.0))
    slider = machine.sliders[mine.drive]
    one, two = (np.asarray((along + side * across) * (there - here) / apart) for side in (1.0, -1.0))
    above = slider.branch * ((one - two) * slider.axis.conjugate()).real > 0.0  # branch 1: it hangs below
    return np.where(above, two, one)


def swing_rad(machine: MachineFile, place: int, q_m: Array) -> Array:
    """A strut's angle (n,) from that in the middle of all travels."""
    middle_m = np.array([[0.5 * (slider.travel_m[0] + slider.travel_m[1]) for slider in machine.sliders]])
    now, then = (way_of_strut(machine, place, at_m) for at_m in (q_m, middle_m))
    return np.angle(now * then.conjugate())


def platform_place(machine: MachineFile, q_m: Array) -> Complex:
    """Where the platform's origin is (n,)."""
    strut = machine.struts[0]
    on_slider = strut.base_joint + machine.sliders[strut.drive].axis * q_m[:, strut.drive]
    return np.asarray(on_slider + way_of_strut(machine, 0, q_m) - strut.platform_joint)


def beside_m(site: Site, state: MotionState, drive: int) -> Array:
    """By how much the next carriage stands above a drive's own (n,), each from the middle of its travel."""
    other = (drive + 1) % len(site.machine.sliders)
    above = state.q_m[:, other] - site.drive_range_m(other)[0]
    return np.asarray(above - (state.q_m[:, drive] - site.drive_range_m(drive)[0]))
