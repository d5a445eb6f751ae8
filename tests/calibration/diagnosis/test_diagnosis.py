"""Diagnoses of recordings whose cause is known, and the principles that all of them obey."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis.diagnose import diagnose, withheld_with
from calibration.diagnosis.result import KINDS, NONE, UNKNOWN
from calibration.diagnosis.searched_readings import _ReadingsToSearch
from calibration.effects.catalogue import load_catalogue
from calibration.effects.context import context_of_recording
from calibration.recording.header import DeclaredLevels
from mock_devices.effects import EffectChoice
from mock_devices.machine_file import read_machine_file
from mock_devices.recordings.design import DesignOptions, StationMove, draw_design
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.settings import DisturbanceLevels, MockSettings
from tests.calibration.diagnosis.campaigns import PLANAR, changed, example, noise_free_m, plant, recorded, simulated
from tests.calibration.diagnosis.conftest import BACKLASH_M

CREEP_M = 8.0e-5


@pytest.fixture(scope="module")
def backlash(strong):
    return diagnose(strong)


@pytest.fixture(scope="module")
def periodic():
    return recorded(plant(100, EffectChoice("screw_periodic_error", 4e-5, "right")))


@pytest.fixture(scope="module")
def creeping():
    """The left drive falls short by 80 um after a way of 0.5 m; in half as many visits something imitates that."""
    return simulated("planar4", 160, lambda a: -CREEP_M * a.travelled_m / 0.5 * np.array([1.0, 0.0]))


def plain(diagnosis) -> str:
    return json.dumps(asdict(diagnosis), default=lambda x: x.tolist(), sort_keys=True)


def check_consistent(diagnosis, catalogue) -> None:
    """What holds of every diagnosis."""
    ranking = diagnosis.ranking
    assert sum(ranking.values()) == pytest.approx(1.0)
    assert all(0.0 <= p <= 1.0 for p in ranking.values())
    assert set(ranking) <= {*catalogue.names, NONE, UNKNOWN}
    assert not set(ranking) & set(diagnosis.not_tested)
    assert ranking[diagnosis.verdict] == max(ranking.values())
    assert len({effect.effect for effect in diagnosis.effects}) <= 3
    if diagnosis.verdict in (NONE, UNKNOWN):
        assert not diagnosis.effects
        assert not diagnosis.equivalent
        assert diagnosis.gap.shrink == 0.0
    assert diagnosis.verdict not in diagnosis.equivalent
    low, high = diagnosis.gap.shrink_interval
    assert low <= diagnosis.gap.shrink <= high <= 1.0
    for share in diagnosis.where:
        assert share.kind in KINDS
        assert 0.0 <= share.low <= share.share <= share.high <= 1.0
    for effect in diagnosis.effects:
        assert effect.visible_sigma <= effect.raw_sigma * (1.0 + 1e-9)
        assert effect.size.u > 0.0


@pytest.mark.parametrize("effects", [(), (EffectChoice("backlash", BACKLASH_M, "left"),)], ids=["sound", "backlash"])
def test_a_station_that_was_set_up_three_times_is_no_effect_and_hides_none(effects):
    drawn = draw_design(read_machine_file(PLANAR), np.random.default_rng(3), DesignOptions(visits=100, poses=60))
    visits = list(drawn.visits)
    for at in (33, 67):
        visits.insert(at, replace(visits[at - 1], pass_=visits[at - 1].pass_ + 100))
    moves = (StationMove(33, (0.3, 0.1, -0.2), 0.2), StationMove(67, (-0.5, 0.1, 0.1), -0.3))
    design = replace(drawn, visits=tuple(visits), moves=moves)
    recording = recorded(SimulatedCampaign(PLANAR, MockSettings(seed=3, effects=effects), design))
    assert set(recording["station"]) == {1.0, 2.0, 3.0}
    diagnosis = diagnose(recording)
    check_consistent(diagnosis, load_catalogue())
    assert diagnosis.verdict == (effects[0].name if effects else NONE)
    assert diagnosis.ranking[diagnosis.verdict] > 0.4


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("levels", [DisturbanceLevels(), DisturbanceLevels(5e-6, 2e-6, 1e-6, 0.02)])
def test_a_sound_machine_has_no_effect(seed, levels):
    diagnosis = diagnose(recorded(plant(80, seed=seed, nuisance=levels)))
    check_consistent(diagnosis, load_catalogue())
    assert diagnosis.verdict == NONE
    assert diagnosis.ranking[NONE] > 0.9
    assert diagnosis.gap.before_m < 0.6 * diagnosis.gap.noise_floor_m
    assert 0.0 < diagnosis.hidden_m < 2.0 * diagnosis.gap.noise_floor_m


def test_what_a_rig_does_not_declare_is_not_zero():
    """A little reversal error, drift and reseating: none where nothing is declared, an effect where zero is."""
    real = DisturbanceLevels(drift_m=6e-6, reseat_m=1e-6, reversal_m=3e-6, temperature_k=0.01)
    made = recorded(plant(100, nuisance=real))
    verdicts = [
        diagnose(replace(made, file=made.file.model_copy(update={"nuisance": declared}))).verdict
        for declared in (DeclaredLevels(), DeclaredLevels(drift_m=0.0, reseat_m=0.0, reversal_m=0.0, temperature_k=0.0))
    ]
    assert verdicts[0] == NONE
    assert verdicts[1] != NONE


def test_a_sound_machine_in_space_has_no_effect():
    assert diagnose(simulated("delta8", 60)).verdict == NONE


def test_backlash_is_found_at_its_drive_with_its_width(backlash):
    check_consistent(backlash, load_catalogue())
    assert backlash.verdict == "backlash"
    first = backlash.effects[0]
    assert (first.effect, first.place) == ("backlash", "right")
    assert first.place_probability > 0.99
    assert first.size.unit == "m"
    assert first.size.value == pytest.approx(BACKLASH_M, abs=3.0 * first.size.u)
    assert first.size.u < 0.12 * BACKLASH_M
    assert backlash.gap.shrink_interval[0] > 0.5


def test_an_effect_that_is_asked_for_is_added_whatever_its_evidence(backlash, strong):
    """The one that the diagnosis found predicts as that does; one that is not there predicts no better."""

    def rms_m(withheld, positions_m):
        away_m = (positions_m - strong.positions_m[withheld.rows])[:, [0, 2]]  # the station looks along y
        return float(np.sqrt(np.mean(away_m**2)))

    same, other = (withheld_with(strong, {name}) for name in ("backlash", "latency"))
    np.testing.assert_allclose(same.after_m, backlash.withheld.after_m, atol=2e-7)
    np.testing.assert_allclose(other.before_m, backlash.withheld.before_m, atol=1e-12)
    assert rms_m(same, same.after_m) < 0.95 * rms_m(other, other.after_m)
    assert not np.allclose(other.after_m, other.before_m, atol=1e-9)


def test_the_gap_lies_where_the_backlash_is(backlash):
    share = {(s.kind, s.name): s.share for s in backlash.where}
    assert share["direction", "right"] > 0.5
    assert share["direction", "right"] > share["direction", "left"] + 0.3
    assert share["direction", "right"] == pytest.approx(
        max(s for (kind, _), s in share.items() if kind != "drive"), abs=0.1
    )


@pytest.mark.parametrize(
    ("name", "size", "place", "share"),
    [
        ("screw_periodic_error", 4e-5, "right", ("period", "right")),
        ("smr_reseat", 6e-5, "P2", ("time", "rig")),
        ("screw_cumulative_error", 6e-5, "left", ("drive", "left")),
    ],
)
def test_the_coordinate_that_an_effect_depends_on_has_the_largest_share(name, size, place, share):
    diagnosis = diagnose(recorded(plant(80, EffectChoice(name, size, place))))
    assert (diagnosis.verdict, diagnosis.effects[0].place) == (name, place)
    of_a_part = ("smr", "strut")  # what a shift there would explain, visit by visit
    first = max((s for s in diagnosis.where if s.kind not in of_a_part), key=lambda s: s.share)
    assert (first.kind, first.name) == share
    assert first.share > 0.6


@pytest.mark.parametrize(("name", "size"), [("column_compliance", 3e-7), ("column_thermal_growth", 30.0)])
def test_a_very_strong_effect_is_diagnosed_all_the_same(name, size):
    """Within its plausible range, though no calibration could live with it."""
    assert diagnose(recorded(plant(60, EffectChoice(name, size)))).verdict != NONE


def test_what_was_withheld_is_predicted_better(backlash, reversing, strong):
    """Against the plant's noise-free points, in the plane that the machine moves in."""
    clean, rows = noise_free_m(reversing), backlash.withheld.rows
    assert np.array_equal(np.unique(rows), np.sort(rows))
    on_platform = np.char.startswith(np.asarray(strong["smr"])[rows], "P")
    assert np.all(on_platform)
    turn = reversing.view.rotation
    before, after = (
        np.sqrt(np.mean(((p - clean[rows]) @ turn)[:, :2] ** 2))
        for p in (backlash.withheld.before_m, backlash.withheld.after_m)
    )
    achieved = 1.0 - after / before
    low, high = backlash.gap.shrink_interval
    assert low - 0.02 <= achieved <= high + 0.02
    assert before == pytest.approx(backlash.gap.before_m, rel=0.1)


