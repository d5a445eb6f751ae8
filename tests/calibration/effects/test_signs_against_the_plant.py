"""Sign and factor of every effect of the catalogue, against the mock plant's own physics of the same effect.

The plant imports nothing of the calibration, so their agreement is that of two independent computations. Neither noise
nor an estimate of the effect is involved: what an effect of known size changes at every reading of a campaign (plant
with it minus plant without it) is compared with the catalogue's columns times the same size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from calibration.diagnosis.channels import Channels
from calibration.diagnosis.effect_inputs import inputs_of_readings
from calibration.diagnosis.linear_model import LinearModel, linearise_recording
from calibration.effects import drive_scale, expansion, payload, tables_left_on
from calibration.effects.api import BasisSet, EffectInputs
from calibration.effects.catalogue import load_catalogue
from calibration.effects.columns import Contributions
from calibration.effects.context import context_of_recording
from calibration.effects.control import DWELL_TIMES_S
from calibration.effects.heats import TIME_CONSTANTS_S
from calibration.effects.structure import SOFT_N
from calibration.recording.header import DRIFT_LEVER_M
from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Effect as PlantEffect
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.effects.foundation import FOOT_M
from mock_devices.effects.instrument import LEVER_M
from mock_devices.recordings.design import DesignOptions
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.settings import InstrumentProfile
from tests.calibration.diagnosis.campaigns import PLANAR, plant, recorded

SEED = 3
ONSET_S = 605.0
PERIOD_M = {"screw_periodic_error": 1.73e-2, "encoder_interpolation": 3.7e-4}
QUIET = InstrumentProfile(
    drift_about_vertical_rad=0.0, drift_of_level_rad=0.0, drift_m=0.0, angle_sd_rad=1e-8, range_sd_m=1e-7
)
# So slow that the last 10 mm reach the speed: how far a short leg stays below it is another matter.
DESIGN = DesignOptions(fly_share=0.3, speeds_m_per_s=(0.05, 0.1))
CATALOGUE = load_catalogue()


@dataclass(frozen=True)
class Rig:
    """A campaign on a plant without geometric errors, and what the catalogue's effects are functions of there."""

    campaign: SimulatedCampaign
    linear: LinearModel
    channels: Channels
    inputs: EffectInputs
    plain_m: np.ndarray

    def plant_effect(self, choice: EffectChoice) -> PlantEffect:
        site = Site(self.campaign.nominal, self.campaign.settings.station_position_m, self.campaign.start_s)
        return make(choice, site, SEED)

    def plant_shift_m(self, choice: EffectChoice) -> np.ndarray:
        """What the plant's effect changes (n, 3), machine's frame."""
        return (self.campaign.points_m([self.plant_effect(choice)]) - self.plain_m) @ self.linear.frame.rotation

    def shift_m(self, columns: Sequence[Contributions], coefficients: Sequence[float]) -> np.ndarray:
        """What columns of the catalogue change (n, 3)."""
        out = np.zeros((len(self.linear.rows), 3))
        for column, coefficient in zip(columns, coefficients, strict=True):
            for channel, shape in column:
                out += coefficient * self.channels.shift_m(channel) * shape[:, None]
        return out

    def inputs_for(self, choice: EffectChoice) -> EffectInputs:
        """The inputs with the plant's period and onset, and with the torque that its drives report."""
        context = self.inputs.context
        if choice.name == "friction_windup":
            settings = replace(self.campaign.settings, effects=(choice,))
            seen = recorded(SimulatedCampaign(PLANAR, settings, self.campaign.timeline))
            context = replace(context, torque=context_of_recording(seen).torque)
        period_m = PERIOD_M.get(choice.name, 0.0)
        return replace(self.inputs, context=context, periods=lambda *_: [(period_m, 1.0)] if period_m else [])


@pytest.fixture(scope="module")
def rig() -> Rig:
    quiet = {"error_scale": 0.0, "instrument": QUIET, "temperature_sensor_sd_k": 0.0}
    campaign = plant(60, seed=SEED, design=DESIGN, **quiet)
    linear = linearise_recording(recorded(campaign))
    assert len(linear.rows) == len(campaign.timeline)
    channels = Channels(linear)
    inputs = inputs_of_readings(linear, channels, lambda *_: [], lambda _: [(ONSET_S, 1.0)])
    # The plant counts a height from its foot to the upper joint, the catalogue from the nests to the middle of both.
    foot_m = np.array([0.0, FOOT_M - campaign.nominal.struts[0].base_joint.imag, 0.0])
    at_foot = tuple(replace(smr, position_m=foot_m) if smr.on == "floor" else smr for smr in inputs.machine.smrs)
    inputs = replace(inputs, machine=replace(inputs.machine, smrs=at_foot))
    return Rig(campaign, linear, channels, inputs, campaign.points_m([]))


