"""The rig clock: order, lending, holding; nothing here waits for host time to pass."""

from __future__ import annotations

import queue
import threading

import pytest

from pkm_rig.rig.clock import ScaledClock, VirtualClock


@pytest.fixture
def clock():
    clock = VirtualClock()
    yield clock
    clock.close()


def test_time_stands_still_while_an_activity_runs_and_jumps_when_it_sleeps(clock):
    with clock.activity():
        assert clock.now_s() == 0.0
        clock.sleep_s(3600.0)
        assert clock.now_s() == 3600.0


def test_two_activities_meet_their_events_in_order(clock):
    seen: list[tuple[str, float]] = []
    start = threading.Barrier(2)

    def run(name: str, step_s: float, count: int) -> None:
        with clock.activity():
            start.wait()
            for _ in range(count):
                clock.sleep_s(step_s)
                seen.append((name, clock.now_s()))

    threads = [threading.Thread(target=run, args=a) for a in (("a", 3.0, 4), ("b", 5.0, 3))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(5.0)
    times = [t for _, t in seen]
    assert times == sorted(times)
    assert sorted(seen) == [
        ("a", 3.0),
        ("a", 6.0),
        ("a", 9.0),
        ("a", 12.0),
        ("b", 5.0),
        ("b", 10.0),
        ("b", 15.0),
    ]


def test_a_server_that_sleeps_lends_its_clients_turn(clock):
    requests: queue.Queue[str] = queue.Queue()
    replies: queue.Queue[float] = queue.Queue()

    def serve() -> None:
        requests.get(timeout=5.0)
        clock.sleep_s(2.0)
        replies.put(clock.now_s())

    server = threading.Thread(target=serve)
    server.start()
    with clock.activity():
        requests.put("measure")
        assert replies.get(timeout=5.0) == 2.0
    server.join(5.0)


def test_callbacks_do_not_make_time_run_away(clock):
    calls: list[float] = []

    def beat() -> None:
        calls.append(clock.now_s())
        clock.call_at(clock.now_s() + 0.5, beat)

    clock.call_at(0.5, beat)
    with clock.activity():
        clock.sleep_s(1.9)
    assert calls == [0.5, 1.0, 1.5]


def test_a_frame_in_flight_holds_time(clock):
    clock.hold()
    woke = threading.Event()

    def sleeper() -> None:
        with clock.activity():
            clock.sleep_s(1.0)
            woke.set()

    thread = threading.Thread(target=sleeper)
    thread.start()
    clock.call_at(0.5, lambda: None)
    assert not woke.is_set()
    assert clock.now_s() == 0.0
    clock.release()
    thread.join(5.0)
    assert woke.is_set()


def test_a_cancelled_callback_is_not_called(clock):
    calls: list[int] = []
    cancel = clock.call_at(1.0, lambda: calls.append(1))
    cancel()
    with clock.activity():
        clock.sleep_s(2.0)
    assert calls == []


def test_closing_wakes_sleepers():
    clock = VirtualClock()
    clock.hold()
    thread = threading.Thread(target=clock.sleep_s, args=(1.0,))
    clock.hold()
    thread.start()
    clock.close()
    thread.join(5.0)
    assert not thread.is_alive()


def test_scaled_clock_calls_back_and_refuses_a_scale_of_zero():
    with pytest.raises(ValueError, match="positive"):
        ScaledClock(0.0)
    clock = ScaledClock(1e6)
    called = threading.Event()
    clock.call_at(clock.now_s() + 1.0, called.set)
    assert called.wait(5.0)
    clock.close()


def test_both_clocks_begin_where_they_are_told_to():
    virtual, scaled = VirtualClock(5000.0), ScaledClock(2.0, 5000.0)
    called = threading.Event()
    scaled.call_at(5000.001, called.set)
    with virtual.activity():
        virtual.sleep_s(2.0)
    assert virtual.now_s() == 5002.0
    assert 5000.0 <= scaled.now_s() < 5100.0
    assert called.wait(5.0)
    virtual.close()
    scaled.close()