def test_backlash_in_space_is_found_too():
    diagnosis = diagnose(simulated("delta8", 60, lambda a: -4.0e-5 * a.sides * np.array([0.0, 1.0, 0.0, 0.0])))
    assert diagnosis.verdict == "backlash"
    assert diagnosis.effects[0].place == "b"
    assert diagnosis.effects[0].size.value == pytest.approx(8.0e-5, abs=3.0 * diagnosis.effects[0].size.u)


def test_a_diagnosis_says_the_same_twice(strong, backlash):
    assert plain(diagnose(strong)) == plain(backlash)


def test_rows_may_come_in_any_order_of_visits(strong, backlash):
    """Names, sizes and figures follow from the readings, not from the order in the file."""
    order = np.argsort(np.random.default_rng(1).permutation(200)[strong["visit"].astype(int)], kind="stable")
    other = diagnose(changed(strong, **{n: c[order] for n, c in strong.columns.items()}))
    assert other.verdict == backlash.verdict
    assert other.effects[0].size.value == pytest.approx(backlash.effects[0].size.value, rel=1e-4)
    assert other.gap.before_m == pytest.approx(backlash.gap.before_m, rel=1e-2)


def test_what_a_campaign_cannot_show_is_not_tested():
    diagnosis = diagnose(simulated("planar4", 60))
    assert {"link_stiffness", "column_compliance", "friction_windup"} <= set(diagnosis.not_tested)
    assert all(reason and "\n" not in reason for reason in diagnosis.not_tested.values())


