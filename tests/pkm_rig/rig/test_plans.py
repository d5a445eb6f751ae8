"""Gates of a campaign: what makes a rig that works unfit now, and that everything read is kept."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from calibration.reduction.nest_checks import usable_readings
from calibration.reduction.nest_gate import gate_nests
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.measure import measure
from pkm_rig.rig.devices import rigid_fit
from pkm_rig.rig.session_record import last_moment
from pkm_rig.store.store import Store
from tests.pkm_rig.conftest import Stopped, mock_and_rig, short_rig_file, silent


def refused(tmp_path, **changes):
    file, machine = short_rig_file(**changes)
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (mock, rig):
        with pytest.raises(CampaignRefused) as caught:
            measure(rig, store, lambda _: None, lambda *_: None)
        assert not any(drive.axis.powered for drive in mock.drives)
    campaign, _, _, readings, _, state, step, *_ = store.campaigns()[0]
    assert (state, step) == ("refused", "measuring")
    assert store.events(campaign, "failed")[0].data["reason"] == str(caught.value)
    store.close()
    assert "\n" not in str(caught.value)
    return str(caught.value), readings


def test_a_cold_machine_is_refused(tmp_path):
    reason, readings = refused(tmp_path, warm_up_max_s=60.0, warm_up_rate_k_per_h=0.01)
    assert reason.startswith("warm-up")
    assert readings == 0


def test_an_unrepeatable_machine_is_refused(tmp_path):
    reason, readings = refused(tmp_path, repeatability_limit_m=1e-9)
    assert reason.startswith("repeatability")
    assert readings == 2 + 3


def test_a_station_that_moved_is_refused_after_a_second_look(tmp_path):
    reason, readings = refused(tmp_path, nest_limit_m=1e-9)
    assert reason.startswith("nest check")
    assert readings == 2 + 3 + 2 + 2


@pytest.mark.parametrize("stopped", [False, True], ids=["in one session", "resumed"])
def test_a_wrong_first_reading_of_a_nest_does_not_end_the_campaign(tmp_path, stopped):
    """The reflector sat 2 mm aside in its nest, and was put right after it had been measured once."""
    usual, machine = short_rig_file(calibration_poses=6)
    store = Store(tmp_path / "store.sqlite")

    def put(mock, off_m):
        machine = mock.plant._machine
        smrs = [
            replace(smr, position_m=(smr.position_m[0] + off_m, *smr.position_m[1:])) if smr.name == "N1" else smr
            for smr in machine.file.smrs
        ]
        mock.plant._machine = replace(machine, file=replace(machine.file, smrs=tuple(smrs)))

    def campaign(off_m, campaign_id=None, start_s=0.0):
        with mock_and_rig(usual, machine, start_s=start_s) as (mock, rig):
            put(mock, off_m)
            readings = itertools.count(1)

            def progress(advance, _total, what):
                if advance and off_m and what == "nests" and next(readings) == 1:
                    put(mock, -off_m)
                if what == "repeatability" and stopped and off_m:
                    raise Stopped

            measure(rig, store, silent, progress, campaign_id)

    try:
        if stopped:
            with pytest.raises(Stopped):
                campaign(2e-3)
            interrupted = store.campaigns()[0][0]
            campaign(0.0, interrupted, last_moment(store, interrupted).t_rig_s)
        else:
            campaign(2e-3)
        recording = store.recording(store.campaigns()[0][0])
        left_out = gate_nests(recording)[1]
        assert [reading.name for reading in left_out] == [recording["uid"][0]]
        assert left_out[0].size == pytest.approx(2e-3, rel=0.1)
        counted = np.asarray(recording["phase"]) == "calibration"
        assert usable_readings(recording)[counted].all()
    finally:
        store.close()


def test_a_station_too_far_aside_is_refused_before_anything_is_stored(tmp_path):
    file, machine = short_rig_file()
    station = file.station.model_copy(update={"position_m": (2.9, 0.3, 1.2)})
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (_, rig):
        rig.file = file.model_copy(update={"station": station})
        with pytest.raises(CampaignRefused, match="in-plane"):
            measure(rig, store, lambda _: None, lambda *_: None)
    assert store.campaigns() == []
    store.close()


def test_every_reading_tells_the_settings_that_its_distance_was_measured_with(tmp_path):
    file, machine = short_rig_file(repeatability_limit_m=1e-9)
    settings = {"edm_mode": "single_fast", "prism_type": "minizero", "prism_constant_m": 0.001}
    file = file.model_copy(update={"station": file.station.model_copy(update=settings)})
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (_, rig), pytest.raises(CampaignRefused):
        measure(rig, store, lambda _: None, lambda *_: None)
    recording = store.recording(store.campaigns()[0][0])
    told = {name: set(recording[name].tolist()) for name in ("edm_mode", "prism_type", "prism_constant_m")}
    assert told == {"edm_mode": {3.0}, "prism_type": {8.0}, "prism_constant_m": {0.001}}
    store.close()


def test_the_frame_for_aiming_is_found_from_points():
    rng = np.random.default_rng(3)
    points = rng.normal(0.0, 1.0, (6, 3))
    turn = np.linalg.qr(rng.normal(0.0, 1.0, (3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    frame = rigid_fit(points, points @ turn.T + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(frame.rotation, turn, atol=1e-12)
    np.testing.assert_allclose(frame.translation_m, [1.0, 2.0, 3.0], atol=1e-12)
