"""What effects know of a campaign, against histories integrated step by step."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from calibration.effects.api import EffectInputs
from calibration.effects.catalogue import load_catalogue
from calibration.effects.combined_context import CachedContext, cached_context, clip_to_campaign, combine_contexts
from calibration.effects.context import context_of_recording
from calibration.effects.departures import functions_it_varies_with
from calibration.recording.header import KnownTable
from mock_devices.recordings.design import DesignOptions
from tests.calibration.diagnosis.campaigns import changed, plant, recorded

SWING = ((3600.0, 0.0), (3601.0, 3.0), (5000.0, -2.0), (9000.0, 1.0))


@pytest.fixture(scope="module")
def bench():
    return plant(60, temperature_programme=SWING, design=DesignOptions(fly_share=0.2))


@pytest.fixture(scope="module")
def recording(bench):
    return recorded(bench)


@pytest.fixture(scope="module")
def m(recording):
    return context_of_recording(recording)


def test_moments_are_those_of_the_design(bench, recording, m):
    visits = bench.timeline.design.visits
    on_pose = np.asarray(recording["phase"]) != "nests"
    of = recording["visit"].astype(int)[on_pose]
    assert m.direction[on_pose] == pytest.approx(np.array([visits[v].direction for v in of], dtype=float))
    assert np.array_equal(m.moving[on_pose], [visits[v].on_the_fly for v in of])
    assert not np.any(m.moving[~on_pose])
    assert np.array_equal(m.arrival[on_pose], of)
    assert len(m.history.arrived_s) == len(visits)
    assert np.all(np.diff(m.history.arrived_s) > 0.0)
    assert np.array_equal(m.history.drives[m.arrival][on_pose], m.drives[on_pose])
    former = np.maximum(of - 1, 0)
    assert m.previous_drives[on_pose] == pytest.approx(m.history.drives[former])


def test_what_a_drive_at_rest_reports_as_its_velocity_is_no_motion(m):
    """Encoders make noise of a tenth of a millimetre a second; the slowest motion is a centimetre a second."""
    noise = 2e-4 * np.random.default_rng(5).standard_normal(m.velocity_m_per_s.shape)
    noisy = replace(m, velocity_m_per_s=m.velocity_m_per_s + noise)
    assert np.array_equal(noisy.moving, m.moving)
    assert not np.all(m.moving)
    creeping = replace(m, velocity_m_per_s=np.where(m.moving[:, None], np.sign(m.velocity_m_per_s) * 1e-2, 0.0))
    assert np.array_equal(creeping.moving, m.moving)


def test_the_way_of_a_drive_is_the_sum_of_all_its_motions(m):
    for drive in range(2):
        way, longest = 0.0, [0.0]
        for before, after in pairwise(m.history.drives[:, drive]):
            way += abs(after - before)
            longest.append(way)
        assert m.way_m(drive) == pytest.approx([longest[arrival] for arrival in m.arrival])


def test_a_pause_is_what_is_left_of_the_time_between_two_arrivals_without_the_motion(m):
    arrived_s, places = m.history.arrived_s, m.history.drives
    for reading in range(0, len(m), 7):
        k = int(m.arrival[reading])
        way_m = np.abs(places[k] - places[k - 1]).max() if k else 0.0
        stood_s = arrived_s[k] - arrived_s[k - 1] - way_m / m.speed_m_per_s[reading] if k else 0.0
        assert m.pause_s()[reading] == pytest.approx(max(stood_s, 0.0), abs=1e-6)
    assert np.median(m.pause_s()) > 5.0


def test_the_way_beyond_a_campaign_ends_where_the_campaign_did(m):
    """What is asked of a twin later is no longer way than it has seen."""
    history = replace(m.history, drives=m.history.drives + 0.3 * (-1.0) ** np.arange(len(m.history.drives))[:, None])
    other = replace(m, history=history)
    clipped = clip_to_campaign(m, other)
    rows = np.arange(0, len(m), 5)
    combined = combine_contexts(CachedContext(m), clipped, cached_context(clipped, other), rows)
    for drive in range(2):
        own = m.way_m(drive)
        assert other.way_m(drive).max() > own.max() + 1.0
        assert np.array_equal(combined.way_m(drive)[: len(m)], own)
        assert combined.way_m(drive)[len(m) :] == pytest.approx(np.minimum(other.way_m(drive)[rows], own.max()))


def test_what_a_campaign_does_not_say_is_not_said_to_its_twin_either(m):
    """Effects would have other columns there than those that were found."""
    campaign = replace(m, breaks_s=(float(m.t_s.mean()),), missing={"torque": "nobody has recorded it"})
    clipped = clip_to_campaign(campaign, m)
    rows = np.arange(0, len(m), 7)
    combined = combine_contexts(CachedContext(campaign), clipped, cached_context(clipped, m), rows)
    assert combined.not_said == campaign.not_said
    assert set(combined.not_said) == {"t_s", "torque"}


def test_the_mean_temperature_stays_within_that_of_the_campaign(m):
    """Of two parts in antiphase the mean hardly varies; both at their warmest were never seen."""
    wave = np.sin(m.elapsed_s / 900.0)
    campaign = replace(m, temperatures_c={"air": 20.0 + wave, "base": 20.0 - 0.9 * wave})
    assert campaign.mean_temperature_c() == pytest.approx(20.0 + 0.05 * wave)
    other = replace(campaign, temperatures_c=dict.fromkeys(("air", "base"), np.full(len(m), 25.0)))
    clipped = clip_to_campaign(campaign, other)
    rows = np.arange(0, len(m), 7)
    combined = combine_contexts(CachedContext(campaign), clipped, cached_context(clipped, other), rows)
    assert np.array_equal(combined.mean_temperature_c()[: len(m)], campaign.mean_temperature_c())
    assert combined.mean_temperature_c()[len(m) :] == pytest.approx(campaign.mean_temperature_c().max())


COORDINATES = {
    "own travel": ("drives", 0, "travel.left"),
    "other travel": ("drives", 1, "travel.right"),
    "side": ("direction", 0, "side.left"),
    "payload": ("payload_kg", None, "payload"),
    "rest": ("dwell_s", None, "rest"),
    "speed": ("speed_m_per_s", None, "speed"),
    "time": ("t_s", None, "time"),
}


@pytest.mark.parametrize("kind", COORDINATES)
def test_a_strength_that_varies_with_a_coordinate_is_a_function_of_nothing_else(recording, m, kind):
    _, _, name = COORDINATES[kind]
    rng = np.random.default_rng(7)
    drawn = replace(m, dwell_s=rng.uniform(0.5, 9.0, len(m)), speed_m_per_s=rng.uniform(0.1, 0.5, len(m)))
    effect = replace(load_catalogue().effect("backlash"), varies_with=(kind,))
    (before,) = functions_it_varies_with(inputs_of(recording.machine, drawn), effect, 0).items()
    assert before[0] == name
    for other, (of_other, of_column, _) in COORDINATES.items():
        values = getattr(drawn, of_other).copy()
        part = values if of_column is None else values[:, of_column]
        part[:] = part[::-1].copy()
        changed_context = replace(drawn, **{of_other: values})
        after = functions_it_varies_with(inputs_of(recording.machine, changed_context), effect, 0)[name]
        assert np.array_equal(after, before[1]) is (other != kind)


@pytest.mark.parametrize("drive", [0, 1])
def test_a_strength_that_varies_with_the_way_does_with_that_of_its_own_drive(recording, m, drive):
    effect = replace(load_catalogue().effect("backlash"), varies_with=("way",))
    functions = functions_it_varies_with(inputs_of(recording.machine, m), effect, drive)
    ((name, found),) = functions.items()
    assert name == f"way.{recording.machine.drive_names[drive]}"
    way = m.way_m(drive)
    wave = np.cos(np.pi * (way - way.min()) / np.ptp(way))
    assert abs(np.corrcoef(found[:, 0], wave)[0, 1]) == pytest.approx(1.0)


def test_exchanges_are_counted_in_time(bench, recording, m):
    payloads = [v.payload for v in bench.timeline.design.visits]
    assert m.exchanges.max() == sum(a != b for a, b in pairwise(payloads))
    order = np.argsort(recording["t_rig_s"])
    assert np.all(np.diff(m.exchanges[order]) >= 0.0)
    for number in np.unique(m.exchanges):
        assert np.ptp(m.payload_kg[m.exchanges == number]) == 0.0


def test_the_order_of_visits_does_not_matter(recording, m):
    number = np.random.default_rng(1).permutation(100)[recording["visit"].astype(int)]
    shuffle = np.argsort(number, kind="stable")
    other = context_of_recording(recording.take(shuffle))
    for name in ("t_s", "drives", "direction", "exchanges", "elapsed_s", "former", "velocity_m_per_s"):
        assert np.array_equal(getattr(other, name), getattr(m, name)[shuffle]), name
    assert other.motion_heat(1, 900.0) == pytest.approx(m.motion_heat(1, 900.0)[shuffle])
    assert other.thermal_lag_k("struts", 900.0) == pytest.approx(m.thermal_lag_k("struts", 900.0)[shuffle], abs=1e-9)


@pytest.mark.parametrize("tau_s", [200.0, 1500.0, 6000.0])
@pytest.mark.parametrize("drive", [0, 1])
def test_warmth_is_the_heat_of_all_ways_before(m, drive, tau_s):
    """dw/dt = (speed - w) / tau with each way at the moment of its arrival, integrated directly."""
    expected = np.zeros(len(m))
    for row, t in enumerate(m.t_s):
        for k in range(1, int(m.arrival[row]) + 1):
            way = abs(m.history.drives[k, drive] - m.history.drives[k - 1, drive])
            expected[row] += way / tau_s * np.exp(-max(t - m.history.arrived_s[k], 0.0) / tau_s)
    # Readings may be some milliseconds before the arrival that their dwell tells: the decay is from the arrival on.
    assert m.motion_heat(drive, tau_s) == pytest.approx(expected, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("tau_s", [300.0, 1500.0, 6000.0])
def test_lag_is_that_of_a_first_order_part(m, tau_s):
    """T' = (S - T) / tau from T = S at the start, in steps of a tenth of a second."""
    order = np.argsort(m.t_s)
    t, sensed = m.t_s[order], m.temperatures_c["struts"][order]
    fine = np.arange(t[0], t[-1] + 0.1, 0.1)
    source = np.interp(fine, t, sensed)
    part = np.empty(len(fine))
    part[0] = source[0]
    for i in range(1, len(fine)):
        part[i] = part[i - 1] + 0.1 / tau_s * (source[i - 1] - part[i - 1])
    expected = np.interp(m.t_s, fine, part - source)
    got = m.thermal_lag_k("struts", tau_s)
    assert np.abs(expected).max() > 0.2
    assert got == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


