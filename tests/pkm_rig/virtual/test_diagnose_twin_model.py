"""The twin of a diagnosed campaign, against the plant that made the campaign."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.diagnosis.diagnose import diagnose_and_score
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings.withheld_blocks import regions
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.ranking import rank_effects
from calibration.diagnosis.result import Diagnosis
from calibration.diagnosis.twin.joint_fit import JointFit
from calibration.diagnosis.twin.score import TwinScore
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.api import EffectInputs
from calibration.effects.catalogue import load_catalogue
from calibration.effects.context import ARRAYS, ArrivalHistory, ReadingContext, context_of_recording
from calibration.machine.description import load_machine, shipped_machine
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording
from mock_devices.effects import EffectChoice
from mock_devices.machine_file import read_machine_file
from mock_devices.recordings.design import DesignOptions, draw_design
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.settings import InstrumentProfile, MockSettings

MACHINE = shipped_machine("planar4")
STILL = InstrumentProfile(drift_about_vertical_rad=0.0, drift_of_level_rad=0.0, drift_m=0.0)
EFFECTS = {
    "none": (),
    "backlash": (EffectChoice("backlash", 6e-5, "right"),),
    "screw_cumulative_error": (EffectChoice("screw_cumulative_error", 6e-5, "right"),),
    "link_thermal_growth": (EffectChoice("link_thermal_growth", 6.0, "left_upper"),),
    "screw_thermal_growth": (EffectChoice("screw_thermal_growth", 6.0, "right"),),
    "column_compliance": (EffectChoice("column_compliance", 1e-7, "right"),),
}


@dataclass(frozen=True)
class Case:
    """A campaign, its noise-free readings (r, 3), and what was made of it."""

    recording: Recording
    clean_m: np.ndarray
    found: Diagnosis
    twin: Twin
    score: TwinScore

    def missed_m(self, twin: Twin, on: str = "platform") -> float:
        """RMS over reflectors on a part and the machine's coordinates of what a twin misses of the plant."""
        r = self.recording
        names = [s.name for s in r.machine.smrs]
        smr = np.array([names.index(str(name)) for name in r["smr"]])
        rows = np.flatnonzero(np.array([s.on == on for s in r.machine.smrs])[smr])
        places = twin.readings_m(context_of_recording(r), rows, smr[rows])
        plant = (self.clean_m[rows] - twin.frame.translation_m) @ twin.frame.rotation
        return float(np.sqrt(np.mean((places - plant)[:, :2] ** 2)))


def case(*effects: EffectChoice) -> Case:
    nominal = read_machine_file(MACHINE)
    design = draw_design(nominal, np.random.default_rng(3), DesignOptions(visits=120, poses=80))
    bench = SimulatedCampaign(MACHINE, MockSettings(seed=1, instrument=STILL, effects=effects), design)
    made = bench.record()
    columns = {n: c.astype(str if c.dtype.kind in "US" else np.float64) for n, c in made.columns.items()}
    recording = Recording(RecordingFile(**made.header), load_machine(MACHINE), columns)
    return Case(recording, bench.points_m(), *diagnose_and_score(recording))


@pytest.fixture(scope="module")
def cases():
    """Made when asked for, and kept."""
    known: dict[str, Case] = {}

    def get(name: str) -> Case:
        if name not in known:
            known[name] = case(*EFFECTS[name])
        return known[name]

    return get


@pytest.mark.parametrize("name", EFFECTS)
def test_the_twin_stands_where_the_plant_stands(cases, name):
    c = cases(name)
    assert [a.effect for a in c.twin.added][:1] == [name] * (name != "none")
    missed = c.missed_m(c.twin)
    assert missed < max(1.2 * c.found.gap.after_m, 2e-6)
    assert missed <= c.missed_m(replace(c.twin, added=()))
    assert c.missed_m(c.twin, "slider") < 6e-6
    assert c.missed_m(c.twin, "floor") < 3e-5  # along the line of sight nests are as uncertain as the range is


@pytest.mark.parametrize("name", EFFECTS)
def test_the_simulated_campaign_agrees_with_the_linear_figures(cases, name):
    linear, simulated = cases(name).found.gap, cases(name).score.figures
    # Where calibration takes compliance for stiffness, far from where the model is linear, the twin is the better one.
    assert simulated.before_m == pytest.approx(linear.before_m, rel=0.25 if name == "column_compliance" else 0.06)
    assert simulated.after_m == pytest.approx(linear.after_m, rel=0.08, abs=4e-7)
    assert simulated.shrink == pytest.approx(linear.shrink, abs=0.05)
    assert simulated.noise_floor_m == linear.noise_floor_m
    assert cases(name).score.after_sigma == pytest.approx(1.0, abs=0.3)


def test_a_twin_that_lacks_what_it_learnt_from_others_is_scored_worse(cases):
    """Coefficients that are wrong must show: the score is not that of the linear model under another name."""
    c = cases("backlash")
    assert c.score.figures.after_m < 0.3 * c.score.figures.before_m
    wrong = tuple(replace(a, coefficients=tuple(-x for x in a.coefficients)) for a in c.twin.added)
    assert c.missed_m(replace(c.twin, added=wrong)) > 5.0 * c.missed_m(c.twin)


