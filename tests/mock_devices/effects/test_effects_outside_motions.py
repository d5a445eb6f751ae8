"""Effects outside the catalogue in seats, feet, joints and encoders, at points worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from mock_devices.effects import OUTSIDE
from tests.mock_devices.effects_bench import HOME_M, Alone, along


def test_they_are_ordinary_ones():
    assert {"bedding_in", "walking_feet", "joint_friction", "dark_tracks"} <= set(OUTSIDE)


def test_a_seat_sinks_half_as_far_with_every_load():
    one = Alone("bedding_in", 8e-6, place="right_upper")
    sunk = [one.deviation(exchanges=float(n)).base_joint_m[0] for n in range(5)]
    assert sunk[0] == pytest.approx(np.zeros(4))
    assert np.diff([d[2] for d in sunk]) == pytest.approx([-4e-6j, -2e-6j, -1e-6j, -0.5e-6j])
    assert not np.any(np.delete(sunk, 2, axis=1))


def test_a_machine_walks_away_by_its_hard_stops():
    one = Alone("walking_feet", 60e-6)
    one.move(0, 1.3, speed=0.2)  # as fast as friction still holds
    one.move(1, 0.9, speed=0.1)
    assert one.deviation().frame_shift_m[0] == pytest.approx(0.0, abs=1e-15)
    one.move(0, 1.5, speed=0.4)  # four times the energy: three times what friction holds, to the left
    assert one.deviation().frame_shift_m[0] == pytest.approx(-1.5e-6)
    one.move(0, 1.3, speed=0.4)
    assert one.deviation().frame_shift_m[0] == pytest.approx(1.5e-6)
    one.move(1, 1.1, speed=0.4)  # the second drive pushes to the right on its way up
    assert one.deviation().frame_shift_m[0] == pytest.approx(4.5e-6)
    one.t_s += 5000.0
    one.move(1, 0.8, speed=0.1)
    assert one.deviation().frame_shift_m[0] == pytest.approx(4.5e-6)
    assert not np.any(one.deviation().smr_m)


def test_friction_of_joints_turns_the_platform_by_how_the_struts_swung():
    one = Alone("joint_friction", 40.0)
    assert one.deviation().moment_nm[0] == 0.0
    moments = {}
    for left, right in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        for drive, side in ((0, left), (1, right)):
            one.move(drive, one.q[drive] + 0.1 * side)
        moments[left, right] = [float(one.deviation(payload_kg=kg).moment_nm[0]) for kg in (0.0, 75.0)]
    assert moments[1.0, 1.0] == moments[-1.0, -1.0] == [0.0, 0.0]
    assert moments[1.0, -1.0] == pytest.approx([-40.0, -60.0])
    assert moments[-1.0, 1.0] == pytest.approx([40.0, 60.0])


def test_two_dark_tracks_leave_a_stair_of_what_their_bits_stand_for():
    one = Alone("dark_tracks", 3e-6)
    at = np.linspace(0.4, 1.6, 4801)
    off = one.deviation(t_s=np.zeros(len(at)), q=along(at)).travel_m
    assert set(np.round(off[:, 0] / 1e-6, 9)) == {0.0, 1.0, 2.0, 3.0}  # neither, the finer, the coarser, both
    jumps = np.flatnonzero(np.diff(off[:, 0]))
    assert np.diff(at[jumps]) == pytest.approx(0.105, abs=0.0003)
    assert set(np.round(np.diff(off[:, 0])[jumps] / 1e-6, 9)) == {1.0, -3.0}
    assert not np.any(off[:, 1])
    same = one.deviation(t_s=np.zeros(9), q=np.full((9, 2), HOME_M)).travel_m[:, 0]
    assert np.ptp(same) == 0.0
