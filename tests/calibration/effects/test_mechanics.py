"""Signs of columns that the plant has no counterpart of: which way a slider goes, by what mechanics says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.diagnosis.periodogram import MAX_PEAKS, Periodogram
from calibration.effects.catalogue import load_catalogue
from calibration.effects.context import context_of_recording
from calibration.effects.departures import WARMTH_S
from calibration.machine.description import load_machine, shipped_machine
from tests.calibration.diagnosis.campaigns import plant, recorded
from tests.calibration.effects.test_context import SWING, inputs_of


@pytest.fixture(scope="module")
def inputs():
    recording = recorded(plant(60, temperature_programme=SWING))
    return inputs_of(recording.machine, context_of_recording(recording))


def shapes(inputs, name):
    """Functions (n,) of all columns at the first drive's travel that are the first of a basis set."""
    built = load_catalogue().effect(name).forms(inputs, 0)
    firsts = {basis_set.columns[0] for basis_set in built.sets}
    return [dict(built.contributions[k])["travel.left"] for k in sorted(firsts)]


def test_friction_holds_a_slider_back_and_the_more_the_heavier_its_load(inputs):
    side, mass = inputs.context.direction[:, 0], inputs.machine.moving_mass_kg + inputs.context.payload_kg
    expected = -side * mass / mass.max()
    approached = side != 0.0  # unlike at nests
    alike = [np.corrcoef(shape[approached], expected[approached])[0, 1] for shape in shapes(inputs, "friction_windup")]
    assert max(alike) > 1.0 - 1e-9


def test_friction_is_told_from_play_by_the_load_where_no_torque_was_recorded(inputs):
    """Of a recording without torque its column is zero; of one payload nothing is left."""
    effect = load_catalogue().effect("friction_windup")
    no_torque = replace(inputs, context=replace(inputs.context, torque=np.zeros_like(inputs.context.torque)))
    assert effect.untested(no_torque) is None
    forms = set(effect.forms(no_torque, 0).named)
    assert "coulomb" in forms
    assert not any("torque" in form for form in forms)
    assert any("torque" in form for form in effect.forms(inputs, 0).named)
    nothing = np.zeros_like(inputs.context.payload_kg)
    one_payload = replace(no_torque, context=replace(no_torque.context, payload_kg=nothing))
    assert effect.untested(one_payload) == "the recording holds neither a varied torque nor a varied payload"


def test_friction_of_a_cover_or_of_grease_stands_beside_what_the_struts_pull(inputs):
    """Drag by the place, or by speed and what motions have warmed, by the side: with the load in one basis set."""
    pull_n, context = 400.0 + 300.0 * np.sin(7.0 * inputs.context.drives[:, 0]), inputs.context
    pulled = replace(inputs, pull_n=pull_n[:, None, None] * inputs.machine.nominal.axis[None])
    built = load_catalogue().effect("friction_windup").forms(pulled, 0)
    (load,) = (k for k, name in enumerate(built.named) if name == "pull")
    np.testing.assert_allclose(dict(built.contributions[load])["travel.left"], pull_n)
    beside = [s for s in built.sets if s.columns[0] == load]
    place, warmth = context.drives[:, 0], [context.motion_heat(0, tau_s) for tau_s in WARMTH_S]
    cover = 0.1 + 0.9 * ((place - place.min()) / np.ptp(place)) ** 2
    stirred = (0.3 + context.speed_m_per_s / 0.2) * (1.0 - 0.5 * warmth[1] / warmth[1].max())
    for drag in (cover, stirred):
        truth = -context.direction[:, 0] * drag + 1e-3 * pull_n
        left = []
        for basis_set in beside:
            columns = np.stack([dict(built.contributions[c])["travel.left"] for c in basis_set.columns], axis=1)
            columns = columns / np.linalg.norm(columns, axis=0)
            left.append(np.linalg.norm(columns @ np.linalg.lstsq(columns, truth, rcond=None)[0] - truth))
        assert min(left) < 0.03 * np.linalg.norm(truth)
    still = load_catalogue().effect("friction_windup").forms(inputs, 0)
    assert "pull" not in still.named  # where struts pull alike everywhere


