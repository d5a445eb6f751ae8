"""What a channel does to every reflector, against a machine that is really changed and solved again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.rotation import rotation_matrix
from calibration.diagnosis.channels import AXES, Channels, unit_of_channel
from calibration.diagnosis.effect_inputs import inputs_of_readings
from calibration.instruments.station_geometry import points_to_polar, polar_to_points
from calibration.machine import equilibrium
from calibration.machine.description import COORDINATES, PARTS
from calibration.recording.header import KnownTable
from tests.calibration.diagnosis.changed_machine import MACHINES, STEP, VISITS, Case, changed_machine


@pytest.fixture(params=MACHINES)
def case(request) -> Case:
    return changed_machine(request.param)


def test_the_model_is_at_the_same_poses(case):
    on_machine = case.observed.visit >= 0
    places = case.places()
    assert (
        case.observed.position_m - case.observed.frame.translation_m
    ) @ case.observed.frame.rotation == pytest.approx(places)
    assert case.observed.poses.equilibrium.position_m == pytest.approx(case.rest.rest.position_m, abs=1e-10)
    assert np.any(on_machine)


def test_travel(case):
    machine = case.observed.machine
    for a, drive in enumerate(machine.drive_names):
        carrier = equilibrium.carriers_of(machine, case.rest.geometry, case.rest.drives, case.rest.at)[a]
        per_unit = carrier.travel / case.rest.drives[:, a]

        def change(h, a=a, per_unit=per_unit):
            moved = case.rest.drives.copy()
            moved[:, a] += h / per_unit
            return case.places(case.rest.again(drives=moved))

        case.check(f"travel.{drive}", change)


def test_length(case):
    for i, strut in enumerate(case.observed.machine.strut_names):

        def change(h, i=i):
            length = case.rest.geometry.length_m.copy()
            length[i] += h
            return case.places(case.rest.again(replace(case.rest.geometry, length_m=length)))

        case.check(f"length.{strut}", change)


def on_slider(case: Case, drive: int, moved) -> np.ndarray:
    """Places when all that a slider carries, joints and reflectors, goes from a point (k, 3) to moved(point)."""
    machine, geometry = case.observed.machine, case.rest.geometry
    struts = np.flatnonzero(machine.strut_drive == drive)
    middle = geometry.base_joint_m[struts].mean(axis=0)
    joints, mounted = geometry.base_joint_m.copy(), case.observed.mounted_m.copy()
    joints[struts] = moved(joints[struts], middle)
    own = [i for i, s in enumerate(machine.smrs) if s.on == "slider" and s.drive == drive]
    mounted[own] = moved(mounted[own], middle)
    return case.places(case.rest.again(replace(geometry, base_joint_m=joints)), mounted)


def test_sideways_and_turn(case):
    machine, channels = case.observed.machine, case.channels
    if machine.drive_kinds[0] != "slider":
        assert not any(name.startswith(("sideways.", "turn.")) for name in channels.names)
        return
    for a in range(len(machine.drive_names)):
        along = int(np.argmax(np.abs(machine.nominal.axis[a])))
        expected = {AXES[k] for k in range(2 if machine.planar else 3) if k != along}
        assert {name[-1] for name in channels.sideways_channels(a)} == expected
        for name in channels.sideways_channels(a):
            unit = np.eye(3)[AXES.index(name[-1])]
            case.check(name, lambda h, a=a, unit=unit: on_slider(case, a, lambda p, _: p + h * unit))
        for name in channels.rotation_channels(a):
            axis = np.eye(3)[AXES.index(name[-1])]
            if not machine.planar and np.sum(machine.strut_drive == a) == 1 and "slider" not in {
                s.on for s in machine.smrs if s.drive == a
            }:  # fmt: skip
                continue  # one joint without a reflector: a turn about it moves nothing

            def change(h, a=a, axis=axis):
                turn = rotation_matrix(h * axis)
                return on_slider(case, a, lambda p, middle: middle + (p - middle) @ turn.T)

            case.check(name, change)


def test_pose(case):
    machine, rest = case.observed.machine, case.rest.rest
    platform = np.array([s.on == "platform" for s in machine.smrs])
    for name in case.channels.pose_channels():
        k = COORDINATES.index(name.split(".")[1])

        def change(h, k=k):
            out = case.rest.places_m(case.observed.mounted_m)
            step = np.zeros(6)
            step[k] = h
            lever = out[:, platform] - rest.position_m[:, None]
            out[:, platform] = rest.position_m[:, None] + step[:3] + lever @ rotation_matrix(step[3:]).T
            return out.reshape(-1, 3)

        case.check(name, change, rel=1e-3)


def test_smr(case):
    for i, smr in enumerate(case.observed.machine.smrs):
        if smr.on != "platform":
            continue
        for name in case.channels.reflector_channels(i):

            def change(h, i=i, name=name):
                mounted = case.observed.mounted_m.copy()
                mounted[i, AXES.index(name[-1])] += h
                return case.places(mounted_m=mounted)

            case.check(name, change, rel=1e-3)


def test_floor(case):
    """The whole machine moves as a rigid body about its origin; the nests stay."""
    places = case.places()
    for name in case.channels.floor_channels():
        step = np.eye(6)[COORDINATES.index(name.split(".")[1])]

        def change(h, step=step):
            moved = places @ rotation_matrix(h * step[3:]).T + h * step[:3]
            return np.where(case.observed.visit[:, None] < 0, places, moved)

        case.check(name, change)


def station_shift(case: Case, name: str) -> np.ndarray:
    return case.channels.shift_m(name) @ case.observed.frame.rotation.T


def test_station(case):
    """What the station reads when its frame is turned about its own centre, or shifted."""
    p = case.observed.position_m
    for k, name in enumerate(case.channels.station_channels()):
        step = np.eye(6)[k]
        read = [p @ rotation_matrix(h * step[:3]).T + h * step[3:] for h in (STEP, -STEP)]
        np.testing.assert_allclose(station_shift(case, name), (read[0] - read[1]) / (2.0 * STEP), atol=1e-6)


def test_light(case):
    hz, v, distance = points_to_polar(case.observed.position_m)
    for name, turned in (
        ("light.hz", lambda h: polar_to_points(hz + h * distance, v, distance)),
        ("light.v", lambda h: polar_to_points(hz, v + h * distance, distance)),
        ("light.range", lambda h: polar_to_points(hz, v, distance * (1.0 + h))),
    ):
        expected = (turned(STEP) - turned(-STEP)) / (2.0 * STEP)
        np.testing.assert_allclose(station_shift(case, name), expected, atol=1e-6 * np.abs(expected).max())


def test_growth_of_a_part(case):
    for part in PARTS:

        def change(h, part=part):
            at = case.rest.at
            at = replace(at, factors={**at.factors, part: at.factors[part] + h})
            return case.places(replace(case.rest, at=at).again())

        case.check(f"growth.{part}", change)


def test_payload(case):
    """Ten kilograms and ten millimetres: a payload moves the platform by micrometres."""
    machine, at = case.observed.machine, case.rest.at
    (moving, (mass, com)), steps = at.masses, {"mass": 10.0, "x": 1e-2, "y": 1e-2, "z": 1e-2}
    names = [name for name in case.channels.names if name.startswith("payload.")]
    assert names == [f"payload.{of}" for of in ("mass", *("xy" if machine.planar else "xyz"))]
    for name in names:
        kind = name.split(".")[1]
        step = steps[kind]

        def change(h, of=kind):
            changed = (mass + h, com) if of == "mass" else (mass, com + h * np.eye(3)[AXES.index(of)])
            return case.places(replace(case.rest, at=replace(at, masses=(moving, changed))).again())

        expected = (change(step) - change(-step)) / (2.0 * step)
        np.testing.assert_allclose(
            case.channels.shift_m(name), expected, atol=1e-3 * np.abs(expected).max() + 1e-12, err_msg=name
        )


def test_force(case):
    """A hundred newtons at the platform's origin, a couple of a hundred newton metres about it: the axes stay."""
    at, turn = case.rest.at, case.rest.rest.rotation
    assert case.channels.force_channels() == tuple(f"force.{COORDINATES[k]}" for k in case.observed.machine.dof)
    for name in case.channels.force_channels():
        coordinate = COORDINATES.index(name.split(".")[1])
        axis = np.eye(3)[coordinate % 3]

        def change(h, coordinate=coordinate, axis=axis):
            along = np.tile(h * axis, (VISITS, 1))
            if coordinate < 3:
                forces = [(along, np.zeros((VISITS, 3)))]
            else:  # half a metre to either side, seen in the platform's own frame
                arm = np.roll(axis, 1)
                lever = np.einsum("nij,i->nj", turn, 0.5 * arm)
                couple = np.tile(h * np.cross(axis, arm), (VISITS, 1))
                forces = [(couple, lever), (-couple, -lever)]
            return case.places(replace(case.rest, at=replace(at, forces=(*at.forces, *forces))).again())

        expected = (change(100.0) - change(-100.0)) / 200.0
        got = case.channels.shift_m(name)
        np.testing.assert_allclose(got, expected, atol=1e-3 * np.abs(expected).max() + 1e-13, err_msg=name)


