"""Cases of the check on withheld data: what is made, what is left out of the catalogue, what could be taken for it."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from benchmarks.withheld.cases import DECLARED, DECOYS, FULL, INDEX_OF_AIR, PROFILES, STYLES, Slot, plan
from benchmarks.withheld.designs import FEW, Designs, Drawn, lasting, with_visits
from benchmarks.withheld.left_out_forms import FormComparison, decoys_among, shares_of_sets
from benchmarks.withheld.making import PERIODIC, _as_declared, _at_places, fact, make_case
from benchmarks.withheld.mimics import Mimics
from calibration.diagnosis.basis_set_evidence import InformationAndScore
from calibration.effects.api import BasisSets
from calibration.recording.folder import read_folder
from mock_devices.effects import CATALOGUE, OUTSIDE, OUTSIDE_FINAL, SPECS, EffectChoice
from mock_devices.effects.base import names_of
from mock_devices.recordings.files import write_recording
from mock_devices.recordings.timeline import plan as timeline_of
from tests.benchmarks.withheld_cases import EFFECT, NEXT, NULL, OUT, UNDECLARED, case_of, designs
from tests.docs.pages import ROOT
from tests.mock_devices.effects_bench import Alone


def test_a_case_has_one_of_the_variants_that_its_slot_names():
    slot = Slot("effect-r", "effect", ("refraction",), (5.0,), variants=INDEX_OF_AIR[:1])
    assert case_of(slot).truth["effects"][0]["variant"] == "index_offset"


def test_a_full_run_has_all_the_cases_that_are_wanted():
    slots = plan()
    assert len({slot.key for slot in slots}) == len(slots) == sum(FULL.values())
    big = Counter(s.effects[0] for s in slots if s.kind == "effect" and s.raw[0] >= 3.0)
    assert set(big) == set(CATALOGUE)
    assert min(big.values()) >= 30
    assert {s.raw[0] for s in slots if s.kind == "effect"} == {1.0, 3.0, 5.0}
    index = [s for s in slots if s.kind == "effect" and set(s.variants) == set(INDEX_OF_AIR)]
    assert {s.effects for s in index} == {("refraction",)}
    assert sum(s.raw[0] >= 3.0 for s in index) >= 20
    bent = [s for s in slots if s.kind == "effect" and s.effects == ("refraction",) and s not in index]
    assert {v for s in bent for v in s.variants} == set(SPECS["refraction"].variants) - set(INDEX_OF_AIR)
    assert slots == plan()
    several = Counter(s.effects[0] for s in slots if s.several)
    assert set(several) == {name for name in CATALOGUE if SPECS[name].place != "rig"}
    assert min(several.values()) >= 9
    null = [s for s in slots if s.kind == "null"]
    assert Counter(s.profile for s in null) == dict.fromkeys(PROFILES, 320)
    assert Counter(s.declared for s in null) == dict.fromkeys(DECLARED, 400)
    assert len({(s.profile, s.declared, s.style) for s in null}) == len(PROFILES) * len(DECLARED) * len(STYLES)
    assert {s.style for s in slots if s.kind == "outside"} == set(STYLES)
    assert {s.declared for s in slots if s.kind == "misdeclared"} == set(DECLARED) - {"right"}
    assert all(s.declared == "right" for s in slots if s.kind not in ("null", "misdeclared"))
    assert sum(s.gross for s in slots) == pytest.approx(len(slots) / 5, rel=0.05)
    assert {s.kind for s in slots if s.gross} == set(FULL)
    pairs = [set(s.effects) for s in slots if s.kind == "pair"]
    assert all(len(pair) == 2 for pair in pairs)
    assert len({frozenset(pair) for pair in pairs}) > 100
    assert {s.effects[0] for s in slots if s.kind == "outside"} == set(OUTSIDE)
    final = Counter(s.effects[0] for s in plan(final=True) if s.kind == "outside")
    assert set(final) == {*OUTSIDE, *OUTSIDE_FINAL}
    assert min(final.values()) >= 7
    assert sum(s.decoy for s in slots) == DECOYS
    assert len(plan(60)) == pytest.approx(60, abs=4)
    assert {s.kind for s in plan(60)} == set(FULL)


def test_the_page_has_the_counts_of_a_full_run():
    text = (ROOT / "docs" / "explanation" / "withheld.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\w+) \| ([\d,]+) \| (.*) \|$", text, re.MULTILINE)
    counts = {kind: int(count.replace(",", "")) for kind, count, _ in rows}
    assert counts == FULL
    said = {kind: what for kind, _, what in rows}
    assert said["effect"].startswith(f"{len(CATALOGUE)} effects")
    assert said["outside"].startswith(f"{len(OUTSIDE)} effects")
    assert len(OUTSIDE_FINAL) == 4  # "and in a final run four more"


@pytest.mark.parametrize("slot", [EFFECT, OUT, NEXT], ids=lambda slot: slot.kind)
def test_cases_have_the_sizes_that_they_say(slot):
    case = case_of(slot)
    fact = case.truth["effects"][0]
    spec = SPECS[fact["effect"]]
    assert fact["raw"] == pytest.approx(slot.raw[0], rel=0.006)
    assert fact["visible"] >= 0.5
    assert case.truth["nuisance_raw"] * 3.0 <= slot.raw[0]
    assert not fact["final"]
    assert spec.size.low <= fact["size"] <= spec.size.high
    if slot.kind != "next":  # those are sized on a rich design
        assert case.truth["raw"] == pytest.approx(slot.raw[0], rel=0.02)


@pytest.mark.parametrize(("name", "kind"), [("link_stiffness", "strut"), ("backlash", "drive"), ("smr_reseat", "smr")])
def test_an_effect_at_several_places_is_one_effect(name, kind):
    """One variant at each of its places, sized together; what is compared with the catalogue is each place's own."""
    slot = Slot("effect-s", "effect", (name,), (5.0,), several=True)
    case = case_of(slot)
    (fact,) = case.truth["effects"]
    choices = case.bench.settings.effects
    assert len(choices) >= 2
    assert {choice.variant for choice in choices} == {fact["variant"]}
    assert sorted(choice.place for choice in choices) == sorted(set(fact["places"]))
    assert set(fact["places"]) <= set(names_of(case.drawn.timeline.machine, kind))
    assert fact["place"] == ""
    assert case.truth["raw"] == pytest.approx(5.0, rel=0.02)
    changes = case.changes_by_effect()
    assert [(effect, place) for effect, place, _ in changes] == [(name, place) for place in fact["places"]]
    whole = np.linalg.norm(case.change_m)
    assert all(0.1 * whole < np.linalg.norm(change) for _, _, change in changes)
    off = np.linalg.norm(sum(change for _, _, change in changes) - case.change_m)
    assert off < (0.25 if kind == "strut" else 0.01) * whole  # struts share their forces with one another