def test_an_unmoved_drive_is_cold(recording):
    still = {f"left_{q}": np.full(len(recording), 1.0) for q in ("commanded_m", "actual_m")}
    m = context_of_recording(changed(recording, **still))
    assert np.all(m.motion_heat(0, 600.0) == 0.0)
    assert np.any(m.motion_heat(1, 600.0) > 0.0)


def inputs_of(machine, context) -> EffectInputs:
    """Without forces: for effects that ask for none."""
    n, drives, struts = len(context), len(machine.drive_names), len(machine.strut_names)
    none = np.zeros((n, 3))
    sideways = [
        f"{kind}.{drive}.{c}" for drive in machine.drive_names for kind, c in (("sideways", "x"), ("turn", "z"))
    ]
    return EffectInputs(
        machine, context, np.zeros((n, struts)), np.zeros((n, struts, struts)), np.zeros((n, drives, 3)),
        np.zeros((n, drives)), none, tuple(sideways), lambda *_: [], lambda *_: [],
    )  # fmt: skip


EFFECTS_OF_TIME = ("link_thermal_growth", "column_thermal_growth", "screw_thermal_growth", "refraction")
TABLES = tuple(
    KnownTable(drive=drive, generation=generation, own_m=(0.0, 2.0), corrections_m=((1e-5,), (1e-5 * generation,)))
    for drive in ("left", "right")
    for generation in (2, 3)
)


