"""Drives that must agree: led along paths, stopped along them, refused one by one; the mock's machine bears no more."""

from __future__ import annotations

import threading
from contextlib import contextmanager

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.machine.inverse import nominal_drives, nominal_poses
from calibration.machine.led_path import forward_pose, tool_coordinates
from drivers.drives.bus_load import frame_bits, sync_load
from drivers.drives.homing import HomingParameters
from drivers.errors import DeviceError, DriveFault, Stopped
from mock_devices.drives.axis_motion import Dynamics
from pkm_rig.rig.config import demo_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.led_motion import led_sides, side_of
from pkm_rig.rig.led_rows import MOST_FADED, PathOrder, led_rows
from pkm_rig.virtual.mock_rig import embedded_mock_rig

MIDDLE = np.array([0.0, 0.0, 1.1, 0.0, 0.0, 0.0])
THERE = np.array([0.03, -0.02, 1.12, 0.02, -0.03, 0.04])


@contextmanager
def gough8():
    """The demo rig of eight legs for six coordinates, connected and powered, and its mock."""
    path = demo_rig_path("gough8")
    file, machine = load_rig(path)
    with (
        embedded_mock_rig(file, path) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory, rig_path=path) as rig,
    ):
        rig.enable()
        yield rig, mock.mock


@pytest.fixture(scope="module")
def led():
    with gough8() as pair:
        yield pair


def disagreement_m(rig, mock):
    """Largest difference of an encoder from where the nominal machine has it at the pose that all of them make."""
    t_s = rig.clock.now_s()
    drives = np.array([drive.encoder_m(t_s) for drive in mock.drives])
    return float(np.abs(forward_pose(rig.machine, drives)[1]).max())


def test_a_led_path_ends_where_it_should_and_strains_nothing(led):
    rig, mock = led
    rig.lead(THERE, 0.2)
    wanted = nominal_drives(rig.machine, nominal_poses(rig.machine, THERE[None]))[0]
    assert rig.positions_m() == pytest.approx(wanted, abs=2e-6)
    assert disagreement_m(rig, mock) < 2e-6
    assert mock.strained is None


def test_a_correction_is_there_at_the_end_of_the_path(led):
    rig, _ = led
    correction = np.array([1, -1, 2, 0, -2, 1, 0, 1]) * 5e-5
    rig.lead(MIDDLE, 0.2, correction)
    wanted = nominal_drives(rig.machine, nominal_poses(rig.machine, MIDDLE[None]))[0] + correction
    assert rig.positions_m() == pytest.approx(wanted, abs=2e-6)
    rig.lead(MIDDLE, 0.2)


def test_profiles_and_homing_that_moves_are_refused_before_anything_is_sent(led):
    rig, _ = led
    before = rig.positions_m()
    with pytest.raises(ValueError, match="only led along paths"):
        rig.move(before + 0.001, 0.1)
    homing = HomingParameters(method=34, position_m=0.2)
    with pytest.raises(ValueError, match="leg1: homing method 34 moves it while the others stand"):
        rig.drives.home([homing, *[None] * 7])
    assert rig.positions_m() == pytest.approx(before, abs=1e-9)


def test_a_stop_brings_all_to_rest_along_the_path(led):
    rig, mock = led
    rig.lead(MIDDLE, 0.2)
    rows = 0

    def stop_when_half_way():
        nonlocal rows
        rows += 1
        if rows == 12:
            threading.Thread(target=rig.stop, args=("somebody asks for it",)).start()

    send = rig.drives._sampler._sync  # counts SYNCs: the stop is asked for while all move
    rig.drives._sampler._sync = lambda: (send(), stop_when_half_way())[0]
    try:
        with pytest.raises(Stopped, match="somebody asks for it"):
            rig.lead(THERE, 0.2)
    finally:
        rig.drives._sampler._sync = send
    rig.clock.sleep_s(0.5)  # following errors decay
    assert disagreement_m(rig, mock) < 2e-7  # by ramps alone, each from its own speed, it would be micrometres
    assert mock.strained is None
    on_the_way = rig.positions_m()
    end = nominal_drives(rig.machine, nominal_poses(rig.machine, THERE[None]))[0]
    assert np.abs(on_the_way - end).max() > 1e-3
    rig.drives.clear_stop()
    rig.drives.disable()
    rig.enable()
    rig.lead(MIDDLE, 0.2)


def test_ramps_are_scaled_so_that_all_drives_rest_after_the_same_time(led):
    rig, mock = led
    rig.lead(THERE, 0.2)
    ramps = np.array([drive.with_axis(lambda axis: axis.limits.quick_stop_deceleration) for drive in mock.drives])
    start, end = (nominal_drives(rig.machine, nominal_poses(rig.machine, at[None]))[0] for at in (MIDDLE, THERE))
    way = np.abs(end - start)
    assert ramps / ramps.max() == pytest.approx(way / way.max(), rel=0.3, abs=0.05)
    rig.lead(MIDDLE, 0.2)


