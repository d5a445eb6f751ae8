"""The planar equilibrium against the energy itself and against the golden poses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from mock_devices.machine_file import read_machine_file
from mock_devices.plant.structure import Member, NoEquilibrium, PlanarPose, Weight, energy_j, equilibrium
from mock_devices.plant.true_machine import TrueMachine, draw_machine
from mock_devices.settings import MockSettings

COLD = {"struts": 20.0, "columns": 20.0, "base": 20.0, "platform": 20.0}


def perturbed(machine_file, seed):
    rng = np.random.default_rng(seed)
    drives = rng.uniform(0.8, 1.4, 2)
    members = []
    for strut in machine_file.struts:
        errors = rng.uniform(-3e-4, 3e-4, 5)
        slider = strut.base_joint + complex(errors[0], drives[strut.drive] + errors[1])
        joint = strut.platform_joint + complex(errors[2], errors[3])
        members.append(Member(joint, slider, strut.length_m + errors[4], 1e8 * math.exp(rng.uniform(-0.3, 0.3))))
    weights = [Weight(150.0, -0.1j), Weight(400.0, 0.03 - 0.2j)]
    return members, weights


def independent_energy(values, members, weights):
    """V written with plain coordinates, in extended precision, for pose (x, y, rz) scaled to micrometres."""
    x, y, angle = (np.longdouble(v) for v in values)
    c, s = np.cos(angle), np.sin(angle)
    total = np.longdouble(0.0)
    for m in members:
        dx = x + c * m.platform_joint.real - s * m.platform_joint.imag - m.slider_joint.real
        dy = y + s * m.platform_joint.real + c * m.platform_joint.imag - m.slider_joint.imag
        total += 0.5 * m.stiffness_n_per_m * (np.sqrt(dx * dx + dy * dy) - m.length_m) ** 2
    for w in weights:
        total += w.mass_kg * np.longdouble(9.80665) * (y + s * w.centre.real + c * w.centre.imag)
    return total


def place(members, weights):
    sliders = [m.slider_joint - m.platform_joint for m in members]
    start = PlanarPose(complex(0.0, (sliders[0].imag + sliders[2].imag) / 2 - 1.118), 0.0)
    return equilibrium(members, weights, -9.80665j, start)


@pytest.mark.parametrize("seed", range(8))
def test_no_small_step_away_lowers_the_energy(machine_file, seed):
    members, weights = perturbed(machine_file, seed)
    rest = place(members, weights)
    at_rest = independent_energy((rest.p.real, rest.p.imag, rest.rz_rad), members, weights)
    directions = np.random.default_rng(seed).standard_normal((40, 3))
    for step in (1e-5, 1e-7):
        for d in directions / np.linalg.norm(directions, axis=1, keepdims=True):
            moved = (rest.p.real + step * d[0], rest.p.imag + step * d[1], rest.rz_rad + step * d[2])
            assert independent_energy(moved, members, weights) > at_rest


@pytest.mark.parametrize("seed", range(4))
def test_a_general_minimiser_finds_the_same_pose(machine_file, seed):
    members, weights = perturbed(machine_file, seed)
    rest = place(members, weights)
    start = np.array([rest.p.real + 2e-4, rest.p.imag - 3e-4, rest.rz_rad + 2e-4])

    def scaled(u):
        return float(independent_energy(start + u * 1e-4, members, weights))

    options = {"xatol": 1e-9, "fatol": 1e-13, "maxiter": 4000, "maxfev": 8000}
    optimum = minimize(scaled, np.zeros(3), method="Nelder-Mead", options=options)
    pose = start + optimum.x * 1e-4
    assert np.abs(pose - [rest.p.real, rest.p.imag, rest.rz_rad]).max() < 2e-8


@pytest.mark.parametrize("seed", range(4))
def test_the_gradient_in_extended_precision_vanishes_to_a_picometre(machine_file, seed):
    members, weights = perturbed(machine_file, seed)
    rest = place(members, weights)
    pose = np.array([rest.p.real, rest.p.imag, rest.rz_rad], dtype=np.longdouble)
    step = np.longdouble(1e-6)
    for axis in range(3):
        ahead, behind = pose.copy(), pose.copy()
        ahead[axis] += step
        behind[axis] -= step
        up, down = (independent_energy(p, members, weights) for p in (ahead, behind))
        middle = independent_energy(pose, members, weights)
        slope, curvature = (up - down) / (2 * step), (up - 2 * middle + down) / step**2
        assert curvature > 0.0
        assert abs(slope / curvature) < 1e-12 + 2e-11  # the cubic term of the difference itself is 1e-11


def test_energy_agrees_with_the_independent_one(machine_file):
    members, weights = perturbed(machine_file, 5)
    pose = PlanarPose(0.01 - 0.02j, 0.003)
    expected = float(independent_energy((0.01, -0.02, 0.003), members, weights))
    assert energy_j(pose, members, weights, -9.80665j) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("drives_m", "pose"),
    [
        ((1.118033988749895, 1.118033988749895), (0.0, 0.0, 0.0)),
        ((0.953834841531101, 1.651850583459577), (0.35, 0.30, 0.0)),
    ],
)
def test_golden_poses_of_the_nominal_machine_without_weight(machine_file, drives_m, pose):
    nominal = TrueMachine(machine_file, (1.0, 1.0), (Weight(-machine_file.moving_mass_kg, -0.1j),))
    result = nominal.pose(drives_m, 0, COLD)
    assert (result.p.real, result.p.imag, result.rz_rad) == pytest.approx(pose, abs=1e-12)


def test_gravity_sag_of_the_nominal_machine_is_some_fifteen_micrometres(machine_file):
    nominal = TrueMachine(machine_file, (1.0, 1.0), (Weight(0.0, 0j),))
    sag_m = nominal.pose((1.118033988749895, 1.118033988749895), 0, COLD).p.imag
    vertical_stiffness = 4 * 1e8 * (1.118033988749895 / 1.5) ** 2
    assert sag_m == pytest.approx(-150.0 * 9.80665 / vertical_stiffness, rel=0.05)


def test_drives_that_the_struts_cannot_reach_have_no_equilibrium(machine_path):
    machine = draw_machine(read_machine_file(machine_path), MockSettings())
    with pytest.raises(NoEquilibrium):
        machine.pose((0.0, 3.5), 0, COLD)
