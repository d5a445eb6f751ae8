"""What touches, drags or falls in outside the catalogue: what descriptions say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import OUTSIDE, SPECS, EffectChoice, EffectError
from mock_devices.effects.in_space import check_in_space
from mock_devices.spatial_file import read_spatial_machine
from tests.mock_devices.effects_bench import FILE, HOME_M, MACHINE, Alone, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
EFFECTS = ("touching_post", "dragged_seat", "toothed_brake")


def test_they_are_ordinary_effects_outside_the_catalogue():
    assert set(EFFECTS) <= set(OUTSIDE)
    assert {SPECS[name].final for name in EFFECTS} == {"cubic"}


def _height_m(q_m):
    """Height of the platform's origin if both drives stand at q_m: by the triangle of two struts of equal length."""
    one, other = (next(s for s in FILE.struts if s.drive == a) for a in (0, 1))
    here, there = (s.base_joint - s.platform_joint + 1j * q_m for s in (one, other))
    assert here.imag == pytest.approx(there.imag)
    return here.imag - FILE.sliders[0].branch * math.sqrt(one.length_m**2 - (0.5 * abs(there - here)) ** 2)


def test_a_post_pushes_the_platform_up_where_it_is_low():
    one = Alone("touching_post", 900.0)
    low, high = (y - FILE.tool_point.imag for y in FILE.workspace_m[1])
    touches_m = 0.5 * (low + high)
    at = np.linspace(LOW_M, HIGH_M, 15)
    ((point, force),) = one.deviation(t_s=np.zeros(15), q=np.stack([at, at], axis=1)).loads
    assert point == pytest.approx(np.full(15, 0.12 - 0.1j))
    assert not np.any(force.real)
    heights = np.array([_height_m(q) for q in at.tolist()])
    pressed = np.maximum(touches_m - heights, 0.0) / (touches_m - low)
    assert force.imag == pytest.approx(900.0 * pressed, abs=1e-9)
    assert np.any(force.imag == 0.0)
    assert force.imag.max() > 600.0
    one.move(0, 1.5)
    again = one.deviation(t_s=np.zeros(15), q=np.stack([at, at], axis=1)).loads[0][1]
    assert again == pytest.approx(force)  # whatever side it came from


def test_a_slider_drags_a_hose_along_that_draws_its_seat_back():
    one = Alone("dragged_seat", 3e-5, place="right_lower")
    seat = 0.5 * (LOW_M + HIGH_M)
    for to_m in (1.3, 1.25, 1.15, 0.6, 0.75, 0.9, 0.89):
        one.move(0, 1.7 - 0.5 * to_m)  # another strut's
        one.move(1, to_m, speed=0.1 + 0.2 * to_m, rest_s=3.0)
        lag_m = seat - to_m
        if lag_m > 0.1:
            seat = to_m + 0.1
        elif lag_m < -0.1:
            seat = to_m - 0.1
        d = one.deviation()
        expected = np.zeros(4, dtype=complex)
        expected[3] = FILE.sliders[1].axis * 3e-5 * (seat - to_m) / 0.1
        assert d.base_joint_m[0] == pytest.approx(expected, abs=1e-15)
        assert not np.any(d.travel_m)
    assert seat == pytest.approx(0.8)


def test_a_brake_draws_its_slider_to_the_next_tooth_at_rest():
    one = Alone("toothed_brake", 3e-5, place="right")
    one.move(1, HOME_M + 0.2, rest_s=0.0)
    at = HOME_M + np.linspace(0.0, 0.012, 241)

    def drawn(rested_s):
        d = one.deviation(t_s=np.full(241, one.t_s + rested_s), q=along(at, drive=1))
        assert not np.any(d.travel_m[:, 0])
        return d.travel_m[:, 1]

    assert not np.any(drawn(2.9))
    whole = drawn(7.5)
    assert drawn(5.0) == pytest.approx(0.5 * whole)
    assert drawn(600.0) == pytest.approx(whole)
    tooth_m = HOME_M - HOME_M % 0.006 - one.effect.phase / (2.0 * math.pi) * 0.006
    teeth_m = tooth_m + 0.006 * np.arange(-2.0, 6.0)
    nearest = teeth_m[np.argmin(np.abs(at[:, None] - teeth_m), axis=1)]
    clear = np.abs(np.abs(nearest - at) - 0.003) > 1e-9  # midway between two teeth it may go to either
    assert whole[clear] == pytest.approx((3e-5 * (nearest - at) / 0.003)[clear], abs=1e-14)
    assert np.abs(whole).max() > 2.9e-5


@pytest.mark.parametrize("name", ["stewart6", "delta6"])
def test_machines_in_space_have_them_where_they_have_the_parts(name):
    file = read_spatial_machine(MACHINE.with_name(f"{name}.toml"))
    for effect in EFFECTS:
        choice = EffectChoice(effect, SPECS[effect].size.typical)
        why = {
            "touching_post": "does not have it",
            "dragged_seat": "no sliders, which alone have guides" if name == "stewart6" else "",
        }.get(effect, "")
        if why:
            with pytest.raises(EffectError, match=why):
                check_in_space(choice, file)
        else:
            check_in_space(choice, file)