@pytest.mark.parametrize("name", [*EFFECTS_OF_TIME, "tables_left_on"])
def test_columns_of_a_campaign_stay_what_they_are_whatever_else_is_asked_of_its_twin(recording, m, name):
    """A twin knows its columns by their numbers: none may come or go, or change where the campaign was."""
    rng = np.random.default_rng(4)
    wave = 2e-6 * np.sin(m.elapsed_s / 700.0)
    one_side = np.ones_like(m.direction)
    campaign = replace(m, air_refractivity=m.air_refractivity + wave, known_tables=TABLES, direction=one_side)
    warmer = {n: t + 3.0 * rng.standard_normal(len(t)) for n, t in m.temperatures_c.items()}
    other = replace(
        campaign,
        t_s=m.t_s + 2000.0,
        temperatures_c=warmer,
        direction=m.direction,
        air_refractivity=campaign.air_refractivity + 4e-6 * rng.standard_normal(len(m)),
    )
    clipped = clip_to_campaign(campaign, other)
    combined = combine_contexts(
        CachedContext(campaign), clipped, cached_context(clipped, other), np.arange(0, len(m), 9)
    )
    effect = load_catalogue().effect(name)
    alone, beside = (effect.forms(inputs_of(recording.machine, c), 0) for c in (campaign, combined))
    assert beside.sets == alone.sets
    assert len(alone.contributions) > 20
    for one, two in zip(alone.contributions, beside.contributions, strict=True):
        for (channel, shape), (same, longer) in zip(one, two, strict=True):
            assert channel == same
            np.testing.assert_allclose(longer[: len(m)], shape, atol=1e-9 * max(np.abs(shape).max(), 1e-12))


