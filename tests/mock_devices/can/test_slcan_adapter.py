"""The slcan adapter: golden lines, any lines, and python-can's own client."""

from __future__ import annotations

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_devices.can.slcan_adapter import SlcanAdapter, format_frame, parse_frame
from tests.either import either

GOLDEN = [
    (b"t18131A2B3C", 0x181, False, b"\x1a\x2b\x3c"),
    (b"t0800", 0x080, False, b""),
    (b"T0000012F2BEEF", 0x12F, True, b"\xbe\xef"),
]


@pytest.mark.parametrize(("line", "identifier", "extended", "data"), GOLDEN)
def test_golden_lines(line, identifier, extended, data):
    frame = parse_frame(line)
    assert (frame.arbitration_id, frame.is_extended_id, bytes(frame.data)) == (identifier, extended, data)
    assert format_frame(frame) == line + b"\r"


@given(st.one_of(st.binary(max_size=40), st.from_regex(rb"\A[tT][0-9A-F]{0,12}\Z")))
def test_any_line_is_a_frame_or_a_value_error(line):
    frame, complaint = either(lambda: parse_frame(line), ValueError)
    if frame is not None:
        assert format_frame(frame).rstrip(b"\r").upper() == line.upper()
    else:
        assert complaint
        assert line not in [golden[0] for golden in GOLDEN]


def test_another_makes_client(bus_factory):
    other = bus_factory()
    adapter = SlcanAdapter(bus_factory())
    host = can.Bus(interface="slcan", channel=adapter.port, bitrate=1_000_000, sleep_after_open=0.0)
    host.send(can.Message(arbitration_id=0x601, data=b"12345678", is_extended_id=False))
    frame = other.recv(5.0)
    assert (frame.arbitration_id, bytes(frame.data)) == (0x601, b"12345678")
    other.send(can.Message(arbitration_id=0x581, data=b"abc", is_extended_id=False))
    frame = host.recv(5.0)
    assert (frame.arbitration_id, bytes(frame.data)) == (0x581, b"abc")
    host.shutdown()
    adapter.close()
    adapter.close()
