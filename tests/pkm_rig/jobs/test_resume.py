"""A campaign that broke off goes on: what is stored is not measured again."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.reduction.nest_checks import usable_readings
from drivers.errors import DeviceError
from pkm_rig.jobs.added_visits import is_same_rig
from pkm_rig.jobs.measure import measure
from pkm_rig.store.store import Store
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file, silent

POSES = 8


def keys_of(recording, rows):
    columns = (recording[name][rows] for name in ("pose", "pass", "smr"))
    return [(int(pose), int(pass_), str(smr)) for pose, pass_, smr in zip(*columns, strict=True)]


@pytest.mark.parametrize("when", ["in a block", "in a nest check", "in a block that a fault ends"])
def test_readings_with_other_settings_of_the_station_are_never_used(tmp_path, when):
    """Somebody changes the prism constant at the station's keyboard; the campaign goes on later."""
    file, machine = short_rig_file(seed=4, calibration_poses=POSES)
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (mock, rig):
        station, seen = mock.station_server._station, []

        def meddle(_advance, _total, what):
            seen.append(what)
            at, phase = (40, "nests") if "nest" in when else (50, "calibration")
            if seen.count("calibration") == at and what == phase:
                station.respond(b"%R1Q,2024,0:0.001")
            if seen.count("calibration") == 53 and "fault" in when:
                mock.drives[0].inject_fault()

        complaint = "0x2310" if "fault" in when else "prism_constant_m was set to 0.0 and is now 0.001"
        with pytest.raises(DeviceError, match=complaint):
            measure(rig, store, silent, meddle)
        campaign = store.campaigns()[0][0]
        before = store.recording(campaign)
        rig.drives.clear_stop()
        rig.drives.fault_reset()
        rig.station.connect()
        measure(rig, store, silent, silent, resume=campaign)
        after = store.recording(campaign)
    usable = usable_readings(after)
    calibration = np.asarray(after["phase"]) == "calibration"
    assert sorted(keys_of(after, calibration & usable)) == sorted(set(keys_of(after, calibration)))
    assert len(keys_of(after, calibration & usable)) == POSES * 4 * 5
    spoilt = np.flatnonzero(np.arange(len(before)) >= np.flatnonzero(calibration)[49] + 1)
    assert when == "in a nest check" or spoilt.size
    assert not (usable & calibration)[spoilt].any()
    store.close()


def test_other_settings_of_the_station_make_it_another_campaign():
    then = {"machine": "m", "station": {"port": "a"}, "campaign": {}, "drives": [], "payloads": [], "nest_length": None}
    for same in ({"port": "b"}, {"edm_mode": "single_standard", "prism_type": "mini", "prism_constant_m": 0.0}):
        assert is_same_rig(then, {**then, "station": same}, adds=False)
    for other in ({"edm_mode": "single_fast"}, {"prism_type": "round"}, {"prism_constant_m": 0.001}):
        assert not is_same_rig(then, {**then, "station": other}, adds=False)
    with_coolant = {**then, "plc": {"host": "here", "readings": [{"name": "coolant_temperature_c"}]}}
    assert is_same_rig(then, {**then, "plc": {"host": "there", "readings": []}}, adds=False)
    assert not is_same_rig(then, with_coolant, adds=False)  # its readings would have another column


def test_a_campaign_that_broke_off_goes_on(tmp_path):
    file, machine = short_rig_file(seed=4, calibration_poses=POSES)
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (mock, rig):
        left = iter(range(119))  # so many of the third block's visits are whole

        def breaks(_advance, _total, what):
            if what == "calibration" and next(left, None) is None:
                mock.drives[0].inject_fault()

        asked = []
        with pytest.raises(DeviceError, match="0x2310"):
            measure(rig, store, asked.append, breaks)
        assert "no payload needed: the simulated PLC has it taken off" in asked
        campaign = store.campaigns()[0][0]
        said = store.events(campaign, "failed")[0].data["emergencies"][0]
        assert (said["drive"], said["code"]) == ("left", 0x2310)
        assert 0.0 < said["t_rig_s"] <= rig.clock.now_s()
        before = store.recording(campaign)
        rig.drives.clear_stop()
        rig.drives.fault_reset()
        said, counts = [], []
        measure(rig, store, said.append, lambda *count: counts.append(count[:2]), resume=campaign)
        after = store.recording(campaign)
        assert not [line for line in said if "payload needed" in line and "400 kg" in line]  # complete with it
        assert {total for _, total in counts} == {sum(advance for advance, _ in counts)} == {len(after)}
        with pytest.raises(InputError, match="not measured here"):
            measure(rig, store, silent, silent, resume="nothing")
        rig.file = file.model_copy(update={"campaign": file.campaign.model_copy(update={"seed": 9})})
        with pytest.raises(InputError, match="another rig file"):
            measure(rig, store, silent, silent, resume=campaign)
    assert after["uid"].tolist()[: len(before)] == before["uid"].tolist()
    calibration = np.asarray(after["phase"]) == "calibration"
    keys = keys_of(after, calibration)
    assert len(keys) == len(set(keys)) == POSES * 4 * 5
    store.close()