@dataclass(frozen=True)
class Case:
    """An effect of the plant, the catalogue's basis set of the same form, and the coefficients over the size.

    channels: of the basis set's first column; parameters: those that tell it from others.
    coefficients: of its first columns for a size of one, from the plant's effect and the rig. unknown: channels at
    which a constant belongs to the calibration, not to the effect. slope: plant over catalogue.
    """

    name: str
    variant: str
    place: str
    size: float
    channels: tuple[str, ...] = ()
    given: tuple[tuple[str, float], ...] = ()
    parameters: tuple[tuple[str, float], ...] = ()
    coefficients: Callable[[PlantEffect, Rig], tuple[float, ...]] = lambda effect, rig: (1.0,)
    unknown: tuple[str, ...] = ()
    slope: tuple[float, float] = (0.99, 1.01)

    def __str__(self) -> str:
        return " ".join((self.name, self.variant, self.place)).strip()

    @property
    def choice(self) -> EffectChoice:
        return EffectChoice(self.name, self.size, self.place, self.variant, self.given)

    def fits(self, basis_set: BasisSet, columns: Sequence[Contributions], least: int) -> bool:
        first = {channel for channel, _ in columns[basis_set.columns[0]]}
        given = all(basis_set.parameters.get(name) == value for name, value in self.parameters)
        return given and (not self.channels or first == set(self.channels)) and len(basis_set.columns) >= least


def phase(effect: PlantEffect, rig: Rig) -> tuple[float, ...]:
    """sin(x + phase) of sin(x) and cos(x)."""
    return float(np.cos(effect.phase)), float(np.sin(effect.phase))


def drift_weights(effect: PlantEffect, rig: Rig) -> tuple[float, ...]:
    """Both give the drift at a distance: the plant at 3.2 m, the catalogue at 3 m."""
    turn, shift = np.split(effect.weights / np.sqrt(2.0), 2)
    return (*(turn * DRIFT_LEVER_M / LEVER_M), *shift)


def first_shift(effect: PlantEffect, rig: Rig) -> tuple[float, ...]:
    return tuple(effect.shifts[0])


def each_shift(effect: PlantEffect, rig: Rig) -> tuple[float, ...]:
    """By direction, then by exchange."""
    exchanges = int(rig.inputs.context.exchanges.max())
    return tuple(effect.shifts[1 : exchanges + 1].T.ravel())


def softer(effect: PlantEffect, rig: Rig) -> tuple[float, ...]:
    """The plant's size is a logarithm over its own stiffness, the catalogue's a share of the nominal compliance."""
    true = rig.campaign.machine.file.struts[effect.place].stiffness_n_per_m
    nominal = rig.campaign.nominal.struts[effect.place].stiffness_n_per_m
    return (np.expm1(effect.size) / effect.size * nominal / true,)


def soft_below(effect: PlantEffect, rig: Rig) -> tuple[float, ...]:
    """The plant's compliance falls over the drive's travel by 0.6 to each side, the catalogue's over what was used."""
    (middle, half), (used, used_half) = effect.site.drive_range_m(effect.place), rig.inputs.travel_range_m(effect.place)
    return 1.0 - 0.6 * (used - middle) / half, -0.6 * used_half / half


def tilt(effect: PlantEffect, rig: Rig) -> tuple[float, ...]:
    return 1.0, effect.values["tilt_per_m"]