def test_a_period_is_found_within_a_hundredth(periodic):
    bench_period = 0.010
    effect = diagnose(periodic).effects[0]
    assert (effect.effect, effect.place) == ("screw_periodic_error", "right")
    period = next(q for q in effect.others if q.name == "period_m")
    assert period.value == pytest.approx(bench_period, rel=0.01)
    assert effect.size.value == pytest.approx(4e-5, abs=4.0 * effect.size.u)


def test_positions_off_a_grid_leave_one_period(periodic):
    assert diagnose(periodic).effects[0].aliases == ()


def test_on_a_grid_the_other_periods_that_look_alike_are_listed():
    """Sampled every 3 mm, a wave of 10 mm is one of 1 / (1/3 - 1/10) and of 1 / (1/3 + 1/10) mm."""

    def wave(a):
        return 4e-5 * np.sin(2.0 * np.pi * a.drives / 0.010) * np.array([1.0, 0.0])

    effect = diagnose(simulated("planar4", 80, wave, grid_m=0.003)).effects[0]
    assert effect.effect in ("screw_periodic_error", "encoder_interpolation")
    reported = next(q.value for q in effect.others if q.name == "period_m")
    alike = np.array([reported, *effect.aliases])
    for period_m in (0.010, 0.030 / 7.0, 0.030 / 13.0):
        assert np.min(np.abs(alike / period_m - 1.0)) < 0.01, alike