def test_without_sync_all_drives_stop_together():
    """The line falls silent on the way: the drives' own watch stops them, and they still agree."""
    with gough8() as (rig, mock):
        rig.lead(MIDDLE, 0.2)
        count, send = 0, rig.drives._sampler._sync

        def lost_after_ten():
            nonlocal count
            count += 1
            if count <= 10:
                send()

        rig.drives._sampler._sync = lost_after_ten
        with pytest.raises(DeviceError):
            rig.lead(THERE, 0.2)
        rig.clock.sleep_s(1.0)
        assert not mock.plant.is_moving()
        assert disagreement_m(rig, mock) < 1e-4
        assert mock.strained is None


def test_moving_drive_by_drive_trips_the_mock():
    """One leg goes 1 mm by itself: a strut bears more than it may, and all drives fault."""
    with gough8() as (rig, mock):
        rig.lead(MIDDLE, 0.2)

        def go_alone(axis):
            t_s = rig.clock.now_s()
            target = round(axis.motion.command(t_s)[0]) + 100_000
            axis.motion.go(t_s, target, Dynamics(1e7, 1e8, 1e8), at_once=True)
            axis.target_inc = target

        mock.drives[0].with_axis(go_alone)
        rig.clock.sleep_s(1.0)
        rig.drives.sample()
        rig.clock.sleep_s(0.1)
        assert mock.strained is not None
        assert "N permitted" in mock.strained
        with pytest.raises(DriveFault, match="a strut bears more than it may"):
            rig.lead(MIDDLE, 0.2)


def rows_of(machine, demand, commanded, **changes):
    settings = {
        "speed_m_per_s": 0.1, "acceleration_m_per_s2": 0.5, "period_s": 0.004, "payload_kg": 0.0,
        "payload_com_m": (0.0, 0.0, 0.0),
    }  # fmt: skip
    return led_rows(machine, demand, commanded, PathOrder(**(settings | changes)))


@pytest.fixture(scope="module")
def machine():
    return load_rig(demo_rig_path("gough8"))[1]


def test_a_path_begins_at_the_demand_and_ends_without_a_step(machine):
    demand = nominal_drives(machine, nominal_poses(machine, MIDDLE[None]))[0] + np.linspace(-1e-4, 1e-4, 8)
    rows = rows_of(machine, demand, THERE)
    steps = np.abs(np.diff(rows, axis=0))
    assert rows[0] == pytest.approx(demand, abs=1e-12)
    assert steps.max() <= 0.1 * 0.004 * (1.0 + 2e-6)
    assert steps[0].max() < 0.05 * steps.max()
    assert steps[-1].max() < 0.05 * steps.max()


def bow(height):
    """A correction (n, 8) of the first drive alone: 100 um and more, by the height (n,) of the tool."""
    return np.outer(1e-4 + 0.4 * (height - 1.11) ** 2, np.eye(8)[0])


def bowed(machine):
    """The same of platform poses."""
    return lambda pose: bow(tool_coordinates(machine, pose)[:, 2])