def test_a_null_case_has_nothing_but_its_profile():
    case = case_of(NULL)
    assert case.truth["effects"] == []
    assert case.truth["raw"] == 0.0
    assert case.recording.header["nuisance"] == vars(PROFILES["warm"])


def test_readings_differ_from_the_noise_free_ones_by_stated_noise_only(tmp_path):
    case = case_of(EFFECT)
    columns = case.recording.columns
    measured = np.stack([columns[c] for c in ("x_m", "y_m", "z_m")], axis=1)
    write_recording(case.recording, tmp_path / "x")
    spread = np.linalg.cholesky(read_folder(tmp_path / "x").covariances_m2)
    white = np.linalg.solve(spread, (measured - case.noise_free_m)[:, :, None])
    assert np.std(white) == pytest.approx(1.0, rel=0.12)  # the tails are heavy
    assert abs(np.mean(white)) < 0.05


def test_every_torque_holds_friction():
    """Without it the torque alone would tell that a screw is wound up."""
    for slot in (EFFECT, NULL):
        columns = case_of(slot).recording.columns
        for drive in ("left", "right"):
            side, torque = columns[f"{drive}_direction"], columns[f"{drive}_torque_ratio"]
            at_rest = (columns[f"{drive}_velocity_m_per_s"] == 0.0) & (columns["payload"] == 0.0)
            means = [torque[at_rest & (side == way)].mean() for way in (-1.0, 1.0)]
            assert abs(means[1] - means[0]) > 0.005, (slot.key, drive)


