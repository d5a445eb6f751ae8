"""The image of a compensation table."""

from __future__ import annotations

import dataclasses
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drivers.drives.table_image import TableImage, decode_table, encode_table, image_crc, machine_id_of
from drivers.errors import TableError
from mock_devices.drives import table_bank as mock_bank


def make_image(corrections: np.ndarray | None = None, **changes: object) -> TableImage:
    image = TableImage(
        node_id=1,
        generation=3,
        payload_kg=200.0,
        temperature_c=20.5,
        machine_id=machine_id_of("planar4"),
        own_start_m=-0.4,
        own_step_m=0.05,
        partner_start_m=-0.3,
        partner_step_m=0.04,
        corrections_m=np.arange(6.0).reshape(2, 3) * 1e-6 if corrections is None else corrections,
    )
    return dataclasses.replace(image, **changes)  # type: ignore[arg-type]


def test_golden_bytes() -> None:
    data = encode_table(make_image())
    assert data[:4] == b"PKMT"
    assert struct.unpack_from("<HHIIi", data, 4) == (1, 1, 3, 200_000, 20_500)
    assert struct.unpack_from("<iiHiiH", data, 36) == (-40_000_000, 5_000_000, 2, -30_000_000, 4_000_000, 3)
    assert struct.unpack_from("<6i", data, 56) == (0, 100, 200, 300, 400, 500)
    assert len(data) == 56 + 24 + 4
    assert image_crc(data) == zlib.crc32(data[:-4])


def test_golden_bytes_by_direction() -> None:
    data = encode_table(make_image(up_m=15e-6, down_m=-7e-6))
    assert struct.unpack_from("<H", data, 4) == (2,)
    assert struct.unpack_from("<ii", data, 56) == (1500, -700)
    assert struct.unpack_from("<6i", data, 64) == (0, 100, 200, 300, 400, 500)
    assert len(data) == 64 + 24 + 4
    back = decode_table(data)
    assert (back.up_m, back.down_m) == pytest.approx((15e-6, -7e-6))
    assert np.array_equal(back.corrections_m, decode_table(encode_table(make_image())).corrections_m)


def test_the_mock_reads_both_versions_as_they_are_written() -> None:
    for sides in ((0.0, 0.0), (15e-6, -7e-6)):
        image = make_image(up_m=sides[0], down_m=sides[1])
        read = mock_bank.decode_image(encode_table(image), 1, image.machine_id)
        assert (read.up_inc * 1e-8, read.down_inc * 1e-8) == pytest.approx(sides)
        np.testing.assert_allclose(np.reshape(read.corrections_inc, (2, 3)) * 1e-8, image.corrections_m)


@given(
    arrays(
        np.int32,
        st.tuples(st.integers(2, 9), st.integers(2, 9)),
        elements=st.integers(-(2**31) + 1, 2**31 - 1),
    )
)
def test_round_trip(counts: np.ndarray) -> None:
    image = make_image(counts * 1e-8)
    back = decode_table(encode_table(image))
    assert np.array_equal(np.rint(back.corrections_m / 1e-8), counts)
    for field in dataclasses.fields(TableImage):
        if field.name != "corrections_m":
            assert getattr(back, field.name) == pytest.approx(getattr(image, field.name))


@given(st.binary(max_size=200))
def test_any_bytes(data: bytes) -> None:
    with pytest.raises(TableError):
        decode_table(data)


@given(st.binary(min_size=56, max_size=300))
def test_any_bytes_with_a_good_crc(body: bytes) -> None:
    data = body + zlib.crc32(body).to_bytes(4, "little")
    with pytest.raises(TableError):
        decode_table(data)


@given(st.integers(0, 83), st.integers(1, 255))
def test_any_changed_byte(position: int, change: int) -> None:
    data = bytearray(encode_table(make_image()))
    data[position] ^= change
    with pytest.raises(TableError):
        decode_table(bytes(data))


@pytest.mark.parametrize(
    ("offset", "layout", "value"),
    [(40, "<i", 0), (40, "<i", -1), (44, "<H", 65), (54, "<H", 1), (54, "<H", 4)],
)
def test_a_whole_crc_over_nonsense(offset: int, layout: str, value: int) -> None:
    body = bytearray(encode_table(make_image())[:-4])
    struct.pack_into(layout, body, offset, value)
    with pytest.raises(TableError):
        decode_table(bytes(body) + zlib.crc32(body).to_bytes(4, "little"))


@pytest.mark.parametrize(
    "changes",
    [
        {"corrections": np.zeros((1, 5))},
        {"corrections": np.zeros((65, 5))},
        {"corrections": np.zeros(5)},
        {"corrections": np.full((2, 2), np.nan)},
        {"corrections": np.full((2, 2), 1e9)},
        {"own_step_m": 0.0},
        {"own_step_m": -0.1},
        {"own_start_m": 1e9},
        {"partner_start_m": float("nan")},
        {"payload_kg": -1.0},
        {"payload_kg": 5e6},
        {"temperature_c": float("inf")},
        {"machine_id": b"short"},
        {"node_id": 70_000},
        {"generation": -1},
        {"up_m": float("nan")},
        {"down_m": 1e9},
        {"metres_per_increment": 0.0},
    ],
)
def test_what_cannot_be_encoded(changes: dict[str, object]) -> None:
    with pytest.raises(TableError):
        encode_table(make_image(**changes))  # type: ignore[arg-type]
