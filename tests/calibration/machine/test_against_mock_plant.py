"""`calibration` against the plant of the mock rig: two programs that share the machine file and nothing else.

The plant's true errors are handed over by name. Only here are both imported.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.equilibrium import Conditions, solve
from calibration.model.parameters import ParameterSet
from mock_devices.machine_file import read_machine_file
from mock_devices.plant.true_machine import TrueMachine, draw_machine
from mock_devices.settings import MockSettings

POSES = 60
SAME_REST = 1e-12


def errors_by_name(true: TrueMachine) -> dict[str, float]:
    """The plant's deviations from the nominal file, under the names of `calibration`."""
    nominal = read_machine_file(shipped_machine("planar4"))
    values: dict[str, float] = {}
    for before, after in zip(nominal.struts, true.file.struts, strict=True):
        values[f"strut_length.{before.name}"] = after.length_m - before.length_m
        values[f"ln_stiffness.{before.name}"] = math.log(after.stiffness_n_per_m / before.stiffness_n_per_m)
        for kind, shift in (
            ("platform_joint", after.platform_joint - before.platform_joint),
            ("base_joint", after.base_joint - before.base_joint),
        ):
            values |= {f"{kind}.{before.name}.x": shift.real, f"{kind}.{before.name}.y": shift.imag}
    for before, after, scale in zip(nominal.sliders, true.file.sliders, true.scales, strict=True):
        values[f"axis_tilt.{before.name}.rz"] = cmath.phase(after.axis / before.axis)
        values[f"drive_scale.{before.name}"] = scale - 1.0
    return values


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_plant_and_the_model_rest_in_the_same_place(seed):
    machine = load_machine(shipped_machine("planar4"))
    parameters = ParameterSet.of(machine)
    true = draw_machine(read_machine_file(shipped_machine("planar4")), MockSettings(seed=seed))
    errors = errors_by_name(true)
    assert set(errors) == set(parameters.names)
    geometry = parameters.geometry(np.array([errors[name] for name in parameters.names]))

    rng = np.random.default_rng(seed)
    drives = rng.uniform(0.9, 1.3, (POSES, 2))
    payload = rng.integers(0, len(true.payloads), POSES)
    temperatures = {name: rng.uniform(15.0, 30.0, POSES) for name in machine.sensors.values()}
    expected = np.empty((POSES, 3))
    tool = np.empty((POSES, 2))
    for i in range(POSES):
        here = {name: float(t[i]) for name, t in temperatures.items()}
        pose = true.pose(tuple(drives[i].tolist()), int(payload[i]), here)
        expected[i] = pose.p.real, pose.p.imag, pose.rz_rad
        tool[i] = true.tool_point(pose, here).real, true.tool_point(pose, here).imag

    weights = [true.payloads[number] for number in payload]
    at = Conditions(
        masses=(
            (np.full(POSES, machine.moving_mass_kg), np.tile(machine.centre_of_mass_m, (POSES, 1))),
            (np.array([w.mass_kg for w in weights]), np.array([[w.centre.real, w.centre.imag, 0.0] for w in weights])),
        ),
        factors={
            part: 1.0 + e.coefficient_per_k * (temperatures[e.sensor] - true.file.reference_temperature_c)
            for part, e in true.file.expansion.items()
        },
    )
    rest = solve(machine, geometry, drives, at)
    assert rest.converged.all()
    apart = np.abs(rest.coordinates()[:, [0, 1, 5]] - expected).max(axis=0)
    print(f"\nseed {seed}: {apart[0]:.1e} m, {apart[1]:.1e} m, {apart[2]:.1e} rad")
    assert apart.max() < SAME_REST
    lever = at.factors["platform"][:, None] * (rest.rotation @ machine.tool_point_m)
    assert np.abs((rest.position_m + lever)[:, :2] - tool).max() < SAME_REST
    assert len(set(payload.tolist())) == len(true.payloads)  # every payload was among them