@pytest.mark.parametrize("anyhow", [False, True])
def test_a_weight_that_never_changes_winds_up_too(inputs, anyhow):
    """Hooke's law counts from no torque: what is as its varying part has the constant one too, as curves or a line."""
    torque = inputs.context.torque + 0.2
    heavy = replace(inputs, context=replace(inputs.context, torque=torque))
    built = load_catalogue().effect("friction_windup").forms(heavy, 0)
    by_column = [dict(column)["travel.left"] for column in built.contributions]
    wound = by_column[built.named.index("torque")]
    any_curve = next(s.main for s in built.sets if s.size and not built.named[s.main[0]])
    shapes = np.stack([by_column[k] for k in any_curve[1:]] if anyhow else [wound], axis=1)
    coefficients = np.linalg.lstsq(shapes - shapes.mean(axis=0), wound - wound.mean(), rcond=None)[0]
    assert float(np.mean(shapes @ coefficients)) == pytest.approx(float(wound.mean()), rel=0.1)
    assert abs(wound.mean()) > 2.0 * wound.std()


def test_a_warm_screw_that_is_held_below_lifts_its_slider_the_more_the_higher_it_stands(inputs):
    context, travel = inputs.context, inputs.machine.travel
    sensor = inputs.machine.sensors["drives"]
    rise = context.temperatures_c[sensor] - context.temperatures_c[sensor][np.argmin(context.t_s)]
    lifted = rise * (context.drives[:, 0] - travel[0, 0])
    correlations = [np.corrcoef(shape, lifted)[0, 1] for shape in shapes(inputs, "screw_thermal_growth")]
    assert max(correlations) > 1.0 - 1e-9


@pytest.mark.parametrize("name", ["planar4", "prs3", "hexaglide"])
def test_a_column_that_leans_takes_what_is_above_to_the_side_that_its_rotation_says(inputs, name):
    machine = load_machine(shipped_machine(name))
    channels = [f"{kind}.{d}.{c}" for d in machine.drive_names for kind in ("sideways", "turn") for c in "xyz"]
    across = [c for c in channels if abs(machine.nominal.axis[0] @ np.eye(3)["xyz".index(c[-1])]) < 0.5 or "turn" in c]
    inputs = replace(inputs, machine=machine, channels=tuple(across))
    for drive in range(len(machine.drive_names)):
        leaning, axis = inputs.leaning(drive), machine.nominal.axis[drive]
        assert len({side for side, _, _ in leaning}) == 2
        for side, turn, sign in leaning:
            rotation = Rotation.from_rotvec(1e-6 * sign * np.eye(3)["xyz".index(turn[-1])])
            moved = rotation.apply(axis) - axis
            assert moved == pytest.approx(1e-6 * np.eye(3)["xyz".index(side[-1])], abs=1e-11)


def test_a_column_that_is_warm_at_its_foot_grows_like_a_column_of_any_warmth(inputs):
    """Its growth is the integral of its temperature up to the slider, in 1 mm steps; forms are left out."""
    built = load_catalogue().effect("column_thermal_growth").forms(inputs, 0).without_forms(("warming", "following"))
    heights, t = inputs.height_m(0), inputs.context.elapsed_s
    steps = np.arange(0.0, heights.max() + 1e-3, 1e-3)
    along = np.concatenate([[0.0], np.cumsum(np.exp(-0.5 * (steps[1:] + steps[:-1]) / 0.6) * 1e-3)])
    grown = np.interp(heights, steps, along) * t / t.max()

    def left(basis_set):
        columns = np.column_stack([dict(built.contributions[c]).get("travel.left", 0.0 * t) for c in basis_set.columns])
        return grown - columns @ np.linalg.lstsq(columns, grown, rcond=None)[0]

    shares = [np.linalg.norm(left(basis_set)) / np.linalg.norm(grown) for basis_set in built.sets]
    assert min(shares) < 0.01