def test_with_its_class_removed_it_is_unknown(periodic):
    catalogue = load_catalogue(without=("screw_periodic_error", "encoder_interpolation"))
    diagnosis = diagnose(periodic, catalogue)
    check_consistent(diagnosis, catalogue)
    assert diagnosis.verdict == UNKNOWN
    assert diagnosis.clues[0].channel == "travel.right"
    assert all(0.0 < clue.share <= 1.0 for clue in diagnosis.clues)
    (most_like,) = [remark for remark in diagnosis.remarks if remark.startswith("most like ")]
    assert "at travel.right alone explains more" in most_like


def test_what_is_in_no_catalogue_is_unknown_until_ones_own_file_names_it(creeping, tmp_path, monkeypatch):
    """The file is the example of docs/reference/effects.md. Once it is known that one drive does it, nothing more is
    searched for on a machine that does not repeat."""
    searched, search = [], _ReadingsToSearch.search

    def counted(readings, budget):
        searched.append(readings._sd_m)
        return search(readings, budget)

    monkeypatch.setattr(_ReadingsToSearch, "search", counted)
    assert diagnose(creeping).verdict == UNKNOWN
    assert searched == [pytest.approx(1e-5, rel=0.5), 0.0]
    path = tmp_path / "mine.py"
    path.write_text(example(), encoding="utf-8")
    catalogue = load_catalogue([path])
    diagnosis = diagnose(creeping, catalogue)
    check_consistent(diagnosis, catalogue)
    own = catalogue.names[-1]
    assert diagnosis.verdict == own
    first = diagnosis.effects[0]
    assert (first.effect, first.place) == (own, "left")
    assert first.size.value == pytest.approx(CREEP_M, abs=3.0 * first.size.u)


def test_the_example_says_when_it_cannot_be_tested(creeping, tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(example(), encoding="utf-8")
    catalogue = load_catalogue([path])
    still = {f"{d}_actual_m": np.full(len(creeping), 1.0) for d in creeping.file.drives}
    inputs = SimpleNamespace(context=context_of_recording(changed(creeping, **still)))
    assert "vary" in catalogue.effects[-1].untested(inputs)


def test_the_diagnosis_knows_nothing_of_the_mock():
    code = (
        "import sys, pkgutil, importlib, calibration.diagnosis, calibration.effects\n"
        "for package in (calibration.diagnosis, calibration.effects):\n"
        "    for found in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):\n"
        "        importlib.import_module(found.name)\n"
        "from calibration.effects.catalogue import load_catalogue\n"
        "load_catalogue()\n"
        "bad = [m for m in sys.modules if m.split('.')[0] in ('mock_devices', 'pkm_rig', 'drivers')]\n"
        "sys.exit(str(bad) if bad else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("what", ["side", "rest"])
def test_a_reflector_that_goes_with_what_the_visits_had_is_no_loose_one(what):
    """To lie elsewhere at each visit explains that too, with hundreds of numbers in place of a few."""
    recording = simulated("planar4", 80, lambda a: np.zeros((len(a.drives), 2)))
    context, of_it = context_of_recording(recording), np.asarray(recording["smr"], dtype=str) == "P1"
    at_visit = {"side": context.direction[:, 0], "rest": np.exp(-context.dwell_s / 4.0)}[what]
    lies = 1e-4 * at_visit * (of_it & (recording["visit"] >= 0.0))
    position_m = recording.positions_m + lies[:, None] * [0.6, 0.0, 0.8]
    found = diagnose(changed(recording, **{f"{axis}_m": position_m[:, k] for k, axis in enumerate("xyz")}))
    assert found.verdict == UNKNOWN
    assert found.ranking["smr_reseat"] < 0.5
    assert found.clues[0].channel.startswith("smr.P1.")