def test_scale_and_tables(case):
    """By the travel's own channel, which is held against the machine above; corrections at the commands of a visit."""
    machine, visit = case.observed.machine, np.maximum(case.observed.visit, 0)
    nodes, partner = (0.0, 2.0), machine.drive_names[1]
    tables = tuple(
        KnownTable(
            generation=3, drive=drive, own_m=nodes, partner=partner if a == 0 else None,
            partner_m=nodes if a == 0 else None,
            corrections_m=((0.0, 1e-4), (2e-4, 5e-4)) if a == 0 else ((0.0,), (3e-4,)),
        )
        for a, drive in enumerate(machine.drive_names[:2])
    )  # fmt: skip
    channels = Channels(replace(case.observed, context=replace(case.observed.context, known_tables=tables)))
    assert [name for name in channels.names if name.startswith("table.")] == ["table.3"]
    own, other = (np.clip(case.rest.drives[visit, a] / 2.0, 0.0, 1.0) for a in (0, 1))
    first = 1e-4 * (1.0 - own) * other + own * (2e-4 * (1.0 - other) + 5e-4 * other)
    travels = [channels.shift_m(f"travel.{drive}") for drive in machine.drive_names[:2]]
    expected = travels[0] * first[:, None] + travels[1] * (3e-4 * other)[:, None]
    np.testing.assert_allclose(channels.shift_m("table.3"), expected, atol=1e-12)
    for a, drive in enumerate(machine.drive_names):
        from_middle = case.rest.drives[visit, a] - 0.5 * np.sum(machine.travel[a])
        expected = channels.shift_m(f"travel.{drive}") * from_middle[:, None]
        np.testing.assert_allclose(channels.shift_m(f"scale.{drive}"), expected, atol=1e-12)


