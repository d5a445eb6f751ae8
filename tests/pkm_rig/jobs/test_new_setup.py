"""A campaign goes on although the station was knocked, moved or off overnight: in a new set-up."""

from __future__ import annotations

from contextlib import closing
from dataclasses import astuple, replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.instruments.station_geometry import polar_to_points
from calibration.reduction.nest_checks import usable_readings
from calibration.reduction.recording_setups import setups_of
from pkm_rig.errors import StationMoved
from pkm_rig.jobs.measure import measure
from pkm_rig.jobs.verify import verify
from pkm_rig.rig.session_record import last_moment
from pkm_rig.store.copies import back_up
from pkm_rig.store.store import Store
from tests.pkm_rig.conftest import Stopped, mock_and_rig, short_rig_file, silent, stop_after

CHANGES = {
    "seed": 4,
    "calibration_poses": 6,
    "verification_payloads": (0,),
    "nest_every_visits": 5,
    "verification_poses": 8,
}


def rig_at(place):
    """The short rig with its station aside by metres along x and y and by an angle."""
    file, machine = short_rig_file(**CHANGES)
    entry = file.station
    east, north, up = entry.position_m
    moved = {"position_m": (east + place[0], north + place[1], up), "heading_rad": entry.heading_rad + place[2]}
    return file.model_copy(update={"station": entry.model_copy(update=moved)}), machine


FIRST, SECOND, THIRD = (0.0, 0.0, 0.0), (0.3, 0.15, 0.1), (-0.2, 0.1, -0.1)


def go_on(store, place, *, job=measure, campaign=None, progress=silent, new_setup=False, meddle=silent):
    """One session at a place of the station, after the campaign's last."""
    after = last_moment(store, campaign) if campaign else None
    file, machine = rig_at(place)
    with mock_and_rig(file, machine, start_s=after.t_rig_s if after else 0.0) as (mock, rig):
        meddle(mock)
        if job is verify:
            return verify(rig, store, campaign, silent, progress, new_setup=new_setup)
        return measure(rig, store, silent, progress, campaign, new_setup=new_setup)


def copy_of(store, tmp_path):
    back_up(store.path, tmp_path / "copy.sqlite")
    return Store(tmp_path / "copy.sqlite")


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A campaign that broke off in the first set-up, between two nest checks."""
    with closing(Store(tmp_path_factory.mktemp("begun") / "store.sqlite")) as store:
        with pytest.raises(Stopped):
            go_on(store, FIRST, progress=stop_after(43))
        yield store, store.campaigns()[0][0]


@pytest.fixture
def of_begun(begun, tmp_path):
    with closing(copy_of(begun[0], tmp_path)) as store:
        yield store, begun[1]


def places_seen(mock, t_rig_s):
    """Four places of the machine as its station sees them, (4, 3); the station's frame."""
    places = [(0.0, 0.4, 0.0), (0.7, 0.5, 0.0), (0.2, 0.9, 0.1), (-0.5, 0.3, -0.2)]
    polar = np.array([astuple(mock.plant.view.polar(place, t_rig_s)) for place in places])
    return polar_to_points(*polar.T)


def test_a_campaign_goes_on_in_new_set_ups_to_its_verdict(of_begun):
    store, campaign = of_begun
    before = store.recording(campaign)
    seen = {}

    def look(number):
        def note(mock):
            seen[number] = places_seen(mock, before["t_rig_s"].max())

        return note

    with pytest.raises(StationMoved, match=r"nest check: .* go on with --new-setup; readings since"):
        go_on(store, SECOND, campaign=campaign, meddle=look(2))
    with pytest.raises(Stopped):
        go_on(store, SECOND, campaign=campaign, new_setup=True, progress=stop_after(12))
    assert [event.data["setup"] for event in store.events(campaign, "new_setup")] == [2]
    go_on(store, SECOND, campaign=campaign)
    recording = store.recording(campaign)
    assert set(recording["station"]) == {1.0, 2.0}
    assert np.all(np.diff(recording["station"]) >= 0.0)
    assert_measured_once(recording)
    assert_unclosed_are_not_used(before, recording)
    again = (np.asarray(recording["phase"]) == "repeatability") & (recording["station"] == 2.0)
    _, counts = np.unique(np.asarray(recording["smr"])[again], return_counts=True)
    assert sorted(counts) == [3, 3, 3, 3, 9]  # three poses, once: 6 are of two sessions' checks of the repeatability

    outcome = go_on(store, THIRD, job=verify, campaign=campaign, new_setup=True, meddle=look(3))
    assert outcome.accepted
    assert set(store.recording(campaign)["station"]) == {1.0, 2.0, 3.0}
    with mock_and_rig(*rig_at(FIRST)) as (mock, _):
        look(1)(mock)
    setups = outcome.reduction.setups
    for number in (2, 3):
        where = np.full(4, number - 1)
        assert setups.to_first(seen[number], where) == pytest.approx(seen[1], abs=1.5e-4)
    for verified in outcome.verified:
        assert verified.after.position_rms_m < 0.2 * verified.before.position_rms_m


def assert_measured_once(recording):
    rows = usable_readings(recording) & (np.asarray(recording["phase"]) == "calibration")
    keys = np.column_stack([recording["pose"], recording["pass"], np.unique(recording["smr"], return_inverse=True)[1]])
    assert len(keys[rows]) == len(np.unique(keys[rows], axis=0)) == 6 * 4 * 5


def assert_unclosed_are_not_used(before, recording):
    """What was measured after the last check of the first set-up was measured anew."""
    open_ = (before["nest_check"] == before["nest_check"].max()) & (np.asarray(before["phase"]) == "calibration")
    assert open_.any()
    uids = np.asarray(before["uid"])[open_]
    assert not usable_readings(recording)[np.isin(np.asarray(recording["uid"]), uids)].any()


def test_a_nest_that_was_moved_in_between_is_refused_and_named_until_it_is_back(of_begun):
    store, campaign = of_begun

    def move_nest(mock):
        machine = mock.plant._machine
        smrs = list(machine.file.smrs)
        index = next(i for i, smr in enumerate(smrs) if smr.on == "floor")
        x, y, z = smrs[index].position_m
        smrs[index] = replace(smrs[index], position_m=(x + 1e-3, y, z))
        mock.plant._machine = replace(machine, file=replace(machine.file, smrs=tuple(smrs)))

    with pytest.raises(InputError, match=r"set-up 2: nest N1 or N2 has moved since set-up 1: .* differs by \d+ um"):
        go_on(store, SECOND, campaign=campaign, new_setup=True, meddle=move_nest)
    with pytest.raises(InputError, match="has moved"):  # nor is it let in by going on
        go_on(store, SECOND, campaign=campaign, meddle=move_nest)
    with pytest.raises(Stopped):
        go_on(store, SECOND, campaign=campaign, new_setup=True, progress=stop_after(0))
    setups = setups_of(store.recording(campaign).take(store.recording(campaign)["station"] != 2.0))
    assert setups.numbers.tolist() == [1, 3]


def test_a_set_up_that_broke_off_before_its_first_reading_is_the_one_that_goes_on(of_begun):
    store, campaign = of_begun

    def stop(*_):
        raise Stopped

    with pytest.raises(Stopped):
        go_on(store, SECOND, campaign=campaign, new_setup=True, progress=stop)
    with pytest.raises(Stopped):
        go_on(store, SECOND, campaign=campaign, progress=stop_after(0))
    assert store.recording(campaign)["station"].max() == 2.0
