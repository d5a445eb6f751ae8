"""A campaign that waits for its operator: paused at the terminal, or suspended by an interlock."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.reduction.nest_checks import usable_readings
from drivers.errors import InterlockOpen, PlcError, TargetNotFound
from mock_devices.faults import parse_fault
from pkm_rig.jobs.measure import measure
from pkm_rig.rig.device_sections import RegisterEntry
from pkm_rig.rig.devices import WaitDevice
from pkm_rig.rig.live import Live
from pkm_rig.rig.operator_devices import PayloadDevice
from pkm_rig.rig.waiting import Waiting
from pkm_rig.rig.worker import Worker
from pkm_rig.store.store import Store
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file

SHORT = {"calibration_poses": 6, "nest_every_visits": 4}
GUARD = 0


class Script:
    """An operator who does what is written down: one thing each time the waiting campaign looks."""

    hint = "press Enter"

    def __init__(self, mock, rig):
        self.mock, self.rig = mock, rig
        self.pause = False
        self.steps = []
        self.seen = []
        self.phases = []

    def asks_to_pause(self):
        return self.pause

    def begin_wait(self):
        self.pause = False

    def end_wait(self):
        pass

    def acknowledges(self):
        self.seen.append(any(drive.axis.powered for drive in self.mock.drives))
        step = self.steps.pop(0)
        if step == "close":
            self.mock.plc.set_interlock(GUARD, good=True)
        if step == "button":
            self.mock.plc.state.acknowledge()
        return step == "enter"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Paused within a visit, suspended within another, and in a nest check."""
    file, machine = short_rig_file(seed=4, on_interlock="suspend", **SHORT)
    plc = file.plc.model_copy(update={"registers": {"acknowledge": RegisterEntry(address=19)}})
    file = file.model_copy(update={"plc": plc})
    store = Store(tmp_path_factory.mktemp("waiting") / "store.sqlite")
    said = []
    with mock_and_rig(file, machine) as (mock, rig):
        rig.operator = script = Script(mock, rig)
        counts = {"calibration": 0, "nests": 0}

        def meddle(_advance, _total, what):
            script.phases.append(what)
            if what not in counts:
                return
            counts[what] += 1
            if (what, counts[what]) == ("calibration", 13):  # within a visit of five reflectors
                script.pause, script.steps = True, ["wait", "enter"]
            if (what, counts[what]) == ("calibration", 26):
                mock.plc.set_interlock(GUARD, good=False)
                script.steps = ["wait", "enter", "close", *["wait"] * 20, "enter"]
            if (what, counts[what]) == ("nests", 9):  # of two nests: the second one is still to come
                mock.plc.set_interlock(GUARD, good=False)
                script.steps = ["close", *["wait"] * 20, "button", *["wait"] * 20]

        name = measure(rig, store, said.append, meddle)
    yield store, name, said, script
    store.close()


def test_the_drives_are_without_power_while_it_waits(campaign):
    *_, script = campaign
    assert script.seen
    assert not any(script.seen)


def test_progress_shows_that_it_waits(campaign):
    *_, script = campaign
    assert script.phases.count("waiting for operator") == 3


def test_an_acknowledgement_with_an_open_interlock_does_not_suffice(campaign):
    _, _, said, _ = campaign
    assert sum("interlock still open: guard closed" in line for line in said) == 1
    assert sum(line == "going on" for line in said) == 3


def test_it_is_in_the_record(campaign):
    store, name, _, _ = campaign
    reasons = [event.data["reason"] for event in store.events(name, "held")]
    assert reasons[0] == "paused"
    assert [("guard closed" in reason) for reason in reasons] == [False, True, True]
    assert len(store.events(name, "gone_on")) == 3


def test_a_visit_that_was_broken_is_measured_anew_as_a_whole(campaign):
    store, name, _, _ = campaign
    recording = store.recording(name)
    is_calibration = np.asarray(recording["phase"]) == "calibration"
    used = is_calibration & usable_readings(recording)
    columns = (recording[c][used].tolist() for c in ("pose", "pass", "smr"))
    keys = list(zip(*columns, strict=True))
    assert len(keys) == len(set(keys)) == 6 * 4 * 5
    replaced = recording["replaces_visit"]
    assert len(set(replaced[replaced >= 0.0])) == 2
    assert np.count_nonzero(is_calibration & ~used) == 3 + 3
    for visit in set(recording["visit"][used]):
        of_visit = used & (recording["visit"] == visit)
        assert len(set(recording["smr"][of_visit])) == 5


