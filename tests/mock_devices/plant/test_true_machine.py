"""The drawn machine: within tolerances, repeatable, expanding as docs/reference/machine.md says."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from mock_devices.plant.structure import PlanarPose, Weight
from mock_devices.plant.true_machine import TrueMachine, draw_machine
from mock_devices.settings import MockSettings, Payload

SEEDS = range(60)
WARM = {"struts": 22.0, "columns": 21.0, "base": 23.0, "platform": 24.0}


def test_errors_fill_the_tolerances_and_never_leave_them(machine_file):
    machines = [draw_machine(machine_file, MockSettings(seed=seed)) for seed in SEEDS]
    width = machine_file.tolerances
    lengths = [t.length_m - 1.5 for m in machines for t in m.file.struts]
    ln_k = [math.log(t.stiffness_n_per_m / 1e8) for m in machines for t in m.file.struts]
    tilts = [cmath.phase(s.axis / 1j) for m in machines for s in m.file.sliders]
    scales = [s - 1.0 for m in machines for s in m.scales]
    joints = [
        part
        for m in machines
        for true, nominal in zip(m.file.struts, machine_file.struts, strict=True)
        for d in (true.platform_joint - nominal.platform_joint, true.base_joint - nominal.base_joint)
        for part in (d.real, d.imag)
    ]
    for errors, half_width in (
        (lengths, width.strut_length_m),
        (ln_k, width.ln_stiffness),
        (tilts, width.axis_tilt_rad),
        (scales, width.drive_scale),
        (joints, width.platform_joint_m),
    ):
        relative = np.array(errors) / half_width
        assert np.abs(relative).max() <= 1.0 + 1e-9
        assert np.abs(relative).max() > 0.9
        assert relative.std() == pytest.approx(1.0 / math.sqrt(3.0), rel=0.2)


def test_one_seed_gives_one_machine_and_another_seed_another(machine_file):
    a, b, c = (draw_machine(machine_file, MockSettings(seed=s)) for s in (7, 7, 8))
    assert a == b
    assert a != c


def test_scale_zero_leaves_the_geometry_nominal(machine_file):
    machine = draw_machine(machine_file, MockSettings(error_scale=0.0))
    assert [t.length_m for t in machine.file.struts] == [1.5] * 4
    assert machine.file.sliders == machine_file.sliders
    assert machine.scales == (1.0, 1.0)


def test_the_nests_keep_their_certified_distance(machine_file):
    errors_um = []
    for seed in SEEDS:
        smrs = {s.name: np.array(s.position_m) for s in draw_machine(machine_file, MockSettings(seed=seed)).file.smrs}
        errors_um.append(1e6 * (np.linalg.norm(smrs["N2"] - smrs["N1"]) - 1.6))
        assert np.abs(smrs["N1"] - [-0.8, -1.1, 0.1]).max() <= 3e-3
        assert np.abs(smrs["N2"] - [0.8, -1.1, 0.1]).max() <= 10e-3
    assert np.std(errors_um) == pytest.approx(2.0, rel=0.35)
    assert np.abs(np.mean(errors_um)) < 1.0


def test_true_payloads_scatter_by_their_stated_uncertainty(machine_file):
    payload = Payload("plate", 200.0, (0.0, -0.2, 0.0), u_mass_kg=0.2, u_com_m=0.002)
    drawn = [draw_machine(machine_file, MockSettings(seed=s, payloads=(payload,))).payloads[0] for s in SEEDS]
    assert np.std([w.mass_kg for w in drawn]) == pytest.approx(0.2, rel=0.35)
    assert np.std([w.centre.imag for w in drawn]) == pytest.approx(0.002, rel=0.35)
    exact = draw_machine(machine_file, MockSettings(payloads=(Payload("none", 0.0),))).payloads[0]
    assert exact == Weight(0.0, 0j)


def test_parts_expand_by_their_own_sensor(machine_file):
    machine = TrueMachine(machine_file, (1.0, 1.0), (Weight(0.0, 0j),))
    pose = PlanarPose(0.1 + 0.2j, 0.0)
    places = dict(zip([s.name for s in machine_file.smrs], machine.smr_positions(pose, (1.0, 1.0), WARM), strict=True))
    platform, base, travel = 1.0 + 11.5e-6 * 4.0, 1.0 + 11.5e-6 * 3.0, 1.0 + 10.5e-6 * 1.0
    assert places["P1"] == pytest.approx((0.1 - 0.2 * platform, 0.2 - 0.12 * platform, 0.1 * platform), abs=1e-15)
    assert places["SL"] == pytest.approx((-1.2 * base, 1.0 * travel, 0.1 * base), abs=1e-15)
    assert places["N1"] == (-0.8, -1.1, 0.1)


def test_longer_struts_lower_the_platform(machine_file):
    machine = TrueMachine(machine_file, (1.0, 1.0), (Weight(0.0, 0j),))
    cold = dict.fromkeys(WARM, 20.0)
    q = (1.118033988749895, 1.118033988749895)
    lowered_m = machine.pose(q, 0, cold).p.imag - machine.pose(q, 0, {**cold, "struts": 21.0}).p.imag
    assert lowered_m == pytest.approx(1.5 * 11.5e-6 * 1.5 / 1.118, rel=0.01)  # dl / sin(strut angle)