def test_gross_readings_and_declared_levels_are_those_of_the_slot():
    case = case_of(UNDECLARED)
    assert "nuisance" not in case.recording.header
    assert list(case.clean.columns) == list(case.recording.columns)
    place = [
        np.stack([made.columns[name] for name in ("x_m", "y_m", "z_m")], axis=1)
        for made in (case.clean, case.recording)
    ]
    off = np.linalg.norm(place[1] - place[0], axis=1)
    assert 1 <= np.count_nonzero(off) <= 6
    assert np.all((off == 0.0) | ((off >= 1e-4 * (1 - 1e-6)) & (off <= 1e-2)))
    for declared, factor in DECLARED.items():
        if factor is not None:
            header = _as_declared(case_of(NULL).recording, declared).header
            assert header["nuisance"]["drift_m"] == pytest.approx(factor * PROFILES["warm"].drift_m)
    assert case_of(NULL).recording.header["nuisance"] == vars(PROFILES["warm"])


def test_a_form_that_explains_what_the_plant_does_is_left_out_with_a_decoy(tmp_path):
    reseat = replace(EFFECT, effects=("smr_reseat",))
    cases = (make_case(reseat, np.random.default_rng(seed), designs(), final=False) for seed in range(50, 90))
    case = next(case for case in cases if case.truth["effects"][0]["variant"] == "each_exchange")
    write_recording(case.recording, tmp_path / "x")
    comparison = FormComparison()
    left_out = comparison.left_out(tmp_path / "x", case.changes_by_effect(), np.random.default_rng(1))
    assert set(left_out.explained) == {"smr_reseat/exchanges"}  # not the textbook's step
    assert 0.98 < left_out.explained["smr_reseat/exchanges"] <= 1.0
    (decoy,) = left_out.decoys
    assert decoy.partition("/")[0] not in ("smr_reseat", "")
    assert left_out.names == tuple(sorted(("smr_reseat/exchanges", decoy)))
    drawn = case.changes_by_effect()[0][2]
    elsewhere = comparison.left_out(tmp_path / "x", [("latency", "", drawn)], np.random.default_rng(1))
    assert elsewhere.explained == left_out.explained  # whichever effect a form belongs to
    nothing = comparison.left_out(tmp_path / "x", [], np.random.default_rng(1))
    assert not nothing.explained
    assert len({name.partition("/")[0] for name in nothing.decoys}) >= 2


@pytest.mark.parametrize(
    ("name", "variant"), [(name, variant) for name in sorted(PERIODIC) for variant in SPECS[name].variants]
)
def test_the_period_that_is_asked_for_is_that_of_the_error_itself(name, variant):
    """Against the strongest wave of 64 periods of what errs, the longer one of two that are alike."""
    drawn, stated_m = designs().one("rich", np.random.default_rng(2)), 1e-3 if name == "encoder_interpolation" else 1e-2
    choice = EffectChoice(name, 1e-6, "left", variant, ((PERIODIC[name], stated_m),))
    one = Alone(name, 1e-6, place="left", variant=variant, **{PERIODIC[name]: stated_m})
    one.move(0, 0.5)  # some only err once their drive has moved some way
    q = np.full((4096, 2), 1.1)
    q[:, 0] = 0.5 + 64.0 * stated_m * np.arange(4096) / 4096.0
    waves = np.abs(np.fft.rfft(one.deviation(t_s=np.full(4096, one.t_s), q=q).travel_m[:, 0]))[1:]
    strongest_m = 64.0 * stated_m / (1 + np.flatnonzero(waves > 0.95 * waves.max())[0])
    assert fact(choice, drawn=drawn, raw=3.0, visible=3.0)["period_m"] == pytest.approx(strongest_m, rel=0.005)


@pytest.mark.parametrize("seed", range(8))
def test_reflectors_never_move_alike(seed):
    """Together they would be a platform that moves."""
    slot = Slot("effect-s", "effect", ("smr_reseat",), (5.0,), several=True)
    drawn = designs().one("rich", np.random.default_rng(2))
    choices = _at_places(slot, "smr_reseat", drawn, np.random.default_rng(seed), final=False)
    assert len(choices) == len({choice.place for choice in choices}) == len({choice.seed for choice in choices}) == 2


