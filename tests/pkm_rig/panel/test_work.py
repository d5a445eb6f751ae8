"""Jobs that pages start: what they need, what stops them, and that no page is part of them."""

from __future__ import annotations

import threading

import pytest

from calibration.base.errors import InputError
from pkm_rig.panel.actions import Action
from pkm_rig.panel.control import NotInControl
from pkm_rig.store.store import open_existing_store
from tests.pkm_rig.conftest import SHORT
from tests.pkm_rig.panel.bench import LIMIT_S, Bench

GUARD = 0
MEASURE = Action("measure")


@pytest.fixture
def bench(tmp_path):
    bench = Bench(tmp_path / "runs", on_interlock="suspend")
    bench.work.control.take("a")
    yield bench
    bench.work.close()


def waits(bench):
    """Wait until the campaign waits for its operator."""
    waiting = threading.Event()
    begin, bench.work.operator.begin_wait = bench.work.operator.begin_wait, None

    def begin_wait():
        begin()
        waiting.set()

    bench.work.operator.begin_wait = begin_wait
    return waiting


def test_a_measurement_through_interlock_lost_page_and_second_page(bench):
    """One campaign: the guard opens in motion, the page that has control is lost, another takes it and lets go on."""
    waiting, powered = waits(bench), []

    def guard_opens_and_page_is_lost():
        bench.mock.plc.set_interlock(GUARD, good=False)
        bench.work.control.leave("a")

    bench.at[20] = guard_opens_and_page_is_lost
    bench.press_twice(MEASURE)
    assert waiting.wait(LIMIT_S)
    assert bench.work.is_busy
    bench.work.control.take("b")
    with pytest.raises(NotInControl):
        bench.work.press("a", Action("go on"))

    bench.mock.plc.set_interlock(GUARD, good=True)  # the guard closes: nothing may move by that
    looks = iter(range(30))
    acknowledges = bench.work.operator.acknowledges
    seen_thirty = threading.Event()

    def acknowledged():
        powered.append(any(drive.axis.powered for drive in bench.mock.drives))
        if next(looks, None) is None:
            seen_thirty.set()
        return acknowledges()

    bench.work.operator.acknowledges = acknowledged
    assert seen_thirty.wait(LIMIT_S)
    assert bench.work.operator.waits
    assert not any(powered)
    bench.press_twice(Action("go on"), "b")
    assert bench.payload_is_on.wait(LIMIT_S)
    bench.work.stop()
    result = bench.end()
    with open_existing_store(bench.work.out) as store:
        held = [event.data["reason"] for event in store.events(result.campaign, "held")]
    assert any("guard closed" in reason for reason in held)
    assert held[-1] == "the payload is on"  # behind each payload somebody says that the machine may move
    assert bench.connections == 1


def test_stop_in_motion_ends_the_campaign_from_any_page_and_it_can_go_on(bench):
    bench.at[25] = bench.work.stop  # pages need no control for it
    bench.press_twice(MEASURE)
    result = bench.end()
    assert not result.good
    assert "stopped from the page" in result.line
    assert bench.rig.drives.stop_reason is not None
    assert not any(drive.axis.powered for drive in bench.mock.drives)
    with open_existing_store(bench.work.out) as store:
        assert store.count_readings(result.campaign) == 25
        assert store.campaigns()[0].state == "failed"
    assert result.goes_on == Action("measure", result.campaign)
    bench.press_twice(result.goes_on)
    bench.at[30] = bench.work.stop
    again = bench.end()
    assert "stopped from the page" in again.line
    assert again.campaign == result.campaign
    with open_existing_store(bench.work.out) as store:
        assert store.count_readings(result.campaign) == 30


def test_stop_before_the_rig_is_connected_reaches_it(bench):
    connect = bench.work._place.connect

    def stop_and_connect(*arguments, **options):
        bench.work.stop()
        return connect(*arguments, **options)

    object.__setattr__(bench.work._place, "connect", stop_and_connect)
    bench.press_twice(MEASURE)
    result = bench.end()
    assert not result.good
    assert "stopped from the page" in result.line


