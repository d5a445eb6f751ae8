"""A machine of the mock plant whose parameters change over the year, and a station that reads its reflectors.

Nothing is linearised: each pose is the plant's own equilibrium.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass, field, replace

import numpy as np

from calibration.machine.description import shipped_machine
from mock_devices.machine_file import read_machine_file
from mock_devices.plant.optics import rotation
from mock_devices.plant.true_machine import TrueMachine, draw_machine
from mock_devices.seeds import generator
from mock_devices.settings import InstrumentProfile, MockSettings

MACHINE = "planar4"
PARTS = ("struts", "columns", "base", "platform")
WANDER_K = 0.03  # of a part against the machine's mean, from one measurement to the next
SENSOR_SD_K = 0.005
REPEATABILITY_M = 1.0e-6  # of a drive from one approach to the next
STATION_M = (0.0, 0.3, 3.2)
LOOKING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass
class PlantMachine:
    """One true machine. `change` holds what has become of its parameters since it was drawn, by the names that the
    calibration gives them, `lost_m` by how much each drive stands beyond what it says since it has lost its reference;
    `station` is set up anew by `set_up`."""

    seed: int
    change: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._settings = MockSettings(seed=self.seed)
        self.drawn = draw_machine(read_machine_file(shipped_machine(MACHINE)), self._settings)
        self.instrument: InstrumentProfile = self._settings.instrument
        constants = generator(self.seed, "range")
        self._range_constant_m = float(self.instrument.range_constant_u_m * constants.standard_normal())
        self._range_scale = float(self.instrument.range_scale_u * constants.standard_normal())
        self._true: TrueMachine | None = None
        self.lost_m = np.zeros(len(self.drawn.file.sliders))
        self.set_up(0)

    def set_up(self, number: int) -> None:
        """Set the station up for the nth time: up to 10 mm and 5 mrad elsewhere, levelled within 20 urad."""
        rng = generator(self.seed, "station", number)
        self.station_m = np.array(STATION_M) + rng.uniform(-0.01, 0.01, 3)
        turn = np.array([*rng.uniform(-20e-6, 20e-6, 2), rng.uniform(-5e-3, 5e-3)])
        self.rotation = rotation(turn) @ LOOKING

    def move(self, name: str, by: float) -> None:
        """Change one parameter."""
        self.change[name] = self.change.get(name, 0.0) + by
        self._true = None

    @property
    def true(self) -> TrueMachine:
        """The plant's machine with all changes."""
        if self._true is None:
            self._true = _changed(self.drawn, self.change)
        return self._true

    def parts_c(self, mean_c: float, rng: np.random.Generator) -> tuple[dict[str, float], dict[str, float]]:
        """True temperatures of the parts, and what the sensors read."""
        true = {part: mean_c + WANDER_K * float(rng.standard_normal()) for part in PARTS}
        return true, {part: t + SENSOR_SD_K * float(rng.standard_normal()) for part, t in true.items()}

    def tool_m(self, drives_m: np.ndarray, parts_c: dict[str, float]) -> np.ndarray:
        """Tool points (n, 2), free of noise."""
        out = np.empty((len(drives_m), 2))
        for i, drives in enumerate((drives_m + self.lost_m).tolist()):
            tool = self.true.tool_point(self.true.pose(tuple(drives), 0, parts_c), parts_c)
            out[i] = tool.real, tool.imag
        return out

    def reflectors_m(self, drives_m: np.ndarray, parts_c: dict[str, float], rng: np.random.Generator) -> np.ndarray:
        """True places (n, s, 3) of all reflectors after approaching each pose, machine frame."""
        near = drives_m + self.lost_m + REPEATABILITY_M * rng.standard_normal(drives_m.shape)
        true = self.true
        return np.array(
            [
                true.smr_positions(true.pose(tuple(drives), 0, parts_c), tuple(drives), parts_c)
                for drives in near.tolist()
            ]
        )

    def read(self, places_m: np.ndarray, averaged: np.ndarray | float, rng: np.random.Generator) -> np.ndarray:
        """What the station reads of places (r, 3): its own coordinates from angles and distances, with noise.

        averaged: how many readings are averaged.
        """
        seen = (places_m - self.station_m) @ self.rotation.T
        distance = np.linalg.norm(seen, axis=1)
        hz, v = np.arctan2(seen[:, 0], seen[:, 1]), np.arccos(seen[:, 2] / distance)
        share = 1.0 / np.sqrt(np.asarray(averaged, dtype=np.float64) * np.ones(len(seen)))
        sd, white = self.instrument, rng.standard_normal((3, len(seen)))
        hz = hz + sd.angle_sd_rad * share * white[0]
        v = v + sd.angle_sd_rad * share * white[1]
        reported = distance * (1.0 + self._range_scale) + self._range_constant_m + sd.range_sd_m * share * white[2]
        return np.asarray(
            np.stack([np.sin(v) * np.sin(hz), np.sin(v) * np.cos(hz), np.cos(v)], axis=1) * reported[:, None]
        )


def _changed(drawn: TrueMachine, change: dict[str, float]) -> TrueMachine:
    """The plant's machine with changes in the calibration's terms: a change of the true value, not of nominal."""

    def of(name: str) -> float:
        return change.get(name, 0.0)

    struts = tuple(
        replace(
            s,
            length_m=s.length_m + of(f"strut_length.{s.name}"),
            platform_joint=s.platform_joint
            + complex(of(f"platform_joint.{s.name}.x"), of(f"platform_joint.{s.name}.y")),
            base_joint=s.base_joint + complex(of(f"base_joint.{s.name}.x"), of(f"base_joint.{s.name}.y")),
        )
        for s in drawn.file.struts
    )
    sliders = tuple(replace(s, axis=s.axis * cmath.exp(1j * of(f"axis_tilt.{s.name}.rz"))) for s in drawn.file.sliders)
    scales = tuple(
        scale + of(f"drive_scale.{s.name}") for scale, s in zip(drawn.scales, drawn.file.sliders, strict=True)
    )
    return replace(drawn, file=replace(drawn.file, struts=struts, sliders=sliders), scales=scales)
