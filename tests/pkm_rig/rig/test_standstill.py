"""Drives that do not stay where a visit has brought them: the visit is measured anew, once."""

from __future__ import annotations

from collections import Counter
from contextlib import contextmanager

import numpy as np
import pytest

from calibration.reduction.nest_checks import usable_readings
from drivers.drives.servo_drive import DriveSample
from drivers.errors import DrivesMoved
from pkm_rig.rig.plans import MEASURED_ANEW, visits
from pkm_rig.rig.runner import describe_campaign, open_runner
from pkm_rig.rig.schedule import Block, calibration_blocks
from pkm_rig.rig.standstill import Standstill
from pkm_rig.store.store import Store, now_text
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file

CAMPAIGN = "short"
MOVED_M = 5e-6


def _creep(server):
    """What a drive does that is moved from its own service port, which no bus shows."""
    axis = server.axis
    with server._lock:
        axis.set_target(round(axis.demand_inc() + MOVED_M * 1e8))
        axis.control(0x000F)
        axis.control(0x001F)
        axis.control(0x000F)


@contextmanager
def _campaign(tmp_path, after):
    """Two visits are measured; the second drive creeps after those stored readings of poses."""
    file, machine = short_rig_file()
    store = Store(tmp_path / "store.sqlite")
    count = Counter()
    with mock_and_rig(file, machine) as (mock, rig):

        def progress(_number, phase):
            count[phase] += 1
            if phase == "calibration" and count[phase] in after:
                _creep(mock.drives[1])

        store.add_campaign(describe_campaign(rig, CAMPAIGN, now_text()), rig.machine.text)
        with open_runner(rig, store, CAMPAIGN, progress) as runner:
            rig.enable()
            rig.refresh_atmosphere()
            block = Block(0, calibration_blocks(machine, file.campaign)[0].visits[:2])
            yield lambda: runner.run(visits(runner.devices, block, "calibration", ("P1", "P2", "P3")), "short"), store
    store.close()


def test_a_visit_during_which_a_drive_moves_is_measured_anew_and_its_readings_are_kept_but_not_used(tmp_path):
    with _campaign(tmp_path, {2}) as (run, store):
        run()
        recording = store.recording(CAMPAIGN)
        rows = np.flatnonzero(np.asarray(recording["phase"]) == "calibration")
        assert recording["visit"][rows].tolist() == [0, 0, 1, 1, 1, 2, 2, 2]
        assert recording["replaces_visit"][rows].tolist() == [-1, -1, 0, 0, 0, -1, -1, -1]
        assert recording["smr"][rows].tolist() == ["P1", "P2", "P1", "P2", "P3", "P1", "P2", "P3"]
        assert usable_readings(recording)[rows].tolist() == [False] * 2 + [True] * 6
        (event,) = store.events(CAMPAIGN, MEASURED_ANEW)
        assert event.data["visit"] == 0
        assert "right" in event.data["reason"]
        assert "moved by 5.0 um" in event.data["reason"]


def test_a_drive_that_moves_again_ends_the_campaign_and_is_named(tmp_path):
    with _campaign(tmp_path, {1, 2}) as (run, store):
        with pytest.raises(DrivesMoved, match="right") as caught:
            run()
        assert "\n" not in str(caught.value)
        assert len(store.events(CAMPAIGN, MEASURED_ANEW)) == 1
        rows = np.asarray(store.recording(CAMPAIGN)["phase"]) == "calibration"
        assert rows.sum() == 2


def _samples(*positions_m, demand_m=0.0):
    return [DriveSample(0, position, demand_m, 0.0, 0.0, 0.0, 0.0, 0.0) for position in positions_m]


def test_positions_count_since_the_first_reading_of_the_visit_and_demands_since_its_target(short_rig):
    _, rig = short_rig
    standstill, target_m = Standstill(rig.drives.drives, 2e-6, 20e-6), np.zeros(2)
    assert standstill.check(3, target_m, _samples(1.0e-5, 0.0)) is None
    assert standstill.check(3, target_m, _samples(1.19e-5, -1.9e-6)) is None
    moved = standstill.check(3, target_m, _samples(1.0e-5, 2.1e-6))
    assert moved is not None
    assert moved.device == "right"
    assert standstill.check(4, target_m, _samples(1.0e-5, 2.1e-6)) is None
    late = standstill.check(4, target_m, _samples(1.0e-5, 2.1e-6, demand_m=-2.1e-6))
    assert late is not None
    assert "left" in str(late)
    assert standstill.check(4, target_m, _samples(float("nan"), 0.0)) is not None
    assert standstill.check(5, target_m, _samples(1.9e-5, 0.0)) is None
    spoilt = standstill.check(6, target_m, _samples(2.1e-5, 0.0))  # the only reading of its visit
    assert spoilt is not None
    assert "away from its demand" in str(spoilt)