def test_a_campaign_that_is_asked_of_its_own_twin_drags_and_wears_as_it_did(m):
    """Its history begins anew and is not that of the campaign which went before; whatever part of it is asked for."""
    cache, load = CachedContext(m), np.abs(np.sin(m.elapsed_s / 300.0))
    clipped = clip_to_campaign(m, m)
    for rows in (np.arange(len(m)), np.arange(0, len(m), 7)):
        combined = combine_contexts(cache, clipped, cached_context(clipped, m), rows)
        loads = np.concatenate([load, load[rows]])
        for of_both, alone in (
            (combined.dragged(0, 0.1), m.dragged(0, 0.1)),
            (combined.worn_beyond(loads, 0.7), m.worn_beyond(load, 0.7)),
        ):
            np.testing.assert_allclose(of_both[: len(m)], alone, atol=1e-12)
            np.testing.assert_allclose(of_both[len(m) :], alone[rows], atol=0.02 * np.ptp(alone))


def test_what_is_dragged_stays_until_its_play_is_taken_up_and_wear_only_grows(m):
    lies, q = m.dragged(0, 0.1), m.history.drives[m.arrival, 0]
    assert np.all(np.abs(lies - q) <= 0.1 + 1e-12)
    free = np.abs(np.abs(lies - q) - 0.1) > 1e-9
    order = np.argsort(m.arrival, kind="stable")
    moved = np.diff(lies[order]) != 0.0
    assert not np.any(moved & free[order][1:])  # it moves only where the play is taken up
    assert np.all(m.dragged(0, 0.0) == q)
    worn = m.worn_beyond(np.abs(np.sin(m.elapsed_s / 300.0)), 0.7)
    assert np.all(np.diff(worn[order]) >= 0.0)
    assert (worn.min(), worn.max()) == (pytest.approx(0.0, abs=0.1), 1.0)
    assert np.all(m.worn_beyond(np.ones(len(m)), 0.7) == 0.0)
