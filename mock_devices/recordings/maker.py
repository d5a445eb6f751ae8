"""Recordings straight from the plant, without any wire: what the rig would have written of a designed campaign.

The columns are those of docs/reference/recording.md. Nothing in a recording tells of effects, seeds or the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mock_devices.effects.base import GRAVITY_M_PER_S2, Array, Effect, MotionState, StationSight
from mock_devices.machine_file import MachineFile, read_machine_file, read_machine_text
from mock_devices.plant.affected_machine import AffectedMachine, make_effects
from mock_devices.plant.atmosphere import ppm
from mock_devices.plant.noise import heavy_tailed
from mock_devices.plant.optics import TWO_PI, StationView
from mock_devices.plant.thermal import SENSORS, Thermal
from mock_devices.plant.true_machine import draw_machine
from mock_devices.recordings.columns import column_names, covariances, header_of, points
from mock_devices.recordings.design import Design
from mock_devices.recordings.moved_station import MovedStation
from mock_devices.recordings.timeline import Timeline, plan
from mock_devices.seeds import generator
from mock_devices.settings import MockSettings

_FEED_M, _RATED_TORQUE_NM, _FRICTION_N = 0.010, 10.0, 60.0  # as in the drives' object 0x6077
_COVARIANCE = ((0, 0, "xx"), (0, 1, "xy"), (0, 2, "xz"), (1, 1, "yy"), (1, 2, "yz"), (2, 2, "zz"))

Column = NDArray[Any]


@dataclass(frozen=True)
class MockRecording:
    """A recording in memory: what recording.toml says, the machine file's text, columns of equal length."""

    header: dict[str, Any]
    machine_text: str
    columns: dict[str, Column]

    def __len__(self) -> int:
        return len(self.columns["t_rig_s"])