def test_stop_while_it_waits_ends_it(bench):
    waiting = waits(bench)
    bench.at[20] = lambda: bench.work.pause("a")
    bench.press_twice(MEASURE)
    assert waiting.wait(LIMIT_S)
    bench.work.stop()
    result = bench.end()
    assert "stopped from the page" in result.line
    assert not bench.work.operator.waits


def test_without_the_key_nothing_gets_power(tmp_path):
    bench = Bench(tmp_path / "runs", released=False)
    bench.work.control.take("a")
    for kind in ("measure", "home", "tables off"):
        bench.press_twice(Action(kind))
        result = bench.end()
        assert not result.good
        assert "local release is off" in result.line
        assert not any(drive.axis.powered for drive in bench.mock.drives)
    assert bench.work.press("a", Action("check")) is None  # looking needs no key
    assert bench.end().good


def test_the_key_turned_off_in_motion_stops_and_the_campaign_waits_for_it(bench):
    waiting = waits(bench)
    bench.at[20] = lambda: bench.mock.plc.state.set_release(False)
    bench.press_twice(MEASURE)
    assert waiting.wait(LIMIT_S)
    bench.work.operator.let_go_on()  # a press that came although the button was grey
    bench.mock.plc.state.acknowledge()
    assert not bench.work.wait(0.3)
    assert not any(drive.axis.powered for drive in bench.mock.drives)
    bench.mock.plc.state.set_release(True)
    bench.at[24] = bench.work.stop
    assert "stopped from the page" in bench.go_on_whenever_asked().line
    assert bench.work.live.snapshot().done == 24


def test_without_the_register_of_the_key_the_page_starts_no_motion(tmp_path):
    bench = Bench(tmp_path / "runs", registers={})
    bench.work.control.take("a")
    for kind in ("measure", "calibrate", "home", "home again", "tables off", "tables rollback"):
        with pytest.raises(InputError, match="local_release"):
            bench.work.press("a", Action(kind))
    assert bench.connections == 0


def test_two_presses_begin_one_job_and_two_controllers_are_one(bench):
    first, second = bench.work.press("a", MEASURE), bench.work.press("a", MEASURE)
    bench.clock_s += 1.0
    with pytest.raises(InputError):
        bench.work.press_again("a", first.secret)  # void since the second
    bench.work.control.take("b")
    with pytest.raises(NotInControl):
        bench.work.press_again("a", second.secret)
    for kind in ("check", "measure", "diagnose"):
        with pytest.raises(NotInControl):
            bench.work.press("a", Action(kind, "x"))
    with pytest.raises(NotInControl):
        bench.work.pause("a")
    assert bench.work.job is None
    assert bench.connections == 0


def test_one_job_at_a_time(bench):
    bench.press_twice(MEASURE)
    with pytest.raises(InputError, match="measure is under way"):
        bench.work.press("a", Action("check"))
    bench.work.stop()
    bench.end()


def test_nothing_goes_on_that_does_not_wait(bench):
    with pytest.raises(InputError, match="nothing waits"):
        bench.work.press("a", Action("go on"))


def test_the_second_press_names_what_will_move(bench):
    text = bench.work.press("a", MEASURE).text
    assert "Drives left and right of embedded-mock" in text
    assert "x -350 mm to 350 mm" in text
    assert f" {max(SHORT['speeds_m_per_s']):g} m/s" in text
    assert "plates 400 kg" in text
    assert "No drive moves" in bench.work.press("a", Action("tables off")).text
    assert (
        "left" in bench.work.press("a", Action("home")).text
        or "says of none" in bench.work.press("a", Action("home")).text
    )


def test_what_needs_a_campaign_names_one():
    with pytest.raises(InputError, match="of which campaign"):
        Action("verify")
    with pytest.raises(InputError, match="of which campaign"):
        Action("measure", new_setup=True)