def of_rows(m: ReadingContext, rows: np.ndarray, later_s: float = 0.0, arrivals: int | None = None) -> ReadingContext:
    """Some of the moments, with as many arrivals, at another time of the rig."""
    changed = {n: getattr(m, n)[rows] for n in ARRAYS} | {"t_s": m.t_s[rows] + later_s}
    history = ArrivalHistory(m.history.arrived_s[:arrivals] + later_s, m.history.drives[:arrivals])
    temperatures = {n: t[rows] for n, t in m.temperatures_c.items()}
    return replace(m, history=history, temperatures_c=temperatures, start_s=m.start_s + later_s, **changed)


@pytest.mark.parametrize("name", ["link_thermal_growth", "screw_thermal_growth", "backlash"])
def test_a_machine_that_lives_the_campaign_again_stands_where_it_stood(cases, name):
    twin, m = cases(name).twin, context_of_recording(cases(name).recording)
    order = np.argsort(m.t_s, kind="stable")
    then = order[: len(order) // 2]
    then = then[m.arrival[then] <= m.arrival[then[-1]]]
    again = of_rows(m, then, 5e6, int(m.arrival[then[-1]]) + 1)
    there = twin.places_m(again, np.array([len(then) - 1]))[0]
    np.testing.assert_allclose(there, twin.places_m(m, then[-1:])[0], atol=3e-7)


@pytest.mark.parametrize("name", ["link_thermal_growth", "screw_thermal_growth"])
def test_a_machine_that_just_began_is_as_cold_as_the_campaign_was(cases, name):
    twin, m = cases(name).twin, context_of_recording(cases(name).recording)
    late = np.array([int(np.argmax(m.t_s))])
    fresh = replace(of_rows(m, late, 5e6), start_s=float(m.t_s[late[0]]) + 5e6)
    fresh = replace(
        fresh, arrival=np.zeros(1, dtype=np.intp), history=ArrivalHistory(fresh.t_s - 1.0, m.drives[late])
    )  # stands since a second
    cold, warm = twin.places_m(fresh)[0], twin.places_m(m, late)[0]
    bare = replace(twin, added=()).places_m(fresh)[0]
    moved = np.max(np.abs(warm - bare))
    assert moved > 5e-6
    assert np.max(np.abs(cold - bare)) < 0.08 * moved  # what wanders beside its warming goes on


def test_every_pose_of_a_campaign_has_its_equilibrium(cases):
    """From the middle of the workspace Newton's method loses some of them."""
    c = cases("backlash")
    assert np.all(np.isfinite(c.twin.places_m(context_of_recording(c.recording))))


def test_where_no_machine_stands_is_one_line(cases):
    c = cases("backlash")
    one = of_rows(context_of_recording(c.recording), np.array([9]))
    with pytest.raises(InputError, match="no equilibrium"):
        c.twin.places_m(replace(one, drives=one.drives + np.array([[5.0, -5.0]])))


def test_sensors_that_a_rig_lacks_are_not_needed(cases):
    c = cases("backlash")
    one = of_rows(context_of_recording(c.recording), np.array([9]))
    told = c.twin.places_m(one)
    np.testing.assert_allclose(c.twin.places_m(replace(one, temperatures_c={})), told, atol=1e-4)


def test_what_is_withheld_teaches_the_twin_nothing(cases):
    """Readings of a region that are spoilt by 0.2 mm leave the twin of the others where it was."""
    recording = cases("backlash").recording

    def made(recording: Recording) -> tuple[MarginalLikelihood, EffectInputs]:
        likelihood = MarginalLikelihood.of(linearise_recording(recording))
        return likelihood, inputs_of_recording(likelihood, periodograms(likelihood))

    likelihood, inputs = made(recording)
    known = likelihood.linear
    (cause,) = rank_effects(likelihood, inputs, [e for e in load_catalogue().effects if e.name == "backlash"])
    block = np.flatnonzero((known.visit >= 0) & (regions(known)[np.maximum(known.visit, 0)] == 2))
    x = recording["x_m"].copy()
    x[known.rows[block]] += 2e-4
    spoilt, _ = made(replace(recording, columns={**recording.columns, "x_m": x}))
    sound, without = JointFit(likelihood, [cause]), JointFit(spoilt, [cause])
    rows = block[known.on_platform[block]]
    places = [
        Twin.from_solution(joint.without(block), r, [cause], inputs).readings_m(known.context, rows, known.smr[rows])
        for joint, r in ((sound, likelihood), (without, spoilt))
    ]
    frames = [joint.without(block).fitted_machine.frame for joint in (sound, without)]
    stated = [frame.to_station(p) for frame, p in zip(frames, places, strict=True)]
    assert np.sqrt(np.mean((stated[0] - stated[1]) ** 2)) < 1.5e-6
    whole = [joint.solution.coefficients[0][0] for joint in (sound, without)]
    there = [joint.without(block).coefficients[0][0] for joint in (sound, without)]
    assert abs(there[0] - there[1]) < 0.1 * abs(whole[0] - whole[1]) + 1e-7
