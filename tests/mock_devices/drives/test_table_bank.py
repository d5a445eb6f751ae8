"""Table images: decoded as documented, refused when damaged, interpolated bilinearly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from mock_devices.drives.table_bank import Bank, BankStatus, ImageError, decode_image, machine_id_of
from tests.mock_devices.images import MACHINE_ID, image, sealed

RNG = np.random.default_rng(5)
CORRECTIONS = RNG.integers(-30_000, 30_000, (5, 4))


def test_a_whole_image_is_decoded_field_by_field():
    table = decode_image(image(CORRECTIONS, generation=9, payload_g=200_000), 1, MACHINE_ID)
    assert (table.generation, table.payload_g, table.temperature_mdegc) == (9, 200_000, 20_000)
    assert (table.own.count, table.partner.count) == (5, 4)
    assert table.own.end_inc == 32_000_000 + 4 * 8_625_000
    assert table.corrections_inc == tuple(CORRECTIONS.ravel())
    assert machine_id_of("planar4") == MACHINE_ID


def test_interpolation_agrees_with_scipy_inside_and_at_the_ends():
    table = decode_image(image(CORRECTIONS), 1, MACHINE_ID)
    axes = [32_000_000 + 8_625_000 * np.arange(n) for n in CORRECTIONS.shape]
    reference = RegularGridInterpolator(axes, CORRECTIONS)
    points = np.column_stack([RNG.uniform(axis[0], axis[-1], 300) for axis in axes])
    corners = [(axes[0][i], axes[1][j]) for i in (0, -1) for j in (0, -1)]
    for point in [*points, *corners]:
        assert table.correction_inc(*point) == pytest.approx(reference(point).item(), abs=1e-6)
        assert table.covers(*point)


def test_an_image_by_direction_has_a_value_for_each():
    plain = decode_image(image(CORRECTIONS), 1, MACHINE_ID)
    table = decode_image(image(CORRECTIONS, sides=(1500, -700)), 1, MACHINE_ID)
    assert table.corrections_inc == plain.corrections_inc
    point = (40_000_000, 45_000_000)
    for direction, more in ((1, 1500), (-1, -700), (0, 400)):
        assert table.correction_inc(*point, direction) == pytest.approx(plain.correction_inc(*point) + more)
    assert plain.correction_inc(*point, 1) == plain.correction_inc(*point, -1)


def test_beyond_the_grid_there_is_no_cover_and_the_edge_counts():
    table = decode_image(image(CORRECTIONS), 1, MACHINE_ID)
    assert not table.covers(31_999_999, 40_000_000)
    assert not table.covers(40_000_000, table.partner.end_inc + 1)
    assert table.correction_inc(0, 0) == CORRECTIONS[0, 0]
    assert table.correction_inc(2e8, 2e8) == CORRECTIONS[-1, -1]


@pytest.mark.parametrize(
    "damage",
    [
        lambda i: b"",
        lambda i: i[:-5],
        lambda i: i + b"\0",
        lambda i: i[:60] + bytes([i[60] ^ 1]) + i[61:],
        lambda i: sealed(b"PKMX" + i[4:-4]),
        lambda i: sealed(i[:4] + b"\x02\x00" + i[6:-4]),
        lambda i: sealed(i[:4] + b"\x03\x00" + i[6:-4]),
        lambda i: sealed(i[:6] + b"\x02\x00" + i[8:-4]),
        lambda i: sealed(i[:20] + bytes(16) + i[36:-4]),
        lambda i: sealed(i[:40] + bytes(4) + i[44:-4]),
        lambda i: sealed(i[:44] + b"\x01\x00" + i[46:-4]),
        lambda i: sealed(i[:44] + b"\x41\x00" + i[46:-4]),
    ],
    ids=["empty", "short", "long", "bit", "magic", "no-sides", "version", "node", "machine", "step", "few", "many"],
)
def test_a_damaged_or_foreign_image_is_refused_and_kept_as_such(damage):
    bad = damage(image(CORRECTIONS))
    with pytest.raises(ImageError):
        decode_image(bad, 1, MACHINE_ID)
    bank = Bank(1, MACHINE_ID)
    bank.write(bad)
    assert bank.status is (BankStatus.DAMAGED if bad else BankStatus.EMPTY)
    assert bank.image == bad


@given(st.binary(max_size=400))
def test_any_bytes_are_refused_with_the_declared_error(data):
    with pytest.raises(ImageError):
        decode_image(data, 1, MACHINE_ID)


@given(st.binary(min_size=52, max_size=52), st.binary(max_size=80))
def test_any_sealed_header_is_decoded_or_refused(header, rest):
    try:
        table = decode_image(sealed(b"PKMT" + header + rest), 1, MACHINE_ID)
    except ImageError:
        return
    assert len(table.corrections_inc) == table.own.count * table.partner.count


def test_a_bank_reports_what_it_holds():
    bank = Bank(1, MACHINE_ID)
    assert (bank.status, bank.crc, bank.image) == (BankStatus.EMPTY, 0, b"")
    whole = image(CORRECTIONS)
    bank.write(whole)
    assert bank.status is BankStatus.WHOLE
    assert bank.crc == int.from_bytes(whole[-4:], "little")
