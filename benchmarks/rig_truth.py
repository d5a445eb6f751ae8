"""True machines for the rig study, and where they stand by programs that share no code with `calibration`.

`planar4` stands where the plant of the mock rig says; `gough8`, for which there is no such plant, where the
reference model of the tests says, an independent implementation of docs/reference/machine.md.

Errors are drawn from normal distributions with the standard deviation of the machine file's uniform ones, half-width /
sqrt 3: exactly the priors of an identification. With uniform draws an interval of 1.96 prior standard deviations would
contain every parameter that the readings do not reach, always, and coverage would say nothing about those.
"""

from __future__ import annotations

import cmath
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mock_devices.machine_file import MachineFile, read_machine_file
from mock_devices.plant.structure import Weight
from mock_devices.plant.true_machine import TrueMachine
from tests.calibration.reference_model import Case, Pose, ReferenceModel, quaternion

Array = NDArray[np.float64]
AT_REST = 1e-12  # largest Newton step (m or rad) that may be missing
NEWTON_STEPS = 4  # from a target that is some tenths of a millimetre away


@dataclass(frozen=True)
class Payload:
    """A payload as it is, or as it is stated: kg, and its centre of mass in the platform frame."""

    kg: float
    com_m: tuple[float, float, float]


class Plant(Protocol):
    """Where a machine with known errors stands."""

    def tool(self, errors: Mapping[str, float], drives: Array, target_m: Array, payload: Payload) -> Array:
        """Tool point and rotation vector (n, 6) for drive coordinates (n, d) of platform targets (n, 6)."""


def plant_of(path: Path) -> Plant:
    """The independent plant of a machine file: the mock rig's where it is of that kind, else the reference model."""
    reference = ReferenceModel(path.read_text(encoding="utf-8"))
    planar_with_sliders = reference.planar and all(drive["kind"] == "slider" for drive in reference.drives)
    return MockPlant(read_machine_file(path)) if planar_with_sliders else ReferencePlant(reference)


def generator(purpose: str, seed: int) -> np.random.Generator:
    """A stream of random numbers of its own for every purpose of every rig."""
    return np.random.default_rng([zlib.crc32(purpose.encode()), seed])


def deviations(path: Path) -> dict[str, float]:
    """Standard deviation of the draw of every error, by name, from the machine file's tolerances."""
    model = ReferenceModel(path.read_text(encoding="utf-8"))
    return {name: model.tolerance(name) / math.sqrt(3.0) for name in model.names}


def draw_errors(path: Path, seed: int) -> dict[str, float]:
    """Errors of one machine, by name."""
    sizes = deviations(path)
    draws = generator(f"errors {path.stem}", seed).standard_normal(len(sizes))
    return {name: float(draw) * size for draw, (name, size) in zip(draws, sizes.items(), strict=True)}


@dataclass(frozen=True)
class MockPlant:
    """The plant of the mock rig, at the reference temperature; its errors are handed over by name."""

    file: MachineFile

    def tool(self, errors: Mapping[str, float], drives: Array, target_m: Array, payload: Payload) -> Array:
        """As `Plant.tool`; the plant finds its own start, so targets are not used."""
        load = Weight(payload.kg, complex(payload.com_m[0], payload.com_m[1]))
        machine = TrueMachine(*self._with(errors), (load,))
        warmth = {e.sensor: self.file.reference_temperature_c for e in self.file.expansion.values()}
        out = np.zeros((len(drives), 6))
        for row, q in enumerate(drives.tolist()):
            pose = machine.pose(tuple(q), 0, warmth)
            tool = machine.tool_point(pose, warmth)
            out[row, [0, 1, 5]] = tool.real, tool.imag, pose.rz_rad
        return out

    def _with(self, errors: Mapping[str, float]) -> tuple[MachineFile, tuple[float, ...]]:
        def point(kind: str, name: str) -> complex:
            return complex(errors[f"{kind}.{name}.x"], errors[f"{kind}.{name}.y"])

        struts = tuple(
            replace(
                s,
                length_m=s.length_m + errors[f"strut_length.{s.name}"],
                platform_joint=s.platform_joint + point("platform_joint", s.name),
                base_joint=s.base_joint + point("base_joint", s.name),
                stiffness_n_per_m=s.stiffness_n_per_m * math.exp(errors[f"ln_stiffness.{s.name}"]),
            )
            for s in self.file.struts
        )
        sliders = tuple(
            replace(s, axis=s.axis * cmath.exp(1j * errors[f"axis_tilt.{s.name}.rz"])) for s in self.file.sliders
        )
        scales = tuple(1.0 + errors[f"drive_scale.{s.name}"] for s in self.file.sliders)
        return replace(self.file, struts=struts, sliders=sliders), scales


@dataclass(frozen=True)
class ReferencePlant:
    """The reference model of the tests, all poses at once."""

    model: ReferenceModel

    def tool(self, errors: Mapping[str, float], drives: Array, target_m: Array, payload: Payload) -> Array:
        """As `Plant.tool`, Newton's method from the targets."""
        turns = np.array([quaternion(r) for r in target_m[:, 3:].tolist()])
        start = Pose(list(target_m[:, :3].T), list(turns.T))
        masses = [self.model.moving, (payload.kg, payload.com_m)]
        case = Case(list(drives.T), masses)
        pose = self.model.rest(errors, case, start, NEWTON_STEPS)
        missing = np.max(np.abs(self.model.unrest(errors, case, pose)))
        if not missing < AT_REST:
            raise ArithmeticError(f"the reference model is {missing:.1e} from rest")
        return np.array([*pose.place(self.model.tool_point), *self.model.rotation_vector(pose)]).T