RISE = (("tau_s", TIME_CONSTANTS_S[3]),)
SLOW, FAST = (("tau_s", DWELL_TIMES_S[-2]),), (("tau_s", DWELL_TIMES_S[1]),)
ONSET = (("onset_s", ONSET_S),)
LEANING = (("onset_s", ONSET_S), ("tilt_per_m", 0.5))
CASES = [
    Case("link_thermal_growth", "warm_up", "left_lower", 1.0, given=RISE, parameters=RISE),
    Case("column_thermal_growth", "warm_up", "right", 1.0, ("travel.right",), RISE, RISE),
    *(
        Case("column_thermal_growth", "bending", d, 1.0, (f"sideways.{d}.x", f"turn.{d}.z"), RISE, RISE)
        for d in ("left", "right")
    ),
    # The plant's screw is heated by the run-ups too, which a recording does not tell.
    Case("screw_thermal_growth", "free_end", "left", 1.0, given=RISE, parameters=RISE, slope=(1.0, 1.15)),
    Case("backlash", "play", "left", 1e-5),
    # 6 kN stand for the rated force, which in the plant is 6.28 kN.
    Case("friction_windup", "coulomb", "right", 1e-8, unknown=("travel.right",), slope=(1.03, 1.06)),
    Case("column_compliance", "lateral", "left", 1e-9, ("sideways.left.x",)),
    Case("column_compliance", "lateral", "right", 1e-9, ("sideways.right.x",)),
    Case("column_compliance", "yaw", "left", 1e-9, ("turn.left.z",), slope=(0.95, 1.05)),
    Case("column_compliance", "screw_length", "left", 1e-9, ("travel.left",), coefficients=soft_below),
    # Forces that the fit barely determines; a tension falls as its strut yields, the catalogue takes the one before.
    *(
        Case("link_stiffness", "softer", s, 0.05, coefficients=softer, slope=(0.95, 1.05))
        for s in ("left_upper", "right_lower")
    ),
    *(
        Case(name, variant, "left", 5e-6, coefficients=phase, given=((key, PERIOD_M[name]),))
        for name, variant, key in (
            ("screw_periodic_error", "sine", "period_m"),
            ("encoder_interpolation", "offset", "pitch_m"),
        )
    ),
    *(Case("foundation_settling", "step", d, 2e-5, (f"travel.{d}",), LEANING, ONSET, tilt) for d in ("left", "right")),
    Case("tracker_drift", "linear", "", 4e-5, coefficients=drift_weights),
    # The plant's light is bent by the part of the gradient across it, which the catalogue takes whole.
    Case("refraction", "uniform", "", 3.0, ("light.v",), slope=(0.95, 1.0)),
    Case("refraction", "sideways", "", 3.0, ("light.hz",)),
    Case("smr_reseat", "step", "P2", 2e-5, given=ONSET, parameters=ONSET, coefficients=first_shift),
    Case("smr_reseat", "each_exchange", "P3", 2e-5, coefficients=each_shift),
    Case("axis_coupling", "linear", "left", 3e-5, unknown=("travel.left",)),
    Case("latency", "dead_time", "", 5e-4),
    # The plant: from the stop to a reading's middle; the recording: from 0.1 s later to its end.
    Case("servo_settling", "creep", "right", 1e-4, given=SLOW, parameters=SLOW, slope=(0.95, 1.05)),
]


def slope_and_correlation(rig: Rig, case: Case) -> tuple[float, float]:
    """Of what the plant changes over what the catalogue predicts."""
    effect, drawn = CATALOGUE.effect(case.name), rig.plant_effect(case.choice)
    inputs = rig.inputs_for(case.choice)
    built = effect.forms(inputs, effect.places(inputs.machine).index(case.place))
    coefficients = case.size * np.array(case.coefficients(drawn, rig))
    fitting = [b for b in built.sets if case.fits(b, built.contributions, len(coefficients))]
    basis_set = fitting[0]
    if basis_set.size:
        coefficients[0] /= basis_set.size[0]
    columns = [built.contributions[c] for c in basis_set.columns[: len(coefficients)]]
    return compared(rig, rig.shift_m(columns, coefficients), rig.plant_shift_m(case.choice), case.unknown)


def compared(rig: Rig, predicted_m: np.ndarray, true_m: np.ndarray, unknown: Sequence[str]) -> tuple[float, float]:
    """Slope of the true over the predicted shifts (n, 3) and their correlation, without constants at channels."""
    predicted, true = predicted_m.ravel(), true_m.ravel()
    for channel in unknown:
        constant = rig.channels.shift_m(channel).ravel()
        predicted, true = (x - constant * (constant @ x) / (constant @ constant) for x in (predicted, true))
    slope = float(predicted @ true / (predicted @ predicted))
    return slope, slope * float(np.linalg.norm(predicted) / np.linalg.norm(true))


@pytest.mark.parametrize("case", CASES, ids=str)
def test_an_effect_has_the_sign_and_the_factor_of_the_plant(rig, case):
    slope, correlation = slope_and_correlation(rig, case)
    low, high = case.slope
    assert low < slope < high
    assert correlation > 0.99


