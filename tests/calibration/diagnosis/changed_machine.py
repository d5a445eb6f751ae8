"""A machine that a test really changes and solves again, to hold derivatives against."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from calibration.base.frame import Frame, station_frame
from calibration.base.rotation import rotation_matrix
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.observed_model import ObservedModel
from calibration.effects.context import ArrivalHistory, ReadingContext
from calibration.machine import equilibrium
from calibration.machine.description import load_machine, shipped_machine
from calibration.model.model import Model, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits
from tests.calibration.diagnosis.campaigns import Rest, drawn_poses

VISITS = 5
STEP = 1e-6
SLIDERS = ("planar4", "delta8", "hexaglide", "prs3")
MACHINES = (*SLIDERS, "stewart6", "rrr4")


@dataclass
class Case:
    """A machine with errors, warm, loaded, somewhat turned in the station's frame; every reflector at every visit."""

    observed: ObservedModel
    channels: Channels
    rest: Rest

    def places(self, rest: Rest | None = None, mounted_m: np.ndarray | None = None) -> np.ndarray:
        mounted_m = self.observed.mounted_m if mounted_m is None else mounted_m
        return (rest or self.rest).places_m(mounted_m).reshape(-1, 3)

    def check(self, name: str, change, rel: float = 1e-4) -> None:
        """A channel against central differences of places (n, 3) in the machine's frame, by `change(step)`."""
        expected = (change(STEP) - change(-STEP)) / (2.0 * STEP)
        got = self.channels.shift_m(name)
        assert np.abs(expected).max() > 1e-6
        np.testing.assert_allclose(got, expected, atol=rel * max(np.abs(expected).max(), 1e-2), err_msg=name)


def moments_at(drives, payload_kg) -> ReadingContext:
    n = len(drives)
    zero = np.zeros(n)
    return ReadingContext(
        history=ArrivalHistory(np.zeros(1), drives[:1]), t_s=zero, arrival=zero.astype(np.intp), drives=drives,
        direction=0.0 * drives, velocity_m_per_s=0.0 * drives, torque=0.0 * drives, speed_m_per_s=zero, dwell_s=zero,
        payload_kg=payload_kg, payload_com_m=np.zeros((n, 3)), exchanges=zero,
        air_refractivity=zero, temperatures_c={}, start_s=0.0,
    )  # fmt: skip


@cache
def changed_machine(name: str) -> Case:
    """Kept, as several files of tests change it."""
    machine, rng = load_machine(shipped_machine(name)), np.random.default_rng(7)
    parameters = ParameterSet.of(machine)
    theta = np.array([p.sigma for p in parameters.parameters]) * rng.standard_normal(len(parameters))
    target, drives = drawn_poses(machine, rng, VISITS)
    warm = {s: machine.reference_temperature_c + np.linspace(1.0, 4.0, VISITS) for s in machine.sensors.values()}
    load, com = np.full(VISITS, 50.0), np.zeros((VISITS, 3))
    poses = Model(parameters, SystematicUncertainties()).predict(theta, Visits(drives, target, load, com, warm))
    assert np.all(poses.equilibrium.converged)
    at = equilibrium.make_conditions(machine, VISITS, warm, load, com)
    rest = Rest.of(machine, parameters.geometry(theta), drives, at, target)
    smrs = len(machine.smrs)
    mounted = np.array([s.position_m for s in machine.smrs]) + 1e-3
    start = station_frame((0.3, -0.2, 4.0), 0.0)
    frame = Frame(rotation_matrix(np.array([0.02, -0.01, 0.3])) @ start.rotation, start.translation_m)
    smr, visit = np.tile(np.arange(smrs), VISITS), np.repeat(np.arange(VISITS), smrs)
    visit = np.where(np.array([s.on == "floor" for s in machine.smrs])[smr], -1, visit)
    position = frame.to_station(rest.places_m(mounted).reshape(-1, 3))
    context = moments_at(drives[np.maximum(visit, 0)], np.full(len(smr), 50.0))
    observed = ObservedModel(
        machine=machine, context=context, smr=smr, visit=visit, poses=poses, frame=frame, mounted_m=mounted,
        position_m=position,
    )  # fmt: skip
    return Case(observed, Channels(observed), rest)