def test_an_interlock_that_opens_before_a_payload_is_asked_for_or_temperatures_are_read_suspends_too():
    file, machine = short_rig_file(seed=4, on_interlock="suspend", **SHORT)
    asked = []
    with mock_and_rig(file, machine) as (mock, rig):
        mock.plc.set_interlock(GUARD, good=False)
        with pytest.raises(InterlockOpen):
            rig.supervisor.look()
        worker = Worker(Waiting(rig, asked.append, lambda *_: None).suspends_at)
        for device, value in (
            (PayloadDevice(rig, worker, asked.append, lambda *_: None, lambda *_: None), 1),
            (WaitDevice(rig, worker), 0.0),
        ):
            assert device.set(value).exception(timeout=60.0) is None
            assert isinstance(worker.pardoned, InterlockOpen)
            worker.pardoned = None
        worker.close()
    assert asked == []


def test_an_interlock_ends_a_campaign_unless_the_rig_file_says_otherwise(tmp_path):
    file, machine = short_rig_file(seed=4, **SHORT)
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (mock, rig):

        def meddle(_advance, _total, what):
            if what == "calibration":
                mock.plc.set_interlock(GUARD, good=False)

        with pytest.raises(InterlockOpen, match="guard closed"):
            measure(rig, store, lambda _line: None, meddle)
    store.close()


def test_a_reflector_that_is_not_seen_is_asked_for_by_name_and_its_visit_measured_anew(tmp_path):
    file, machine = short_rig_file(seed=4, on_unseen="suspend", **SHORT)
    store = Store(tmp_path / "store.sqlite")
    strikes = {12: "tracker-no-target", 23: "tracker-beam-break", 34: "tracker-wrong-nest"}  # by readings taken
    asked, counts = [], {"calibration": 0}
    with mock_and_rig(file, machine) as (mock, rig):
        rig.operator = script = Script(mock, rig)
        live = Live()
        live.watch(rig)
        live.asks = asked.append
        acknowledges, drives_shown = script.acknowledges, []

        def acknowledged():
            drives_shown.extend(
                guard.value for guard in live.snapshot().guards if guard.name in ("drive left", "drive right")
            )
            return acknowledges()

        script.acknowledges = acknowledged

        def meddle(_advance, _total, what):
            if what != "calibration":
                return
            counts[what] += 1
            fault = strikes.get(counts[what])
            if fault is not None:
                script.steps = ["wait", "enter"]
                mock.faults.arm([parse_fault(f"{fault}@1")])

        name = measure(rig, store, lambda _line: None, meddle)
    recording = store.recording(name)
    is_calibration = np.asarray(recording["phase"]) == "calibration"
    used = usable_readings(recording) & is_calibration
    assert mock.faults.struck == tuple(strikes.values())
    assert np.count_nonzero(used) == 6 * 4 * 5
    replaced = recording["replaces_visit"]
    assert len(set(replaced[replaced >= 0.0])) == np.count_nonzero([n % 5 for n in strikes])
    requests = [request for request in asked if request is not None and request.kind == "reflector"]
    assert len(requests) == 3
    assert all(f"reflector {request.of}" in request.text for request in requests)
    assert {request.of for request in requests} <= {smr.name for smr in machine.smrs}
    assert not any(script.seen)  # without power meanwhile, and shown so
    assert drives_shown
    assert {value.split(",")[0] for value in drives_shown} == {"switch on disabled"}
    assert [event.data["reason"] for event in store.events(name, "held")] == [request.text for request in requests]
    store.close()


def test_a_reflector_that_is_not_seen_ends_a_campaign_unless_the_rig_file_says_otherwise(tmp_path):
    file, machine = short_rig_file(seed=4, on_interlock="suspend", **SHORT)
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (mock, rig):

        def meddle(_advance, _total, what):
            if what == "nests" and not mock.faults.armed:
                mock.faults.arm([parse_fault("tracker-no-target@1")])

        with pytest.raises(TargetNotFound, match="reflector N2"):
            measure(rig, store, lambda _line: None, meddle)
    store.close()


def test_another_payload_in_motion_ends_a_campaign_that_interlocks_would_suspend(tmp_path):
    file, machine = short_rig_file(seed=4, on_interlock="suspend", **SHORT)
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (mock, rig):
        rig.operator = script = Script(mock, rig)
        script.steps = ["enter"] * 5
        readings = iter(range(15))  # to the end of the third visit

        def meddle(_advance, _total, what):
            if what == "calibration" and next(readings, None) == 14:
                rig.clock.call_at(rig.clock.now_s() + 0.5, lambda: mock.plant.put_on(1))

        with pytest.raises(PlcError, match="changed during a motion"):
            measure(rig, store, lambda _line: None, meddle)
    store.close()