def test_of_an_effect_with_another_period_at_each_place_none_is_asked_for():
    drawn = designs().one("rich", np.random.default_rng(2))
    choices = [
        EffectChoice("screw_periodic_error", 1e-6, place, "sine", (("period_m", period_m),))
        for place, period_m in (("left", 0.01), ("right", 0.01), ("right", 0.02))
    ]
    alike = fact(choices[0], choices[1], drawn=drawn, raw=3.0, visible=3.0)
    assert (alike["period_m"], alike["place"], alike["places"]) == (0.01, "", ["left", "right"])
    assert "period_m" not in fact(choices[0], choices[2], drawn=drawn, raw=3.0, visible=3.0)


def test_decoys_do_not_depend_on_what_was_compared_before(tmp_path):
    """A run that goes on after a stop begins with another recording, whose design may have fewer forms."""
    for style in ("poor", "rich"):
        case = make_case(replace(NULL, style=style), np.random.default_rng(3), designs(), final=False)
        write_recording(case.recording, tmp_path / style)
    after = FormComparison()
    after.left_out(tmp_path / "poor", [], np.random.default_rng(1))
    for seed in range(3):
        fresh = FormComparison().left_out(tmp_path / "rich", [], np.random.default_rng(seed))
        assert after.left_out(tmp_path / "rich", [], np.random.default_rng(seed)) == fresh


@pytest.mark.parametrize("seed", range(5))
def test_decoys_are_never_of_a_true_effect(seed):
    forms = {"backlash": ("a", "b"), "latency": ("c", "d"), "payload": (), "refraction": ("e",)}
    rng = np.random.default_rng(seed)
    assert set(decoys_among(forms, {"backlash"}, 3, rng)) == {"latency/c", "latency/d", "refraction/e"}
    none_explained = decoys_among(forms, {"backlash"}, 0, rng)
    assert none_explained
    assert {name.partition("/")[0] for name in none_explained} <= {"latency", "refraction"}


def test_what_forms_explain_is_what_least_squares_says():
    rng = np.random.default_rng(4)
    columns, built = rng.standard_normal((50, 5)), BasisSets()
    for k, form in enumerate(("law", "bent", "", "twice", "twice")):
        built.add(("travel.left", columns[:, k]), form=form)
    built.add_set([0], [1, 2])
    built.add_set([3, 4])
    change = columns @ np.array([3.0, 1.0, 0.3, 0.5, -0.4])
    known = InformationAndScore(columns.T @ columns, columns.T @ change)
    shares = shares_of_sets(built, known, float(change @ change), "law")

    def explained(chosen):
        left = change - columns[:, chosen] @ np.linalg.lstsq(columns[:, chosen], change, rcond=None)[0]
        return 1.0 - float(left @ left) / float(change @ change)

    assert shares == pytest.approx({"bent": explained([0, 1]), "twice": explained([3, 4])})


@lru_cache
def small_design():
    drawn = designs().by_name("rich0")
    design = drawn.timeline.design
    return Drawn("small", timeline_of(drawn.timeline.machine, with_visits(design, design.visits[::6])), drawn.programme)


@lru_cache
def small_library():
    return Mimics(small_design(), draws=1)


@pytest.mark.parametrize(
    ("name", "variant", "other"), [("column_compliance", "yaw", "joint_clearance"), ("backlash", "play", "")]
)
def test_mimics_are_found_and_others_are_not(name, variant, other):
    sizes = small_design().visible.sizes
    choice = sizes.scaled(EffectChoice(name, SPECS[name].size.middle, "left", variant, (), 3), 4.0)
    change = sizes.change_m(choice)
    fact = {"effect": name, "place": "left", "seed": 3, "parameters": {}}
    result = small_library().distances(fact, change)
    assert name not in result
    assert set(result) == set(CATALOGUE) - {name}
    visible = small_design().visible.visible_size_of_change(change)
    if other:
        assert result[other] < 0.5
    else:
        assert result["tracker_drift"] > 0.7 * visible


@pytest.mark.parametrize("hours", [2.0, 8.0])
@pytest.mark.parametrize("style", FEW)
def test_campaigns_last_as_long_as_they_are_asked_to(style, hours):
    drawn = Designs(3, FEW, lasting(hours)).by_name(f"{style}0")
    assert drawn.duration_s == pytest.approx(3600.0 * hours, rel=0.2)
