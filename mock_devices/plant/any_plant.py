"""The plant for a machine file: the planar one where it can stand for it, else the one in space."""

from __future__ import annotations

from pathlib import Path

from mock_devices.clock import RigClock
from mock_devices.effects import EffectChoice, parse
from mock_devices.effects.in_space import check_in_space, view_of
from mock_devices.machine_file import MachineFileError, read_machine_file
from mock_devices.plant.base_plant import BasePlant
from mock_devices.plant.plant import Plant
from mock_devices.plant.spatial_plant import SpatialPlant
from mock_devices.settings import MockSettings
from mock_devices.spatial_file import read_spatial_machine


def is_planar_slider_machine(machine_path: str | Path) -> bool:
    """Whether the planar plant, which has all effects, can stand for the machine of a file."""
    try:
        machine = read_machine_file(machine_path)
    except MachineFileError:
        return False
    return len(machine.sliders) == 2 and machine.gravity != 0


def make_plant(machine_path: str | Path, settings: MockSettings, clock: RigClock) -> BasePlant:
    """The plant that stands for the machine of a file. Raises MachineFileError, EffectError and ValueError."""
    if is_planar_slider_machine(machine_path):
        return Plant(machine_path, settings, clock)
    return SpatialPlant(machine_path, settings, clock)


def parse_effect(text: str, machine_path: str | Path) -> EffectChoice:
    """An effect as it is written, checked for the machine of a file; raises EffectError in one line."""
    if is_planar_slider_machine(machine_path):
        return parse(text, read_machine_file(machine_path))
    file = read_spatial_machine(machine_path)
    choice = parse(text, view_of(file))
    check_in_space(choice, file)
    return choice
