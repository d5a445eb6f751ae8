"""The plant for a machine file: the planar one where it can stand for it, else the one in space."""

from __future__ import annotations

from pathlib import Path

from mock_devices.clock import RigClock
from mock_devices.machine_file import MachineFileError, read_machine_file
from mock_devices.plant.base_plant import BasePlant
from mock_devices.plant.plant import Plant
from mock_devices.plant.spatial_plant import SpatialPlant
from mock_devices.settings import MockSettings


def is_planar_slider_machine(machine_path: str | Path) -> bool:
    """Whether the planar plant, which has effects, can stand for the machine of a file."""
    try:
        machine = read_machine_file(machine_path)
    except MachineFileError:
        return False
    return len(machine.sliders) == 2 and machine.gravity != 0


def make_plant(machine_path: str | Path, settings: MockSettings, clock: RigClock) -> BasePlant:
    """The plant that stands for the machine of a file. Raises MachineFileError, EffectError and ValueError."""
    if is_planar_slider_machine(machine_path):
        return Plant(machine_path, settings, clock)
    if settings.effects or any(vars(settings.nuisance).values()) or settings.rest_friction:
        raise ValueError(
            "the mock has effects and disturbances for planar machines with two sliders only; leave out effects and "
            "nuisance"
        )
    return SpatialPlant(machine_path, settings, clock)