CURVES = {
    # The plant's sideways is the axis turned by 90 degrees: of an axis that points upwards, -x.
    "screw_cumulative_error": ("parabola", "travel.left", 1.0),
    "guide_straightness": ("bow", "sideways.left.x", -1.0),
    "guide_angular": ("bow", "turn.left.z", 1.0),
}


@pytest.mark.parametrize("name", CURVES)
def test_an_error_along_the_travel_has_the_sign_and_the_factor_of_the_plant(rig, name):
    """The columns that add up to the plant's curve 2 x^2 - 1 over the drive's travel change what it changes."""
    size, (variant, channel, sign) = 2e-5, CURVES[name]
    built = CATALOGUE.effect(name).forms(rig.inputs, 0)
    plain = [s for s in built.sets if set(s.relative) == {1.0} and built.contributions[s.columns[0]][0][0] == channel]
    columns = [built.contributions[c] for c in max(plain, key=lambda s: len(s.columns)).columns]
    (low, high), q = rig.campaign.nominal.sliders[0].travel_m, rig.inputs.context.drives[:, 0]
    error = sign * size * (2.0 * ((2.0 * q - low - high) / (high - low)) ** 2 - 1.0)
    shapes = np.column_stack([column[0][1] for column in columns] + [np.ones_like(q)])
    coefficients = np.linalg.lstsq(shapes, error, rcond=None)[0]
    slope, correlation = compared(
        rig,
        rig.shift_m(columns, coefficients[:-1]),
        rig.plant_shift_m(EffectChoice(name, size, "left", variant)),
        (channel,),
    )
    assert 0.99 < slope < 1.01
    assert correlation > 0.99


@pytest.mark.parametrize("strut", ["left_lower", "right_upper"])
@pytest.mark.parametrize(("variant", "closing"), [("dead_zone", 0.1), ("soft_contact", 0.5)])
def test_play_has_the_sign_and_the_factor_of_the_plant(rig, strut, variant, closing):
    """On its curve: the plant's play closes smoothly over a share of itself."""
    play_m, effect = 3e-6, CATALOGUE.effect("joint_clearance")
    place = rig.inputs.machine.strut_names.index(strut)
    curve = effect.curves(rig.inputs, place)[0]
    typical_n = float(np.sqrt(np.mean(rig.inputs.tension_n[:, place] ** 2)))
    width_n = 1.5 * closing * play_m * rig.campaign.machine.file.struts[place].stiffness_n_per_m
    point = np.zeros(len(curve.low))
    point[:2], point[4] = (np.log(play_m), np.log(width_n / typical_n)), np.log(2.5)
    column = effect.contributions(rig.inputs, place, (0, tuple(point)))[0]
    true_m = rig.plant_shift_m(EffectChoice("joint_clearance", play_m, strut, variant))
    slope, correlation = compared(rig, rig.shift_m([column], [play_m]), true_m, ())
    assert 0.95 < slope < 1.1  # two laws of the same play, smooth in different ways
    assert correlation > 0.98


def test_play_in_its_basis_sets_lengthens_a_strut_in_tension(rig):
    """The basis set whose change of sides is nearest to a tension of zero."""
    effect, strut, play_m = CATALOGUE.effect("joint_clearance"), "right_lower", 3e-6
    place = rig.inputs.machine.strut_names.index(strut)
    built = effect.forms(rig.inputs, place)
    tension = rig.inputs.tension_n[:, place]
    sides = [built.contributions[s.columns[0]] for s in built.sets if len(s.columns) == 1]

    def agreement(column: Contributions) -> float:
        return float(np.mean(np.tanh(tension / SOFT_N[0]) * column[0][1]))

    true_m = rig.plant_shift_m(EffectChoice("joint_clearance", play_m, strut, "dead_zone"))
    slope, correlation = compared(rig, rig.shift_m([max(sides, key=agreement)], [play_m]), true_m, ())
    assert 0.95 < slope < 1.05
    assert correlation > 0.99


def test_every_effect_of_the_catalogue_is_held_against_the_plant():
    of_stated_values = {e.name for m in (expansion, payload, tables_left_on, drive_scale) for e in m.EFFECTS}
    held = (
        {case.name for case in CASES} | set(CURVES) | {"joint_clearance"} | of_stated_values
    )  # these: test_stated_values
    assert held == set(CATALOGUE.names)