def test_every_row_is_corrected_for_its_own_pose(machine):
    """Less the correction for where it is, each row is the nominal machine's on the straight way: no end decides it."""
    middle = nominal_poses(machine, MIDDLE[None])
    rows = rows_of(machine, (nominal_drives(machine, middle) + bow(MIDDLE[2:3]))[0], THERE, corrections=bowed(machine))
    there = nominal_poses(machine, THERE[None])
    assert rows[-1] == pytest.approx((nominal_drives(machine, there) + bow(THERE[2:3]))[0], abs=1e-9)
    for row in rows[:: len(rows) // 9]:
        near = forward_pose(machine, row)[0]
        pose, apart = forward_pose(machine, row - bow(near[2:3])[0])
        assert apart == pytest.approx(np.zeros(8), abs=3e-7)
        share = (pose[2] - MIDDLE[2]) / (THERE[2] - MIDDLE[2])
        assert pose == pytest.approx(MIDDLE + share * (THERE - MIDDLE), abs=3e-6)


def test_a_correction_that_is_switched_on_at_rest_comes_without_a_step(machine):
    middle = nominal_poses(machine, MIDDLE[None])
    demand = nominal_drives(machine, middle)[0]
    rows = rows_of(machine, demand, MIDDLE, corrections=bowed(machine))
    assert rows[0] == pytest.approx(demand, abs=1e-12)
    assert rows[-1] == pytest.approx(demand + bow(MIDDLE[2:3])[0], abs=1e-9)
    steps = np.abs(np.diff(rows, axis=0)).max(axis=1)
    assert steps.max() <= MOST_FADED
    assert max(steps[0], steps[-1]) < 0.3 * steps.max()


def test_a_corrected_path_keeps_the_speed(machine):
    """A correction that grows by 10 % of the way makes the first drive faster; the path then takes longer."""
    middle = nominal_poses(machine, MIDDLE[None])

    def steep(pose):
        return np.outer(0.1 * (tool_coordinates(machine, pose)[:, 2] - 1.1), np.eye(8)[0])

    demand = nominal_drives(machine, middle)[0]
    up = np.array([0.0, 0.0, 1.12, 0.0, 0.0, 0.0])
    rows, plain = rows_of(machine, demand, up, corrections=steep), rows_of(machine, demand, up)
    assert np.abs(np.diff(rows, axis=0)).max() <= 0.1 * 0.004 * (1.0 + 2e-6)
    assert len(rows) >= len(plain)


def test_a_short_path_on_which_a_correction_fades_keeps_the_speed():
    """Ways of a few millimetres on which up to 0.7 mm fade: the fading decides how long some of them take."""
    machine = load_rig(demo_rig_path("delta8"))[1]
    middle = machine.commanded_limits.mean(axis=1)
    start = nominal_drives(machine, nominal_poses(machine, middle[None]))[0]
    rng = np.random.default_rng(0)
    for _ in range(100):
        way, apart = rng.normal(size=3), rng.normal(size=4) * rng.uniform(2e-5, 4e-4)
        there = middle + way / np.linalg.norm(way) * rng.uniform(0.002, 0.03)
        rows = rows_of(machine, start + apart, there, speed_m_per_s=0.08)
        assert np.abs(np.diff(rows, axis=0)).max() <= 0.08 * 0.004 * (1.0 + 2e-6)


def test_a_corrected_path_stays_within_the_software_limits(machine):
    middle = nominal_poses(machine, MIDDLE[None])
    demand = nominal_drives(machine, middle)[0]
    limits = np.stack([demand - 0.2, demand + 0.2], axis=1)
    limits[0, 1] = demand[0] + 5e-5  # less than its correction of 140 um
    rows_of(machine, demand, MIDDLE, limits=limits)
    with pytest.raises(InputError, match=r"corrected, drive leg1 would be at .*software limits \(0x607D\)"):
        rows_of(machine, demand, MIDDLE, limits=limits, corrections=bowed(machine))


def test_every_row_of_a_path_agrees(machine):
    """Between the rows' ends: no drive is off by more than a micrometre from what the others make of the pose."""
    demand = nominal_drives(machine, nominal_poses(machine, MIDDLE[None]))[0]
    rows = rows_of(machine, demand, THERE)
    joint = demand + np.linspace(0.0, 1.0, len(rows))[:, None] * (rows[-1] - demand)
    led_apart = max(np.abs(forward_pose(machine, row)[1]).max() for row in rows[::5])
    joint_apart = max(np.abs(forward_pose(machine, row)[1]).max() for row in joint[::5])
    assert led_apart < 1e-9
    assert joint_apart > 1e-5  # why drives are not interpolated one by one


@pytest.mark.parametrize(
    ("commanded", "changes", "message"),
    [
        ([0.0, 0.0, 1.6, 0.0, 0.0, 0.0], {}, "its travel is 0 to 0.5"),
        (THERE, {"payload_kg": 12_000.0}, "would bear up to"),
    ],
)
def test_a_path_that_must_not_be_is_refused(machine, commanded, changes, message):
    demand = nominal_drives(machine, nominal_poses(machine, MIDDLE[None]))[0]
    with pytest.raises(InputError, match=message):
        rows_of(machine, demand, np.array(commanded), **changes)


def test_drives_that_do_not_agree_are_not_led(machine):
    demand = nominal_drives(machine, nominal_poses(machine, MIDDLE[None]))[0]
    demand[3] += 0.02
    with pytest.raises(InputError, match="they strain the machine"):
        rows_of(machine, demand, THERE)


@pytest.mark.parametrize("side", [1, -1])
def test_the_side_of_an_approach_is_found_from_its_drives(machine, side):
    pose = nominal_poses(machine, THERE[None])[0]
    assert side_of(machine, pose, led_sides(machine, pose, side, 0.005), 0.005) == side


def stuffed_bits(data_bytes):
    """Bits of a frame in which every stuff bit begins the next run of five: the worst there is, bit by bit."""
    bits, last, run = 0, 0, 0
    for bit in [0] * 5 + ([1, 1, 1, 1, 0, 0, 0, 0] * 40)[: 29 + 8 * data_bytes]:
        bits += 1
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:  # a bit of the other kind is put in
            bits, last, run = bits + 1, 1 - bit, 1
    return bits + 10 + 3


@pytest.mark.parametrize("data_bytes", [0, 4, 8])
def test_a_frames_length_with_the_most_stuffing(data_bytes):
    assert frame_bits(data_bytes) == stuffed_bits(data_bytes)


def test_eight_drives_every_four_milliseconds_leave_a_quarter_of_the_bus():
    assert sync_load(8, 0.004, 1_000_000) == pytest.approx(0.74375)
    assert sync_load(6, 0.004, 1_000_000) < 0.6
