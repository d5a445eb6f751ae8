"""Another master on our line: every frame by which it could move or set one of our drives is noticed."""

from __future__ import annotations

import can
import pytest

from drivers.errors import DeviceError, OtherMaster
from tests.drivers.drive_bench import MASTER, Bench, Open

FRAMES = [
    (0x000, bytes([1, 0]), "an NMT command"),
    (0x000, bytes([129, 2]), "an NMT command"),
    (0x080, b"", "SYNC"),
    (0x201, bytes([0x1F, 0]), r"RPDO1 \(controlword\) to node 1"),
    (0x302, bytes(4), "RPDO2 or 3 to node 2"),
    (0x401, bytes(4), "RPDO3 to node 1"),
    (0x502, bytes(4), "RPDO4 to node 2"),
    (0x601, bytes([0x40, 0x41, 0x60, 0, 0, 0, 0, 0]), "an SDO request to node 1"),
    (0x700 + MASTER, bytes([5]), f"the heartbeat of node {MASTER}"),
]
HARMLESS = [
    (0x000, bytes([1, 9])),  # to a node that is not ours
    (0x100, bytes(6)),  # time stamp
    (0x609, bytes(8)),
    (0x209, bytes(2)),
    (0x281, bytes(8)),  # a drive's TPDO2, which is the other's RPDO2
    (0x589, bytes(8)),
    (0x709, bytes([5])),
    (0x7E5, bytes(8)),  # LSS
]


def _put(bench: Bench, cob_id: int, data: bytes, **how: bool) -> None:
    """The host's bus only: what the drives make of it is not the question here."""
    bench.clock.hold()
    bench.bus.queue.put(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False, **how))


def _hears(bench: Bench, cob_id: int, data: bytes, **how: bool) -> None:
    _put(bench, cob_id, data, **how)
    _put(bench, 0x77D, b"\5")
    while 0x7D not in bench.line.seen_nodes:  # frames keep their order: when this has come, so has that
        bench.clock.sleep_s(0.01)


@pytest.mark.parametrize(("cob_id", "data", "what"), FRAMES)
def test_a_frame_of_another_master_is_noticed(opened: Open, cob_id: int, data: bytes, what: str) -> None:
    bench = opened()
    bench.line.watch_for_other_masters((1, 2), MASTER)
    bench.line.require_only_master()
    _hears(bench, cob_id, data)
    with pytest.raises(OtherMaster, match=f"another master on CAN has sent {what}"):
        bench.line.require_only_master()


@pytest.mark.parametrize(("cob_id", "data"), HARMLESS)
def test_what_is_sent_to_others_or_by_them_is_not(opened: Open, cob_id: int, data: bytes) -> None:
    bench = opened()
    bench.line.watch_for_other_masters((1, 2), MASTER)
    _hears(bench, cob_id, data)
    bench.line.require_only_master()


def test_an_echo_of_our_own_frame_is_not_either(opened: Open) -> None:
    bench = opened()
    bench.line.watch_for_other_masters((1, 2), MASTER)
    _hears(bench, 0x201, bytes([0x1F, 0]), is_rx=False)
    bench.line.require_only_master()


def test_a_move_of_ours_is_not_taken_for_one_and_a_foreign_command_ends_it(opened: Open) -> None:
    bench = opened()
    bench.line.watch_for_other_masters((1, 2), MASTER)
    bench.group.enable()
    bench.group.move_to([0.01, 0.01], 0.1)
    bench.clock.call_at(bench.clock.now_s() + 0.5, lambda: _put(bench, 0x202, bytes([0x0F, 0])))
    with pytest.raises(DeviceError, match="another master"):
        bench.group.move_to([0.4, 0.4], 0.1)
    assert bench.group.stop_reason is not None