def test_every_name_has_one_response(case):
    names = case.channels.names
    assert len(set(names)) == len(names)
    for name in names:
        assert np.all(np.isfinite(case.channels.shift_m(name))), name


def test_a_slider_is_pulled_by_its_own_struts_towards_the_platform(case):
    """Force and moment about the middle of its joints, from the places of the joints."""
    observed, machine = case.observed, case.observed.machine
    inputs = inputs_of_readings(observed, case.channels, lambda *_: [], lambda *_: [])
    poses, geometry, visit = observed.poses, observed.poses.geometry, np.maximum(observed.visit, 0)
    equilibrium_ = poses.equilibrium
    struts = range(len(machine.strut_names))
    carriers = equilibrium.carriers_of(machine, geometry, case.rest.drives, case.rest.at)
    for a in range(len(machine.drive_names)):
        pull, moment = np.zeros((len(visit), 3)), np.zeros(len(visit))
        own = [i for i in struts if machine.strut_drive[i] == a]
        for i in own:
            far = equilibrium_.position_m + equilibrium_.rotation @ geometry.platform_joint_m[i]
            along = far - carriers[a].position(geometry.base_joint_m[i]).T
            force = (along / np.linalg.norm(along, axis=1)[:, None])[visit] * inputs.tension_n[:, i : i + 1]
            pull += force
            lever = geometry.base_joint_m[i] - geometry.base_joint_m[own].mean(axis=0)
            moment += lever[0] * force[:, 1] - lever[1] * force[:, 0]
        np.testing.assert_allclose(inputs.pull_n[:, a], pull, atol=1e-2 * np.abs(pull).max() + 1e-9)
        np.testing.assert_allclose(inputs.moment_nm[:, a], moment, atol=1e-2 * np.abs(moment).max() + 1e-9)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("travel.left", "m"), ("sideways.left.x", "m"), ("turn.left.z", "rad"), ("pose.x", "m"), ("pose.rz", "rad"),
        ("station.z", "m"), ("station.rx", "rad"), ("smr.P1.x", "m"), ("light.v", "1/m"), ("growth.base", "1"),
        ("light.range", "1"), ("payload.mass", "kg"), ("payload.x", "m"), ("scale.right", "1"), ("table.3", "1"),
        ("length.left_upper", "m"), ("force.x", "N"), ("force.rz", "N m"),
    ],
)  # fmt: skip
def test_every_kind_of_channel_has_its_unit(name, unit):
    assert unit_of_channel(name) == unit
