"""A campaign in three sessions on a served mock rig, in scaled time: interrupted, resumed, then verified."""

from __future__ import annotations

import signal
import threading
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.kill_sweep.processes import RIG
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.jobs.measure import measure
from pkm_rig.jobs.session import open_rig, pin_to_one_core
from pkm_rig.jobs.verify import verify
from pkm_rig.rig.config import load_rig
from pkm_rig.rig.session_record import last_moment
from pkm_rig.store.store import Store
from pkm_rig.virtual.new_rig import with_values, write_new_rig
from pkm_rig.virtual.served_rig import serve_mock_rig
from tests.pkm_rig.conftest import mock_and_rig, silent

SCALE = 60.0
SETTINGS = {"calibration_poses": 8}
PAUSE_S = 10.0  # that the first session is said to have ended earlier
JITTER_S = 0.1  # of the computer, between two looks at its clocks


def interrupt_at(reading):
    """A real SIGINT to this program, as Ctrl-C sends it, while the campaign is measured."""
    left = iter(range(reading))

    def progress(_advance, _total, what):
        if what == "calibration" and next(left, None) is None:
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    return progress


@pytest.fixture(scope="module")
def rig_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("served") / "rig.toml"
    values = {("", "time_scale"): str(SCALE)} | {("campaign", k): str(v) for k, v in SETTINGS.items()}
    template = path.with_name("template.toml")
    template.write_text(with_values(RIG.read_text(encoding="utf-8"), values), encoding="utf-8")
    write_new_rig(template, path, anywhere=True)
    return path


@pytest.fixture(scope="module")
def interruptible():
    """Python's own handler of SIGINT, which a shell's background job does not get."""
    former = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, former)


@pytest.fixture(scope="module")
def resumed(rig_path, interruptible):
    """The interrupted campaign: its store, its outcome."""
    store = Store(rig_path.with_name("store.sqlite"))
    with serve_mock_rig(load_rig(rig_path)[0], rig_path):
        with open_rig(rig_path) as rig, pytest.raises(KeyboardInterrupt):
            measure(rig, store, silent, interrupt_at(70))
        campaign = store.campaigns()[0].campaign
        ended = last_moment(store, campaign)
        with open_rig(rig_path, after=replace(ended, t_utc_s=ended.t_utc_s - PAUSE_S)) as rig:
            measure(rig, store, silent, silent, campaign)
        with open_rig(rig_path, after=last_moment(store, campaign)) as rig:
            outcome = verify(rig, store, campaign, silent, silent)
    yield store, outcome
    store.close()


def test_rig_time_goes_on_by_the_time_between_the_sessions(resumed):
    store, outcome = resumed
    recording = store.recording(outcome.campaign)
    assert np.all(np.diff(recording["t_rig_s"][np.argsort(recording["sequence"])]) > 0.0)
    begun, ended = ([e.data for e in store.events(outcome.campaign, f"session_{kind}")] for kind in ("begun", "ended"))
    assert [s["command"] for s in begun] == ["measure", "measure", "verify"]
    assert [s["why"] for s in ended] == ["interrupted", "finished", "finished"]
    assert [s.number for s in recording.file.sessions] == [1, 2, 3]
    for former, later, pause_s in zip(ended, begun[1:], (PAUSE_S, 0.0), strict=False):
        gap_s = later["t_utc_s"] - former["t_utc_s"] + pause_s
        assert later["t_rig_s"] - former["t_rig_s"] == pytest.approx(SCALE * gap_s, abs=SCALE * JITTER_S)


def test_an_interrupted_campaign_finds_what_an_untouched_one_does(resumed, rig_path, tmp_path):

    _, outcome = resumed
    file, machine = load_rig(rig_path)
    file = file.model_copy(update={"time_scale": None})  # the same machine in virtual time
    store = Store(tmp_path / "store.sqlite")
    with pin_to_one_core(), mock_and_rig(file, machine) as (_, rig):
        untouched = calibrate(rig, store, silent, silent)
    store.close()
    assert outcome.accepted
    assert untouched.accepted
    assert outcome.diagnosis.diagnosis.verdict == untouched.diagnosis.diagnosis.verdict == "none"
    # Both are RMS values over n poses with two coordinates in the plane: of normal errors each has the standard
    # deviation RMS / sqrt(2 * 2 n). Noise of readings is drawn anew in each campaign; 3.5 sigma is 1 in 2,000.
    errors_m = [one.verified[0].after.position_rms_m for one in (outcome, untouched)]
    sigma_m = np.hypot(*errors_m) / np.sqrt(4 * outcome.verified[0].after.n)
    assert abs(errors_m[0] - errors_m[1]) < 3.5 * sigma_m
