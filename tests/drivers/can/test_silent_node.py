"""A node that answers nothing is not waited for at every object, and is heard again as soon as it answers."""

from __future__ import annotations

import can
import pytest

from drivers.can.can_line import CanLine
from drivers.can.sdo import SdoAccess
from drivers.drives.objects import STATUSWORD
from drivers.errors import NoAnswer

TIMEOUT_S = 0.4


class Node(can.Listener):
    """Answers uploads with the number 7, while it answers at all; counts requests."""

    def __init__(self, bus):
        self.bus, self.answers, self.requests = bus, True, 0

    def on_message_received(self, msg):
        if msg.arbitration_id == 0x601 and msg.data[0] == 0x40:
            self.requests += 1
            if self.answers:
                answer = bytes([0x4B]) + bytes(msg.data[1:4]) + b"\x07\0\0\0"
                self.bus.send(can.Message(arbitration_id=0x581, data=answer, is_extended_id=False))


@pytest.fixture
def node():
    with can.Bus("silent-node", interface="virtual") as bus:
        node = Node(bus)
        notifier = can.Notifier(bus, [node], timeout=0.01)
        yield node
        notifier.stop()


@pytest.fixture
def sdo(node):
    with CanLine(can.Bus("silent-node", interface="virtual")) as line:
        yield SdoAccess(line, 1, "left", TIMEOUT_S)


def test_a_silent_node_is_asked_no_more_for_a_while_and_then_once(node, sdo, monkeypatch):
    assert sdo.read(STATUSWORD) == 7
    node.answers = False
    for _ in range(2):
        with pytest.raises(NoAnswer):
            sdo.read(STATUSWORD)
    asked = node.requests
    assert asked == 2 + 4  # the harmless object and this one; then this one, and the harmless one three times
    now_s = sdo._unanswered_s
    monkeypatch.setattr("drivers.can.sdo.time.monotonic", lambda: now_s + 3.9 * TIMEOUT_S)
    for _ in range(10):
        with pytest.raises(NoAnswer):
            sdo.read(STATUSWORD)
    assert node.requests == asked
    node.answers = True
    monkeypatch.setattr("drivers.can.sdo.time.monotonic", lambda: now_s + 4.1 * TIMEOUT_S)
    assert sdo.read(STATUSWORD) == 7


def test_one_lost_answer_is_asked_for_again(node, sdo):
    assert sdo.read(STATUSWORD) == 7
    node.answers = False
    with pytest.raises(NoAnswer):
        sdo.read(STATUSWORD, retry=False)
    node.answers = True
    assert sdo.read(STATUSWORD) == 7