class SimulatedCampaign:
    """One true machine with its station and its temperatures, and a timeline to carry out on it."""

    def __init__(self, machine_path: str | Path, settings: MockSettings, design: Design | Timeline) -> None:
        self.settings = settings
        self.nominal, self.machine_text = _machine_file(str(machine_path))
        self.timeline = design if isinstance(design, Timeline) else plan(self.nominal, design)
        self.thermal = Thermal(settings)
        moves = self.timeline.design.moves
        self.view = MovedStation(settings, self.timeline.moved_s, moves) if moves else StationView(settings)
        self.machine = draw_machine(self.nominal, settings)

    @property
    def start_s(self) -> float:
        """When the campaign begins."""
        return self.timeline.design.start_s

    @cached_property
    def moments(self) -> MotionState:
        """The moments of all readings: the same whatever the effects, which only read them."""
        return self.timeline.moments(self.thermal, self.settings.payloads)

    def sight(self, effects: list[Effect] | None = None) -> tuple[StationSight, MotionState, Array]:
        """What the station sees of all reflectors at every reading (r, smrs); moments; friction forces (r, d) in N.

        `effects` must be new ones; left out, those of the settings.
        """
        if effects is None:
            effects = make_effects(self.nominal, self.settings, start_s=self.start_s)
        affected, m = AffectedMachine(self.machine, self.view, effects), self.moments
        seen = self.timeline.sight(affected, m)
        return seen, m, affected.deviation(m).force_n if effects else np.zeros(m.q_m.shape)

    def points_m(self, effects: list[Effect] | None = None) -> Array:
        """The measured reflector of each reading, free of noise, in the station's frame (r, 3)."""
        seen, _, _ = self.sight(effects)
        rows = np.arange(len(self.timeline))
        k = self.timeline.smr
        return points(seen.hz_rad[rows, k], seen.v_rad[rows, k], seen.distance_m[rows, k])

    def record(self, name: str = "campaign") -> MockRecording:
        """Carry the campaign out."""
        seen, m, force_n = self.sight()
        columns = self._readings(seen) | self._context() | self._drives(m, force_n)
        names = column_names(self.nominal)
        return MockRecording(self._header(name), self.machine_text, {name: columns[name] for name in names})

    def _readings(self, seen: StationSight) -> dict[str, Column]:
        line, sd, n = self.timeline, self.settings.instrument, len(self.timeline)
        rows, k = np.arange(n), line.smr
        rng = generator(self.settings.seed, "recording noise")
        noise = heavy_tailed(rng.standard_normal((n, 3)), self.settings.noise_tails, rng)
        noise = noise * np.array([sd.angle_sd_rad, sd.angle_sd_rad, sd.range_sd_m]) / np.sqrt(line.samples)[:, None]
        v = seen.v_rad[rows, k] + noise[:, 1]
        hz = (seen.hz_rad[rows, k] + noise[:, 0] / np.sin(v)) % TWO_PI
        air = self._air()
        raw = seen.distance_m[rows, k] * self.view.range_scale + self.view.range_constant_m + noise[:, 2]
        distance = raw * (1.0 + (air["ppm"] - air["ppm_true"]) * 1.0e-6)
        place = points(hz, v, distance)
        covariance = covariances(hz, v, distance, sd.angle_sd_rad, sd.range_sd_m) / line.samples[:, None, None]
        jitter = self.settings.clock_jitter_s * rng.standard_normal(n)
        return {
            "uid": np.array([f"{i:06d}" for i in range(n)]),
            "phase": np.where(line.is_nest, "nests", "calibration"),
            "smr": np.array([smr.name for smr in self.nominal.smrs])[k],
            "sequence": rows.astype(np.float64),
            "t_rig_s": line.t_s + jitter,
            "t_host_s": line.t_s + jitter,
            "t_u_s": 0.5 * line.design.measure_s * line.samples,
            "hz_rad": hz, "v_rad": v, "slope_distance_m": distance,
            "x_m": place[:, 0], "y_m": place[:, 1], "z_m": place[:, 2],
            **{f"cov_{name}_m2": covariance[:, i, j] for i, j, name in _COVARIANCE},
            "samples": line.samples,
            "ppm": air["ppm"],
            "air_temperature_c": air["air_c"], "pressure_hpa": air["pressure_hpa"],
            "humidity_percent": np.full(n, 100.0 * self.thermal.humidity()),
        }  # fmt: skip

    def _context(self) -> dict[str, Column]:
        line, n = self.timeline, len(self.timeline)
        visits, before = line.design.visits, np.maximum(line.visit, 0)
        none = line.visit < 0

        def of_visit(values: list[float], missing: float) -> Array:
            return np.where(none, missing, np.array(values, dtype=np.float64)[before])

        def constant(value: float) -> Array:
            return np.full(n, value)

        mass = np.array([payload.mass_kg for payload in self.settings.payloads])
        return {
            "visit": line.visit.astype(np.float64),
            "pose": of_visit([float(v.pose) for v in visits], -1.0),
            "pass": of_visit([float(v.pass_) for v in visits], 0.0),
            "nest_check": line.check.astype(np.float64),
            "station": line.setup.astype(np.float64), "face": constant(1.0), "prism_constant_m": constant(0.0),
            "target_x_m": of_visit([(v.target_m - self.nominal.tool_point).real for v in visits], 0.0),
            "target_y_m": of_visit([(v.target_m - self.nominal.tool_point).imag for v in visits], 0.0),
            **{f"target_{c}": constant(0.0) for c in ("z_m", "rx_rad", "ry_rad", "rz_rad")},
            "speed_m_per_s": of_visit([v.speed_m_per_s for v in visits], 0.0),
            "dwell_s": np.where(none, 0.0, line.dwell_s),
            "payload": line.payload.astype(np.float64), "payload_mass_kg": mass[line.payload],
            "compensation": constant(0.0), "flags": constant(0.0),
        }  # fmt: skip

    def _drives(self, state: MotionState, force_n: Array) -> dict[str, Column]:
        line, drives = self.timeline, len(self.nominal.sliders)
        out: dict[str, Column] = {}
        load_kg = (self.nominal.moving_mass_kg + state.payload_kg) / drives
        sides = np.array([visit.direction for visit in line.design.visits], dtype=np.float64)[np.maximum(line.visit, 0)]
        for a, slider in enumerate(self.nominal.sliders):
            v = line.velocity_m_per_s[:, a]
            force = load_kg * GRAVITY_M_PER_S2 + force_n[:, a] + np.sign(v) * _FRICTION_N
            torque = force * _FEED_M / TWO_PI / _RATED_TORQUE_NM
            out |= {
                f"{slider.name}_commanded_m": line.q_m[:, a],
                f"{slider.name}_actual_m": line.q_m[:, a],
                f"{slider.name}_following_error_m": np.zeros(len(line)),
                f"{slider.name}_velocity_m_per_s": v,
                f"{slider.name}_torque_ratio": np.round(torque, 3),
                f"{slider.name}_direction": np.where(line.visit < 0, 0.0, sides[:, a]),
            }
        for name in SENSORS:
            out[f"{name}_temperature_c"] = self.thermal.sensor_series_c(name, line.t_s)
        return out

    def _air(self) -> dict[str, Array]:
        """Air as its sensors read it, the ppm that the station applies (set before each reading) and the true one."""
        t, thermal = self.timeline.t_s, self.thermal
        read_c, true_c = thermal.sensor_series_c("air", t), thermal.air_series_c(t)
        pressure, humidity = thermal.pressure_series_hpa(t), thermal.humidity()

        def series(air_c: Array) -> Array:
            pairs = zip(air_c.tolist(), pressure.tolist(), strict=True)
            return np.array([ppm(c, hpa, humidity=humidity) for c, hpa in pairs])

        return {"air_c": read_c, "pressure_hpa": pressure, "ppm": series(read_c), "ppm_true": series(true_c)}

    def _header(self, name: str) -> dict[str, Any]:
        return header_of(self.nominal, self.settings, name)


def make_recording(
    machine_path: str | Path, settings: MockSettings, design: Design | Timeline, name: str = "campaign"
) -> MockRecording:
    """Carry a campaign out on the plant of some settings."""
    return SimulatedCampaign(machine_path, settings, design).record(name)


@lru_cache(maxsize=8)
def _machine_file(path: str) -> tuple[MachineFile, str]:
    return read_machine_file(path), read_machine_text(path)
