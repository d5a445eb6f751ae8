"""What a stop must not wait for, what must not keep it from the other drive, and what counts as being at rest."""

from __future__ import annotations

import threading
from dataclasses import replace

import can
import pytest

from drivers.drives import cia402
from drivers.drives.drive_records import DriveSample, Heartbeat
from drivers.drives.profile_move import GroupTiming, ProfileMove, RestLimits
from drivers.errors import ConnectionFailed, NoAnswer, StaleData
from tests.drivers.drive_bench import Bench, Open

QUICK_STOP = bytes([cia402.QUICK_STOP, 0])


def _stops(bench: Bench, node: int) -> int:
    return sum(f.arbitration_id == 0x200 + node and bytes(f.data) == QUICK_STOP for f in bench.bus.sent)


def test_a_frame_that_cannot_be_sent_to_one_drive_does_not_keep_the_stop_from_the_other(opened: Open) -> None:
    bench = opened()
    bench.group.enable()

    def refuse(frame: can.Message) -> bool:
        if frame.arbitration_id == 0x201:
            raise can.CanOperationError("no buffer space available")
        return False

    bench.bus.loses = refuse
    with pytest.raises(ConnectionFailed, match="no buffer space"):
        bench.group.stop_all("a test")
    assert (_stops(bench, 1), _stops(bench, 2)) == (2, 2)
    bench.clock.sleep_s(0.5)
    assert bench.servers[1].axis.state.name == "QUICK_STOP_ACTIVE"


def test_one_lost_stop_frame_of_each_drive_does_not_matter(opened: Open) -> None:
    bench = opened()
    bench.group.enable()
    lost: list[int] = []

    def loses(frame: can.Message) -> bool:
        first = bytes(frame.data) == QUICK_STOP and frame.arbitration_id not in lost
        lost.extend([frame.arbitration_id] * first)
        return first

    bench.bus.loses = loses
    bench.group.stop_all("a test")
    bench.clock.sleep_s(0.5)
    assert sorted(lost) == [0x201, 0x202]
    assert [server.axis.state.name for server in bench.servers] == ["QUICK_STOP_ACTIVE"] * 2


def test_a_stop_does_not_wait_for_a_transfer_of_another_thread(opened: Open) -> None:
    bench = opened()
    bench.group.enable()
    busy, over = threading.Event(), threading.Event()

    def transfer() -> None:
        with bench.drives[0].sdo._lock:
            busy.set()
            over.wait(30.0)

    holder = threading.Thread(target=transfer)
    holder.start()
    busy.wait(30.0)
    stopper = threading.Thread(target=bench.group.stop_all, args=("a test",))
    stopper.start()
    stopper.join(10.0)
    stuck = stopper.is_alive()
    over.set()
    holder.join(30.0)
    stopper.join(30.0)
    assert not stuck
    assert (_stops(bench, 1), _stops(bench, 2)) == (2, 2)


AT_REST = DriveSample(cia402.TARGET_REACHED, 0.1, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "not_yet",
    [
        {"following_error_m": 21e-6},
        {"following_error_m": -21e-6},
        {"velocity_m_per_s": -1.1e-3},
        {"demand_m": 0.1 + 1.1e-6},
        {"statusword": 0},
        {"statusword": cia402.TARGET_REACHED | cia402.SET_POINT_ACKNOWLEDGED},
    ],
)
def test_every_one_of_these_counts_before_a_drive_is_at_rest(opened: Open, not_yet: dict[str, float]) -> None:
    bench = opened()
    polls: list[int] = []

    def sample() -> list[DriveSample]:
        polls.append(1)
        t_s = bench.clock.now_s()
        restless = replace(AT_REST, **not_yet) if len(polls) <= 20 else AT_REST  # type: ignore[arg-type]
        return [replace(AT_REST, t_rig_s=t_s), replace(restless, t_rig_s=t_s)]

    group = bench.group
    move = ProfileMove(group.drives, bench.clock, group._stop, sample, RestLimits(hold_s=0.0), GroupTiming())
    move.wait_for_rest([0.1, 0.1], 0.1, 60.0)
    assert len(polls) > 20 + 2


def test_a_heartbeat_from_the_future_is_none(opened: Open) -> None:
    bench = opened()
    drive = bench.drives[0]
    assert drive.heartbeat() is Heartbeat.ALIVE
    drive.messages._heartbeat_s = bench.clock.now_s() + 1.0  # the clock was set back since
    assert drive.heartbeat() is Heartbeat.LOST
    with pytest.raises(StaleData):
        drive.check()


def test_a_late_answer_to_the_sync_before_is_not_one_to_this(opened: Open) -> None:
    bench = opened()
    bench.group.sample()
    held: list[can.Message] = []

    def misses(frame: can.Message) -> bool:
        if frame.arbitration_id == 0x181 and len(held) < 2:
            held.append(frame)
            return True
        return False

    bench.bus.misses = misses
    with pytest.raises(NoAnswer, match="no PDO after SYNC"):
        bench.group.sample()
    assert len(held) == 2
    syncs = sum(frame.arbitration_id == 0x080 for frame in bench.bus.sent)
    bench.group.sample()
    assert sum(frame.arbitration_id == 0x080 for frame in bench.bus.sent) == syncs + 2  # the first one's is thrown away
