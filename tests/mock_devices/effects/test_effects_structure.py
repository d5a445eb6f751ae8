"""Elastic effects against the plant's other path: the scalar equilibrium, and its energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.machine_file import read_machine_file
from mock_devices.plant.affected_machine import AffectedMachine, motion_states
from mock_devices.plant.motion_history import MotionHistory
from mock_devices.plant.optics import StationView
from mock_devices.plant.structure import Weight, energy_j, equilibrium
from mock_devices.plant.true_machine import draw_machine
from mock_devices.settings import MockSettings
from tests.mock_devices.effects_bench import FILE, MACHINE, STATION_M, Temperatures

SETTINGS = MockSettings(seed=11)
TRUE = draw_machine(read_machine_file(MACHINE), SETTINGS)
DRIVES = np.array([(1.1, 1.15), (0.9, 1.3), (1.45, 1.2), (0.7, 0.75)])
COLD = dict.fromkeys(("struts", "columns", "base", "platform"), 20.0)


def at_rest(*choices, payload=0):
    """Poses and structure of DRIVES at 20 degrees with effects."""
    site = Site(FILE, STATION_M)
    affected = AffectedMachine(TRUE, StationView(SETTINGS), [make(c, site, 1) for c in choices])
    n = len(DRIVES)
    mass = np.full(n, SETTINGS.payloads[payload].mass_kg)
    m = motion_states(
        MotionHistory((1.1, 1.1), affected.effects),
        np.zeros(n),
        DRIVES,
        0.0 * DRIVES,
        mass,
        np.zeros(n),
        Temperatures(),
    )
    equilibria, structure = affected.equilibria(m, affected.deviation(m), np.full(n, payload))
    return equilibria, structure


def scalar(machine=TRUE, payload=0):
    poses = [machine.pose(tuple(q), payload, COLD) for q in DRIVES]
    return np.array([pose.p for pose in poses]), np.array([pose.rz_rad for pose in poses])


def agree(equilibria, expected):
    p, rz = expected
    assert np.abs(equilibria.p - p).max() < 2e-12
    assert np.abs(equilibria.rz_rad - rz).max() < 2e-12


def with_strut(index, **changes):
    struts = list(TRUE.file.struts)
    struts[index] = replace(struts[index], **changes)
    return replace(TRUE, file=replace(TRUE.file, struts=tuple(struts)))


@pytest.mark.parametrize("payload", [0, 2])
def test_without_effects_both_paths_agree(payload):
    agree(at_rest(payload=payload)[0], scalar(payload=payload))


def test_a_softer_strut():
    equilibria, _ = at_rest(EffectChoice("link_stiffness", 0.7, "right_lower"), payload=2)
    changed = with_strut(3, stiffness_n_per_m=TRUE.file.struts[3].stiffness_n_per_m * np.exp(-0.7))
    agree(equilibria, scalar(changed, payload=2))


def test_a_joint_beside_its_place():
    equilibria, _ = at_rest(EffectChoice("joint_spacing", 5e-5, "left_lower", "platform"))
    axis = FILE.sliders[0].axis
    agree(equilibria, scalar(with_strut(1, platform_joint=TRUE.file.struts[1].platform_joint + 5e-5 * axis)))


def test_half_of_a_struts_weight_hangs_at_its_platform_joint():
    equilibria, _ = at_rest(EffectChoice("link_self_weight", 12.0, "left_upper"))
    joint = FILE.struts[0].platform_joint
    file = TRUE.file
    for i, q in enumerate(DRIVES):
        members = [TRUE._member(k, tuple(q), TRUE._growth(COLD)) for k in range(4)]
        weights = [Weight(file.moving_mass_kg, file.centre_of_mass), TRUE.payloads[0], Weight(6.0, joint)]
        pose = equilibrium(members, weights, file.gravity, TRUE._start(members))
        assert abs(equilibria.p[i] - pose.p) < 2e-12


def test_guides_turn_the_joints_of_their_slider_about_its_middle():
    yaw = 3e-5
    equilibria, _ = at_rest(EffectChoice("guide_angular", yaw, "left", "bow"))
    x = (DRIVES[:, 0] - 1.01) / 0.69
    for i in range(len(DRIVES)):
        angle = yaw * (2.0 * x[i] ** 2 - 1.0)
        middle = np.mean([s.base_joint for s in TRUE.file.struts[:2]])
        turned = [middle + (s.base_joint - middle) * np.exp(1j * angle) for s in TRUE.file.struts[:2]]
        struts = tuple(replace(s, base_joint=turned[k]) if k < 2 else s for k, s in enumerate(TRUE.file.struts))
        pose = replace(TRUE, file=replace(TRUE.file, struts=struts)).pose(tuple(DRIVES[i]), 0, COLD)
        assert abs(equilibria.p[i] - pose.p) < 2e-12


@pytest.mark.parametrize("variant", ["lateral", "cantilever", "yaw", "screw_length"])
def test_a_compliant_carriage_rests_where_the_whole_energy_is_least(variant):
    equilibria, structure = at_rest(EffectChoice("column_compliance", 2e-8, "right", variant), payload=2)
    stiff = 1.0 / np.maximum(structure.compliance, 1e-13)
    weights = [Weight(FILE.moving_mass_kg, FILE.centre_of_mass), TRUE.payloads[2]]

    def energy(i, z):
        members = []
        for k in range(4):
            member = TRUE._member(k, tuple(DRIVES[i]), TRUE._growth(COLD))
            if k >= 2:  # struts of the right drive
                centre = structure.centre[i, 1]
                arm = (member.slider_joint - centre) * np.exp(1j * z[5])
                member = replace(member, slider_joint=centre + arm + structure.axis[1] * complex(z[3], z[4]))
            members.append(member)
        pose = replace(scalar_pose, p=complex(z[0], z[1]), rz_rad=z[2])
        return energy_j(pose, members, weights, FILE.gravity) + 0.5 * float(stiff[i, 1] @ z[3:] ** 2)

    scalar_pose = TRUE.pose(tuple(DRIVES[0]), 2, COLD)
    for i in range(len(DRIVES)):
        z = np.array([equilibria.p[i].real, equilibria.p[i].imag, equilibria.rz_rad[i], *equilibria.carriage[i, 1]])
        for k in range(6):
            if k >= 3 and structure.compliance[i, 1, k - 3] == 0.0:
                continue
            h = np.zeros(6)
            h[k] = 1e-7
            slope = (energy(i, z + h) - energy(i, z - h)) / 2e-7
            curvature = (energy(i, z + h) - 2.0 * energy(i, z) + energy(i, z - h)) / 1e-14
            assert abs(slope) < 1e-10 * curvature + 0.02
    assert np.abs(equilibria.carriage[:, 1]).max() > 1e-7


def test_a_strut_with_clearance_gives_no_force_until_its_play_is_used_up():
    c = 2e-5
    equilibria, structure = at_rest(EffectChoice("joint_clearance", c, "left_upper"), payload=2)
    joint = equilibria.p + np.exp(1j * equilibria.rz_rad) * structure.platform_joint[:, 0]
    elongation = np.abs(joint - structure.base_joint[:, 0]) - structure.length_m[:, 0]
    k = structure.stiffness[:, 0]
    expected = k * np.sign(elongation) * np.maximum(np.abs(elongation) - c, 0.0)
    assert equilibria.force_n[:, 0] == pytest.approx(expected, abs=0.15 * c * k[0])  # the edge is rounded by a tenth
    far = np.abs(np.abs(elongation) - c) > 6e-6
    assert np.any(far)
    assert equilibria.force_n[far, 0] == pytest.approx(expected[far], abs=20.0)


def test_a_hardening_column_gives_less_under_more():
    def bend(payload, variant):
        equilibria, _ = at_rest(EffectChoice("column_compliance", 1e-7, "left", variant), payload=payload)
        return np.abs(equilibria.carriage[:, 0, 1])

    assert np.all(bend(2, "hardening") < bend(2, "lateral"))


def test_a_yielding_strut_is_softer_when_stretched():
    none, _ = at_rest(payload=2)
    soft, _ = at_rest(EffectChoice("link_stiffness", 1.0, "left_upper", "yielding"), payload=2)
    assert np.all(np.abs(soft.force_n[:, 0]) < np.abs(none.force_n[:, 0]))


@pytest.mark.parametrize("variant", ["dead_zone", "soft_contact", "one_sided", "load_dependent"])
@pytest.mark.parametrize("clearance_m", [1e-6, 3e-5, 6e-5, 2e-4])
def test_kinks_in_a_strut_s_law_do_not_keep_the_structure_from_its_rest(variant, clearance_m):
    for place in ("left_upper", "right_lower"):
        equilibria, structure = at_rest(EffectChoice("joint_clearance", clearance_m, place, variant), payload=2)
        joint = equilibria.p[:, None] + np.exp(1j * equilibria.rz_rad)[:, None] * structure.platform_joint
        way = joint - structure.base_joint
        pull = -(equilibria.force_n * way / np.abs(way)).sum(axis=1)
        weight = sum(load for _, load in structure.loads)
        assert np.abs(pull + weight).max() < 1e-2
