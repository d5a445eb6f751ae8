"""Campaigns on spatial machines: the reference model of the tests finds where they stand.

That model is written from docs/reference/machine.md alone and shares no code with `calibration`. Station, air and
temperatures are simple ones of this module's own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from benchmarks.comparison.change import Array, Change
from calibration.machine.description import Machine, load_machine, shipped_machine
from calibration.recording.columns import column_names
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording
from mock_devices.plant.optics import rotation
from mock_devices.settings import DisturbanceLevels
from tests.calibration.reference_model import Case, Pose, ReferenceModel, quaternion

VISITS = (64, 96)
NEST_EVERY, NEST_SAMPLES, REST = 5, 5, 1e-11
PART_OF = {"struts": "struts", "columns": "drives", "base": "base", "platform": "platform"}
STANDS_M = ((0.3, -3.2, 0.8), (2.6, -2.0, 1.2), (-2.4, -2.2, 0.6))
REACH = 0.85  # of the workspace
ANGLE_RAD, RANGE_M, RANGE_CONSTANT_M, RANGE_SCALE = 2.4e-6, 1.0e-5, 1.0e-4, 1.0e-6
SECONDS_A_READING, SECONDS_A_VISIT = 3.0, 8.0


@lru_cache(maxsize=4)
def machine_of(name: str) -> tuple[ReferenceModel, Machine]:
    """The machine, as the reference model reads it and as the comparison does."""
    path = shipped_machine(name)
    return ReferenceModel(path.read_text(encoding="utf-8")), load_machine(path)


@dataclass(frozen=True)
class Design:
    """Visits (v): commanded poses of the platform (v, 6), drives (v, d), payload numbers, sides (v, d).

    Readings (r): visit (-1: a floor nest), reflector, time in s, samples, and number of the nest check.
    """

    target_m: Array
    drives: Array
    payload: Array
    side: Array
    visit: Array
    smr: Array
    t_s: Array
    samples: Array
    check: Array

    @property
    def at(self) -> Array:
        """Visit (r,) whose poses stand for each reading; nests are read where the machine happens to be."""
        return np.maximum(self.visit, 0).astype(np.intp)


@lru_cache(maxsize=32)
def design(name: str, number: int) -> Design:
    """One of the campaigns' designs."""
    model, machine = machine_of(name)
    rng = np.random.default_rng([19, number])
    count = int(rng.integers(*VISITS))
    space = model.file["workspace"]
    target, drives = np.zeros((count, 6)), np.zeros((count, len(model.drive_names)))
    wanted = model.file.get("commanded", model.file["degrees_of_freedom"])
    for v in range(count):
        for k, c in enumerate(("x", "y", "z", "rx", "ry", "rz")):
            low, high = space.get(f"{c}_{'rad' if c[0] == 'r' else 'm'}", (0.0, 0.0))
            half = 0.5 * REACH * (high - low) if c in wanted else 0.0
            target[v, k] = 0.5 * (low + high) + half * rng.uniform(-1.0, 1.0)
        turn = quaternion(target[v, 3:].tolist())
        lever = Pose([0.0] * 3, turn).place(model.file["platform"]["tool_point_m"])
        target[v, :3] -= np.array(lever)
        drives[v] = np.round(model.nominal_drives(Pose(target[v, :3].tolist(), turn)), 8)
    loads = len(model.file.get("load_cases", [{}]))
    blocks = (0, 1, 0) if number % 2 and loads > 1 else (0, 1) if loads > 1 else (0,)
    payload = np.array([blocks[v * len(blocks) // count] for v in range(count)])
    rows: list[tuple[int, int, float, float, int]] = []
    t, check = 3600.0, -1
    moving = [i for i, smr in enumerate(machine.smrs) if smr.on != "floor"]
    floor = [i for i, smr in enumerate(machine.smrs) if smr.on == "floor"]
    for v in range(count + 1):
        if v % NEST_EVERY == 0 or v == count or payload[v] != payload[v - 1]:
            check += 1
            for i in floor:
                t += SECONDS_A_READING + NEST_SAMPLES
                rows.append((-1, i, t, NEST_SAMPLES, check))
        if v == count:
            break
        t += SECONDS_A_VISIT
        for i in moving:
            t += SECONDS_A_READING
            rows.append((v, i, t, 1.0, check))
    visit, smr, t_s, samples, checks = (np.array(column) for column in zip(*rows, strict=True))
    side = rng.choice([-1.0, 1.0], drives.shape)
    return Design(target, drives, payload, side, visit, smr, t_s, samples, checks)


@dataclass(frozen=True)
class Circumstances:
    """As those of the planar machine: what differs between campaigns without being a change of the machine."""

    seed: int
    station: int
    design: int
    shop_c: float = 0.0


class SpatialCampaign:
    """A campaign on a machine of a seed under some circumstances."""

    def __init__(
        self, name: str, machine_seed: int, at: Circumstances, levels: DisturbanceLevels, change: Change
    ) -> None:
        self.model, self.machine = machine_of(name)
        self.at, self.levels, self.change = at, levels, change
        self.design = design(name, at.design)
        rng = np.random.default_rng([23, machine_seed])
        self.theta = {name: self.model.tolerance(name) * float(rng.uniform(-1.0, 1.0)) for name in self.model.names}
        width = self.machine.file.tolerances.smr_position_m
        self.mounted = np.array([
            smr.position_m + rng.uniform(-1.0, 1.0, 3) * (3.0e-3 if smr.on == "floor" else width)
            for smr in self.machine.smrs
        ])  # fmt: skip
        self.expansion = {
            part: float(e["coefficient_per_k"] + e["u_per_k"] * rng.standard_normal())
            for part, e in self.model.file["expansion"].items()
        }
        cases = self.model.file.get("load_cases", [])
        self.masses = [
            (float(c["mass_kg"] + c["u_mass_kg"] * rng.standard_normal()), c["centre_of_mass_m"]) for c in cases
        ]
        self._station(np.random.default_rng([29, at.station]))
        self._shop(np.random.default_rng([31, at.seed]))

    def _station(self, rng: np.random.Generator) -> None:
        stand = np.array(STANDS_M[self.at.station % len(STANDS_M)])
        self.stated_m, self.heading_rad = stand, float(rng.uniform(-0.3, 0.3))
        stand = stand + rng.uniform(-0.01, 0.01, 3)
        level = rotation(np.array([*rng.uniform(-2e-5, 2e-5, 2), 0.0]))
        turn = rotation(np.array([0.0, 0.0, self.heading_rad + rng.uniform(-5e-3, 5e-3)]))
        forward = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        self.rotation = level @ turn @ forward
        self.translation_m = -self.rotation @ stand
        self.range_error = RANGE_CONSTANT_M * rng.standard_normal(), 1.0 + RANGE_SCALE * rng.standard_normal()

    def _shop(self, rng: np.random.Generator) -> None:
        t = self.design.t_s - self.design.t_s[0]
        hours = np.sqrt(np.diff(t, prepend=t[0]) / 3600.0)
        # Half of the drift's variance turns the frame, half shifts it, at three metres.
        scale = self.levels.drift_m / np.sqrt(2.0) * np.array([1 / 3.0] * 3 + [1.0] * 3)
        self.walk = np.cumsum(rng.standard_normal((len(t), 6)) * hours[:, None], axis=0) * scale
        self.part_c = {}
        for sensor in PART_OF:
            phase, period = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(3600.0, 14400.0)
            wave = 0.05 * np.sin(2.0 * np.pi * t / period + phase)
            self.part_c[sensor] = rng.uniform(20.5, 23.0) + self.at.shop_c + wave
        self.sensor_c = {s: c + 0.005 * rng.standard_normal() for s, c in self.part_c.items()}
        self.wander = {}
        struts = [s["name"] for s in self.model.file["struts"]]
        for part in (*struts, *self.model.drive_names):
            phase, period = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(1500.0, 9000.0)
            wave = np.sin(2.0 * np.pi * t / period + phase)
            self.wander[part] = self.levels.temperature_k * np.sqrt(2.0) * wave
        self.loops = self.levels.reversal_m * rng.standard_normal(len(self.model.drive_names))
        self.noise = rng.standard_t(5.0, (len(t), 3)) * np.sqrt(3.0 / 5.0)

    @property
    def platform(self) -> Array:
        """Which readings (r,) are of a reflector on the platform."""
        return np.array([smr.on == "platform" for smr in self.machine.smrs])[self.design.smr]

    def places(self, change: Change, *, disturbed: bool) -> Array:
        """Where the reflectors of the readings (r, 3) are, machine's frame."""
        model, plan, theta = self.model, self.design, dict[str, Any](self.theta)
        q = plan.drives[plan.at].copy()
        if disturbed:
            q += self.loops * plan.side[plan.at]
            for s in model.file["struts"]:
                grown = self.expansion["struts"] * s["length_m"] * self.wander[s["name"]]
                theta[f"strut_length.{s['name']}"] = theta[f"strut_length.{s['name']}"] + grown
            for a, name in enumerate(model.drive_names):
                q[:, a] += self.expansion["drives"] * q[:, a] * self.wander[name]
        for a, curve in change.travel.items():
            q[:, a] += curve(plan.drives[plan.at][:, a])
        mounted = self._changed(theta, change)
        reference_c = float(model.file["reference_temperature_c"])
        growth = {
            part: 1.0 + self.expansion[part] * (self.part_c[sensor] - reference_c) for sensor, part in PART_OF.items()
        }
        mass = np.array([m for m, _ in self.masses] or [0.0])[plan.payload[plan.at]]
        centre = np.array([c for _, c in self.masses] or [[0.0] * 3])[plan.payload[plan.at]]
        case = Case(list(q.T), [model.moving, (mass, list(centre.T))], growth=growth)
        target = plan.target_m[plan.at]
        start = Pose(list(target[:, :3].T), list(np.array([quaternion(r) for r in target[:, 3:].tolist()]).T))
        pose = model.rest(theta, case, start, 5)
        missing = float(np.max(np.abs(model.unrest(theta, case, pose))))
        if not missing < REST:
            raise ArithmeticError(f"the reference model is {missing:.1e} from rest")
        out = np.empty((len(q), 3))
        for i, smr in enumerate(self.machine.smrs):
            rows = plan.smr == i
            if smr.on == "floor":
                out[rows] = mounted[i]
            elif smr.on == "platform":
                out[rows] = np.array(pose.place([x * growth["platform"] for x in mounted[i]])).T[rows]
            else:
                carried = model.carried_point(theta, case, model.drive_names[smr.drive], list(mounted[i]))
                out[rows] = np.array(carried).T[rows]
        return out

    def _changed(self, theta: dict[str, Any], change: Change) -> Array:
        """The reflectors' places (k, 3) on their parts; the parameters of the struts are changed in place."""
        struts = [s["name"] for s in self.model.file["struts"]]
        mounted = self.mounted.copy()

        def add(kind: str, name: str, shift: tuple[float, float, float]) -> None:
            for c, x in zip("xyz", shift, strict=True):
                theta[f"{kind}.{name}.{c}"] = theta[f"{kind}.{name}.{c}"] + x

        for i, x in change.length_m.items():
            theta[f"strut_length.{struts[i]}"] = theta[f"strut_length.{struts[i]}"] + x
        for i, x in change.ln_stiffness.items():
            theta[f"ln_stiffness.{struts[i]}"] = theta[f"ln_stiffness.{struts[i]}"] + x
        for kind, of in (("platform_joint", change.platform_joint_m), ("base_joint", change.base_joint_m)):
            for i, shift in of.items():
                add(kind, struts[i], shift)
        self._move_columns(theta, change, mounted, add)
        for i, shift in change.smr_m.items():
            mounted[i] += np.array(shift)
        return mounted

    def _move_columns(self, theta: dict[str, Any], change: Change, mounted: Array, add: Callable[..., None]) -> None:
        """What guides the sliders, with the reflectors on these."""
        for a, shift in change.column_shift_m.items():
            for s in self.model.file["struts"]:
                if s.get("drive") == self.model.drive_names[a]:
                    add("base_joint", s["name"], shift)
            for i, smr in enumerate(self.machine.smrs):
                if smr.on == "slider" and smr.drive == a:
                    mounted[i] += np.array(shift)
        for a, turn in change.column_tilt_rad.items():
            for name, about in self.model.tilts.items():
                kind, drive, _ = name.split(".")
                if kind == "axis_tilt" and drive == self.model.drive_names[a]:
                    theta[name] = theta[name] + float(np.dot(about, turn))

    @cached_property
    def places_m(self) -> Array:
        """Where the readings (r, 3) are in the machine's frame, nothing changed."""
        return self.places(Change(), disturbed=False)

    def shifted_m(self, change: Change) -> Array:
        """Shift (r, 3) of the noise-free readings by a change, in the machine's axes."""
        return self.places(change, disturbed=False) - self.places_m

    @cached_property
    def weight(self) -> Array:
        """Square roots of the inverse covariances (r, 3, 3) of the readings, machine's axes."""
        seen = self.places_m @ self.rotation.T + self.translation_m
        distance = np.linalg.norm(seen, axis=1)
        sight = seen / distance[:, None]
        along = np.einsum("ni,nj->nij", sight, sight)
        across = np.eye(3) - along
        each = along / RANGE_M + across / (ANGLE_RAD * distance)[:, None, None]
        turned = np.einsum("ji,njk,kl->nil", self.rotation, each, self.rotation)
        return np.asarray(turned * np.sqrt(self.design.samples)[:, None, None])

    def recording(self, name: str) -> Recording:
        """What the comparison is given."""
        plan = self.design
        places = self.places(self.change, disturbed=True) @ self.rotation.T + self.translation_m
        places = places + np.cross(self.walk[:, :3], places) + self.walk[:, 3:]
        hz, v, distance = _polar(places)
        noise = self.noise / np.sqrt(plan.samples)[:, None]
        v = v + ANGLE_RAD * noise[:, 1]
        hz = hz + ANGLE_RAD * noise[:, 0] / np.sin(v)
        distance = distance * self.range_error[1] + self.range_error[0] + RANGE_M * noise[:, 2]
        return Recording(self._header(name), self.machine, self._columns(hz, v, distance))

    def _columns(self, hz: Array, v: Array, distance: Array) -> dict[str, Any]:
        plan, machine, n = self.design, self.machine, len(hz)
        sight = np.stack([np.sin(v) * np.sin(hz), np.sin(v) * np.cos(hz), np.cos(v)], axis=1)
        point = distance[:, None] * sight
        along = np.einsum("ni,nj->nij", sight, sight)
        covariance = along * RANGE_M**2 + (np.eye(3) - along) * ((ANGLE_RAD * distance) ** 2)[:, None, None]
        covariance = covariance / plan.samples[:, None, None]
        columns: dict[str, Any] = {name: np.zeros(n) for name in column_names(machine.drive_names, tuple(PART_OF))}
        nest = plan.visit < 0
        columns |= {
            "uid": np.array([f"{i:06d}" for i in range(n)]),
            "phase": np.where(nest, "nests", "calibration"),
            "smr": np.array([smr.name for smr in machine.smrs])[plan.smr],
            "sequence": np.arange(n, dtype=np.float64),
            "visit": plan.visit.astype(np.float64), "pose": plan.visit.astype(np.float64),
            "nest_check": plan.check.astype(np.float64),
            "t_rig_s": plan.t_s.astype(np.float64), "t_host_s": plan.t_s.astype(np.float64),
            "hz_rad": hz, "v_rad": v, "slope_distance_m": distance,
            "x_m": point[:, 0], "y_m": point[:, 1], "z_m": point[:, 2],
            "station": np.ones(n), "face": np.ones(n), "samples": plan.samples.astype(np.float64),
            "air_temperature_c": np.full(n, 21.0), "pressure_hpa": np.full(n, 1000.0),
            "humidity_percent": np.full(n, 45.0), "speed_m_per_s": np.where(nest, 0.0, 0.25),
            "dwell_s": np.where(nest, 0.0, 2.0),
            "payload": plan.payload[plan.at].astype(np.float64),
            "payload_mass_kg": np.array([p.mass_kg for p in self._payloads()])[plan.payload[plan.at]],
        }  # fmt: skip
        for i in range(3):
            for j in range(i, 3):
                columns[f"cov_{'xyz'[i]}{'xyz'[j]}_m2"] = covariance[:, i, j]
        for k, c in enumerate(("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")):
            columns[f"target_{c}"] = plan.target_m[plan.at][:, k]
        for a, drive in enumerate(machine.drive_names):
            columns[f"{drive}_commanded_m"] = columns[f"{drive}_actual_m"] = plan.drives[plan.at][:, a]
            columns[f"{drive}_direction"] = np.where(nest, 0.0, plan.side[plan.at][:, a])
        return columns | {f"{sensor}_temperature_c": c for sensor, c in self.sensor_c.items()}

    def _payloads(self) -> list[Any]:
        cases: list[Any] = list(self.machine.load_cases)
        return cases

    def _header(self, name: str) -> RecordingFile:
        accuracy = {
            "angle_sd_rad": ANGLE_RAD, "range_sd_m": RANGE_M, "range_constant_u_m": RANGE_CONSTANT_M,
            "range_scale_u": RANGE_SCALE, "drift_rad_per_sqrt_h": 1e-9, "drift_of_level_rad_per_sqrt_h": 1e-9,
            "drift_m_per_sqrt_h": 1e-9,
        }  # fmt: skip
        payloads = [
            {"name": c["name"], "mass_kg": c["mass_kg"], "u_mass_kg": c["u_mass_kg"], "com_m": c["centre_of_mass_m"]}
            for c in self.model.file.get("load_cases", [])
        ]
        return RecordingFile.model_validate({
            "format": 1, "campaign": name, "rig": "thought-of", "created": "2026-01-01T00:00:00+00:00",
            "software": "reference model", "drives": list(self.machine.drive_names), "sensors": list(PART_OF),
            "nest_limit_m": 8.0e-5, "payloads": payloads or [{"name": "none", "mass_kg": 0.0}],
            "station": {
                "position_m": self.stated_m.tolist(), "heading_rad": self.heading_rad, "accuracy": accuracy,
            },
            "nuisance": {
                "drift_m": self.levels.drift_m, "reseat_m": self.levels.reseat_m,
                "reversal_m": self.levels.reversal_m, "temperature_k": self.levels.temperature_k,
            },
        })  # fmt: skip


def _polar(points: Array) -> tuple[Array, Array, Array]:
    distance = np.linalg.norm(points, axis=1)
    return np.arctan2(points[:, 0], points[:, 1]) % (2.0 * np.pi), np.arccos(points[:, 2] / distance), distance
