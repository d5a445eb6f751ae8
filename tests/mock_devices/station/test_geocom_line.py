"""GeoCOM lines: golden bytes, and any bytes at all."""

from __future__ import annotations

import pytest
from geocompy.communication import crc16_bytewise
from hypothesis import given
from hypothesis import strategies as st

from mock_devices.station.geocom_line import LineError, Request, crc16, format_answer, parse_request
from mock_devices.station.station_server import LineBuffer


@pytest.mark.parametrize(
    ("line", "request_"),
    [
        (b"%R1Q,0:", Request(0, 0, (), False)),
        (b"%R1Q,0,7:", Request(0, 7, (), False)),
        (b"%R1Q,9027,12:0.5,1.25,0,1,0", Request(9027, 12, ("0.5", "1.25", "0", "1", "0"), False)),
        (b"%R1Q,107,1,9057:15", Request(107, 1, ("15",), True)),
    ],
)
def test_requests_are_parsed(line, request_):
    if request_.checked:
        line = b"%%R1Q,107,1,%d:15" % crc16(b"%R1Q,107,1:15")
    assert parse_request(line) == request_


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (b"%R1Q", 3080),
        (b"%R1Q,abc,1:", 3080),
        (b"%R1Q,0,32768:", 3080),
        (b"%R1Q,0,1,99:", 3101),
        (b"%R1Q,0,1:\xff", 3080),
    ],
)
def test_broken_requests_have_a_code(line, code):
    with pytest.raises(LineError) as error:
        parse_request(line)
    assert error.value.com_code == code


@given(st.one_of(st.binary(max_size=80), st.binary(max_size=60).map(lambda b: b"%R1Q," + b)))
def test_any_bytes_are_a_request_or_the_declared_error(line):
    try:
        request = parse_request(line)
    except LineError:
        return
    assert 0 <= request.transaction <= 32767


@given(st.binary(max_size=60))
def test_the_checksum_is_that_of_the_client(data):
    assert crc16(data) == crc16_bytewise(data)


def test_answers_are_formatted():
    assert format_answer(0, 3, 0) == b"%R1P,0,3:0\r\n"
    assert format_answer(0, 3, 0, (1.5, 2, "x", True), decimals=4) == b'%R1P,0,3:0,1.5000,2,"x",1\r\n'
    checked = format_answer(0, 3, 0, (7,), checked=True)
    assert checked == b"%%R1P,0,3,%d:0,7\r\n" % crc16(b"%R1P,0,3:0,7")


@given(st.lists(st.sampled_from([b"%R1Q,0:", b"\r\n", b"\n", b"x", b"\r"]), max_size=12), st.data())
def test_lines_do_not_depend_on_how_the_bytes_were_cut(parts, data):
    stream = b"".join(parts)
    cut = data.draw(st.integers(0, len(stream)))
    whole, halves = LineBuffer(), LineBuffer()
    assert whole.feed(stream) == halves.feed(stream[:cut]) + halves.feed(stream[cut:])


def test_a_lone_line_feed_clears_what_was_begun():
    buffer = LineBuffer()
    assert buffer.feed(b"%R1Q,garb\n%R1Q,0,1:\r\n") == [b"%R1Q,0,1:"]
    assert buffer.feed(b"x" * 5000) == []
    assert buffer.feed(b"\r\n") == []