def test_columns_of_two_materials_bend_alike_or_away_from_the_middle(inputs):
    """Curvature, integrated twice up to the slider in 1 mm steps, for every reading by its own temperature."""
    built = load_catalogue().effect("expansion_coefficient").forms(inputs, 0)
    machine, context = inputs.machine, inputs.context
    mains = {s.columns[0] for s in built.sets if "turn.left.z" in dict(built.contributions[s.columns[0]])}
    above_k = context.part_temperature_k(machine.sensors["base"], 0.0)
    heights = context.drives - machine.travel[:, 0]  # where a slider is lowest its column is upright
    curvature, turned_at_once = 1.5 / 0.4 * above_k, above_k * heights[:, 0]
    all_bent = [dict(built.contributions[c]) for c in sorted(mains)]
    at_once = [b for b in all_bent if abs(np.corrcoef(b["turn.left.z"], turned_at_once)[0, 1]) > 0.999999]
    signs = set()
    for columns in at_once:
        sign = {}
        for d, name in enumerate(("left", "right")):
            steps = np.arange(0.0, heights[:, d].max() + 2e-3, 1e-3)
            turned = np.interp(heights[:, d], steps, steps)  # of unit curvature
            integral = np.concatenate([[0.0], np.cumsum(0.5e-3 * (steps[1:] + steps[:-1]))])
            moved = np.interp(heights[:, d], steps, integral)
            turn, side = columns[f"turn.{name}.z"], columns[f"sideways.{name}.x"]
            sign[name] = float(np.sign(turn @ (curvature * turned)))
            assert turn == pytest.approx(sign[name] * curvature * turned, abs=1e-6)
            assert side == pytest.approx(-sign[name] * curvature * moved, abs=1e-5)  # to the left it turns by +z
        signs.add(sign["left"] * sign["right"])
    assert signs == {1.0, -1.0}


def test_a_bent_column_may_be_upright_somewhat_higher(inputs):
    """With its further columns times a height it is bent about that, up to a shift that is small if the height is."""
    built = load_catalogue().effect("expansion_coefficient").forms(inputs, 0)
    bent = [s for s in built.sets if "turn.left.z" in dict(built.contributions[s.columns[0]]) and s.columns != s.main]
    assert bent
    height, h0 = inputs.context.drives[:, 0] - inputs.machine.travel[0, 0], 0.2
    for basis_set in bent:
        main = dict(built.contributions[basis_set.columns[0]])
        others = [dict(built.contributions[c]) for c in basis_set.columns[len(basis_set.main) :]]
        above = (height > 0.01) & (np.abs(main["turn.left.z"]) > 1e-3)
        h = height[above]
        (straight,) = (other for other in others if "turn.left.z" in other)
        curvature = main["turn.left.z"][above] / h
        factor = float(np.median(curvature / -straight["turn.left.z"][above]))  # of a part that is late and warms less
        about = {c: (main[c] + factor * h0 * straight[c])[above] for c in ("turn.left.z", "sideways.left.x")}
        assert about["turn.left.z"] == pytest.approx(curvature * (h - h0), abs=1e-9)
        parabola = np.polyfit(h, about["sideways.left.x"] / curvature, 2)
        assert parabola == pytest.approx([-0.5, h0, 0.0], abs=1e-9)  # -(h - h0)^2 / 2 but for its constant


def test_the_strongest_peaks_of_each_octave_are_tried_however_many_aliases_outdo_them():
    frequency = np.arange(1.0, 40_001.0)
    power = np.ones(len(frequency))
    power[20_000 : 20_000 + 40 * MAX_PEAKS : 20] = 50.0  # at periods below 50 um
    power[399] = 30.0  # at 2.5 mm
    position_m = np.linspace(0.0, 1.0, 50)
    found = Periodogram(frequency, power, position_m, np.zeros((50, 1))).strongest_periods(1e-5, 4e-3)
    assert any(abs(1.0 / period_m - 400.0) < 1.0 for period_m, _ in found)
