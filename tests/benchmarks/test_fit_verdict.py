"""The fit of the verdict's constants: on evidence that the tests make up, and the sources' right answers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.fit_verdict import folds, run, sources, table
from benchmarks.fit_verdict.fit import BY_EVIDENCE, BY_SEARCH, BY_SIZE, LEAST_P, Kept, fit, settings_at
from benchmarks.fit_verdict.sizes import TAILS, KeptSizes, kept_size
from benchmarks.withheld.left_out_forms import LeftOut
from calibration.base.errors import InputError
from calibration.diagnosis import departure_evidence
from calibration.diagnosis.result import FoundEffect, FoundPlace, Quantity
from calibration.diagnosis.settings import FITTED, VERDICT, VerdictSettings
from calibration.diagnosis.verdict import verdict_probabilities
from calibration.recording.folder import read_folder
from tests.benchmarks.withheld_cases import EFFECT, case_of

NAMES = ("backlash", "latency", "refraction")


def drawn(rng: np.random.Generator, right: tuple[str, ...] = ("backlash",)) -> dict:
    """The kept evidence of a case."""
    logs = {name: float(rng.normal(20.0, 15.0)) for name in NAMES[: rng.integers(1, 4)]}
    kept = {
        "log_evidence": logs,
        "explained": float(rng.normal(25.0, 15.0)),
        "excess": float(rng.exponential(12.0)),
        "none_elsewhere": float(rng.exponential(1.0)),
        "departure_gain": float(rng.exponential(80.0)),
    }
    return {"evidence": kept, "right": list(right), "size": None}


def stated_by(settings: VerdictSettings, evidence: dict) -> dict[str, float]:
    """The probabilities of the diagnosis itself."""
    of_recording = ("log_evidence", "explained", "excess")
    given = {key: value for key, value in evidence.items() if key not in of_recording}
    return verdict_probabilities(*(evidence[key] for key in of_recording), settings, **given)


def drawn_sizes(rng: np.random.Generator, settings: VerdictSettings, count: int) -> list[dict]:
    """Cases whose true sizes scatter as some settings state."""
    made = KeptSizes(np.zeros(count), rng.uniform(0.01, 0.1, count), rng.uniform(0.0, 0.9, count))
    off = rng.standard_t(TAILS, count) * made.standard_uncertainties(settings)
    keys = ("off", "u_of_fit", "absorbed")
    return [
        {"size": dict(zip(keys, map(float, c), strict=True))}
        for c in zip(off, made.u_of_fit, made.absorbed, strict=True)
    ]


def test_at_most_ten_constants_are_fitted_each_of_the_settings():
    assert len(FITTED) == len(set(FITTED))
    assert len([*BY_EVIDENCE, *BY_SIZE]) <= 10
    assert BY_SEARCH == ("smooth_departures", "departures_by_visit")
    assert sorted([*BY_EVIDENCE, *BY_SEARCH, *BY_SIZE]) == sorted(FITTED)
    assert all(hasattr(VERDICT, name) for name in FITTED)


def test_all_cases_at_once_have_the_probabilities_of_the_diagnosis():
    rng = np.random.default_rng(1)
    rows = [drawn(rng) for _ in range(60)]
    for row in rows[::3]:  # what only an alternative explains
        evidence = row["evidence"]
        evidence |= {"log_evidence": dict.fromkeys(evidence["log_evidence"], 1.5), "explained": 0.0, "excess": 20.0}
    for row in rows[1::3]:  # and what is strong
        evidence = row["evidence"]
        evidence |= {"log_evidence": dict.fromkeys(evidence["log_evidence"], 9000.0), "explained": 9500.0}
        evidence["excess"] = float(rng.uniform(100.0, 500.0))
    settings = settings_at(rng.normal(0.0, 0.5, len(BY_EVIDENCE)))
    kept = Kept.of(rows)
    for row, found in zip(rows, kept.probabilities(settings), strict=True):
        e = row["evidence"]
        expected = stated_by(settings, e)
        assert dict(zip((*kept.names, "none", "unknown"), found, strict=True)) == pytest.approx(
            {**dict.fromkeys(kept.names, 0.0), **expected}, abs=1e-12
        )


def test_an_answer_that_was_called_impossible_has_a_finite_score():
    row = drawn(np.random.default_rng(2), right=("servo_settling",))
    kept = Kept.of([row])
    assert kept.log_scores(VERDICT)[0] == pytest.approx(np.log(LEAST_P))
    assert not kept.right_verdicts(VERDICT)[0]


def from_constants(rng: np.random.Generator, settings, count: int) -> list[dict]:
    """Cases whose right answers are drawn with the probabilities that some settings state."""
    rows = []
    for _ in range(count):
        row = drawn(rng)
        e = row["evidence"]
        stated = stated_by(settings, e)
        row["right"] = [str(rng.choice(list(stated), p=np.array(list(stated.values())) / sum(stated.values())))]
        rows.append(row)
    return rows


def test_constants_that_made_the_answers_are_found_and_the_release_is_called_outside():
    """Drawn with a threshold of 30 in place of 12: the fit follows, and says that 12 is outside."""
    true = replace(VERDICT, excess_threshold=30.0)
    rng = np.random.default_rng(3)
    found = fit([Kept.of(from_constants(rng, true, 400)), Kept.of(from_constants(rng, true, 200))])
    assert found.settings.excess_threshold == pytest.approx(30.0, rel=0.25)
    assert not found.holds("excess_threshold")
    low, high = found.ranges["excess_threshold"]
    assert 12.0 < low < 30.0 < high
    assert found.settings.none_prior_log_odds == pytest.approx(7.0, rel=0.5)
    said = "\n".join(table.constant_lines([("one", found)]))
    assert "outside its range: " in said
    assert "excess_threshold" in said.splitlines()[-1]


def test_constants_of_sizes_that_made_the_deviations_are_found():
    true = replace(VERDICT, u_of_form=0.3, u_of_absorbed=0.2)
    rng = np.random.default_rng(6)
    sources_of_sizes = [KeptSizes.of(drawn_sizes(rng, true, count)) for count in (600, 300)]
    found = fit(sources_of_sizes, BY_SIZE)
    assert found.settings.u_of_form == pytest.approx(0.3, rel=0.15)
    assert found.settings.u_of_absorbed == pytest.approx(0.2, rel=0.5)
    assert not found.holds("u_of_form")
    assert found.settings.excess_threshold == VERDICT.excess_threshold
    kept = sources_of_sizes[0]
    assert np.mean(kept.covered(true)) == pytest.approx(0.88, abs=0.04)  # of a Student distribution within two scales
    assert np.mean(kept.covered(VERDICT)) < 0.88


def diagnosed(places: int, *, verdict: str = "backlash") -> SimpleNamespace:
    """A diagnosis of a play of 20 um, raw 4 sigma and visible 3, whose fit is good to 6 %."""
    of_form = np.hypot(0.11, 0.55 * 0.25)
    size = Quantity("width_m", 2e-5, 2e-5 * float(np.hypot(0.06, of_form)), "m")
    place = FoundPlace("left", size, 1.0, 4.0, 3.0)
    effect = FoundEffect("backlash", "left", size, 1.0, 1.0, 4.0, 3.0, places=(place,) * places)
    return SimpleNamespace(verdict=verdict, effects=(effect,))


def test_of_a_size_are_kept_its_deviation_and_the_parts_of_its_uncertainty():
    size = kept_size(diagnosed(1), {"backlash": 5.0})
    assert size == pytest.approx({"off": 0.25, "u_of_fit": 0.06, "absorbed": 0.25})
    assert kept_size(diagnosed(2), {"backlash": 5.0}) is None
    assert kept_size(diagnosed(1), {"latency": 5.0}) is None
    assert kept_size(diagnosed(1, verdict="unknown"), {"unknown": 5.0}) is None


def test_without_evidence_the_prior_alone_gives_the_range():
    """A case that no constant can change: something far beyond any threshold, whose every answer is right."""
    row = drawn(np.random.default_rng(5), right=("backlash", "unknown"))
    row["evidence"] = row["evidence"] | {
        "log_evidence": {"backlash": 500.0},
        "explained": 500.0,
        "excess": 0.0,
        "none_elsewhere": 0.0,
        "departure_gain": 0.0,
    }
    found = fit([Kept.of([row])])
    for name in BY_EVIDENCE:
        low, high = found.ranges[name]
        assert getattr(found.settings, name) == pytest.approx(getattr(VERDICT, name), rel=0.05)
        assert high / low == pytest.approx(2.0 ** (2.0 * 1.96), rel=0.1)


def test_folds_judge_what_they_were_not_fitted_to():
    for _, fitted_to, scored_on in table.FOLDS:
        assert scored_on not in fitted_to
    assert len(table.FOLDS[-1][1]) == 3


def test_right_answers():
    assert sources.right_of("effect", ["backlash"], True) == ("backlash",)
    assert sources.right_of("effect", ["backlash"], False) == ("backlash", "none")
    assert sources.right_of("pair", ["backlash", "latency"], True) == ("backlash", "latency")
    assert sources.right_of("outside", ["tilting"], True) == ("unknown",)
    assert sources.right_of("null", [], False) == ("none",)


def test_odd_recordings_are_never_cases(tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "find_archive", lambda folder: folder)
    asked = []
    names = [f"rec{k:03d}" for k in range(0, 20, 2)]
    monkeypatch.setattr(sources, "names_of", lambda _, *, even: asked.append(even) or names)
    assert [key for key, _ in sources.recordings(5, tmp_path)] == ["rec000", "rec004", "rec008", "rec012", "rec016"]
    assert [key for key, _ in sources.recordings(50, tmp_path)] == names
    assert asked == [True, True]


def test_the_plant_is_drawn_the_same_each_time_and_without_final_variants(monkeypatch):
    finals = []
    monkeypatch.setattr(sources, "make_case", lambda *_, final: finals.append(final) or 1 / 0)
    first, again, more = list(sources.plant(12, 5)), list(sources.plant(12, 5)), list(sources.plant(24, 5))
    assert [key for key, _ in first] == [key for key, _ in again]
    assert {key for key, _ in first} < {key for key, _ in more}
    assert {key.split("-")[1] for key, _ in first} == {"effect", "null", "outside", "pair"}
    with pytest.raises(ZeroDivisionError):
        first[0][1]()
    assert finals == [False]


def test_the_plant_is_diagnosed_without_the_forms_that_explain_it(monkeypatch, tmp_path):
    """As it is judged; what is compared is the recording without gross readings and its effect alone."""
    case, compared = case_of(replace(EFFECT, gross=True)), []

    def left_out(_, folder, changes, rng):
        compared.append((read_folder(folder).positions_m, changes))
        return LeftOut({"backlash/closing_at_rest": 0.99}, ("latency/by_speed",))

    monkeypatch.setattr(sources, "make_case", lambda *_, final: case)
    monkeypatch.setattr(sources.FormComparison, "left_out", left_out)
    key, load = next(sources.plant(1, 5))
    known = load()
    assert known.without_forms == ("backlash/closing_at_rest", "latency/by_speed")
    ((clean_m, changes),) = compared
    assert 0.0 < np.mean(np.any(clean_m != known.recording.positions_m, axis=1)) < 0.01
    assert [name for name, _, _ in changes] == ["backlash"]

    asked = []
    monkeypatch.setattr(run, "load_catalogue", lambda: SimpleNamespace(without_forms=list))
    monkeypatch.setattr(run, "diagnose", lambda recording, catalogue: asked.append(catalogue) or refuse())
    for name, some in (("structures", []), ("plant", [(key, lambda: known)]), ("recordings", [])):
        monkeypatch.setattr(run, name, lambda *_, some=some: some)
    kept = run.kept_rows(run._options(["--out", str(tmp_path), "--n", "1"]), (1.0, 1.0))
    assert kept["plant"] == []  # this one could not be diagnosed
    assert asked == [["backlash/closing_at_rest", "latency/by_speed"]]


def refuse():
    raise InputError("nothing to be seen")


def test_only_single_effects_that_can_be_seen_have_a_raw_size():
    truth = {"eligible": True, "effects": [{"effect": "backlash", "raw": 3}]}
    assert sources._raw_of_single("effect", truth) == {"backlash": 3.0}
    assert sources._raw_of_single("outside", truth) == {}
    assert sources._raw_of_single("effect", truth | {"eligible": False}) == {}
    assert sources._raw_of_single("effect", truth | {"effects": truth["effects"] * 2}) == {}


def test_sizes_departure_gain_come_back(monkeypatch):
    before = departure_evidence.SMOOTH_SHARES, departure_evidence.SHARES_BY_VISIT
    with run._departures((2.0, 0.5)):
        assert departure_evidence.SMOOTH_SHARES == (0.1, 0.3)
        assert departure_evidence.SHARES_BY_VISIT == (0.075, 0.3)
    assert before == (departure_evidence.SMOOTH_SHARES, departure_evidence.SHARES_BY_VISIT)


def test_the_report_has_all_folds_and_says_when_departures_were_not_tried():
    rng = np.random.default_rng(4)
    rows = {name: from_constants(rng, VERDICT, 30) for name in ("structures", "plant", "recordings")}
    lines, by_source = run.report({(1.0, 1.0): rows})
    assert set(by_source) == {folds.WITHOUT_PLANT, folds.WITHOUT_RECORDINGS}
    assert all(settings != VERDICT for settings in by_source.values())
    assert sum(line.startswith("fold ") for line in lines) == 3
    assert any(line.startswith("not fitted (u_of_form, u_of_absorbed)") for line in lines)
    of_sizes = {name: some + drawn_sizes(rng, VERDICT, 40) for name, some in rows.items()}
    sized = run.size_lines({name: KeptSizes.of(some) for name, some in of_sizes.items()})
    assert sized[-3] == "the release's constants by the last fold: within their ranges"
    assert sum("raw size within U" in line for line in sized) == 2
    assert lines[-1].startswith("not fitted (smooth_departures, departures_by_visit)")
    more, _ = run.report({(1.0, 1.0): rows, (2.0, 1.0): rows})
    assert more[-1] == "  2, 1: structures +0.000 +- 0.000; plant +0.000 +- 0.000; recordings +0.000 +- 0.000"


def test_without_the_recordings_the_status_is_two(tmp_path, capsys):
    assert run.main(["--data", str(tmp_path), "--out", str(tmp_path), "--n", "1"]) == 2
    assert "no recordings.tar.xz" in capsys.readouterr().err


def test_constants_of_folds_are_written_and_read_to_four_digits():
    constants = settings_at(np.random.default_rng(8).normal(0.0, 0.5, len(BY_EVIDENCE)))
    text = folds.written({folds.WITHOUT_PLANT: constants, folds.WITHOUT_RECORDINGS: VERDICT})
    assert folds.settings_without(folds.WITHOUT_RECORDINGS, text) == VERDICT
    read = folds.settings_without(folds.WITHOUT_PLANT, text)
    for name in BY_EVIDENCE:
        assert getattr(read, name) == pytest.approx(getattr(constants, name), rel=1e-3)
        assert getattr(read, name) != getattr(VERDICT, name)
    assert read.u_of_form == VERDICT.u_of_form


def test_the_kept_folds_are_whole():
    for source in (folds.WITHOUT_PLANT, folds.WITHOUT_RECORDINGS):
        assert all(getattr(folds.settings_without(source), name) > 0.0 for name in BY_EVIDENCE)


def test_rows_are_judged_by_other_constants_as_the_diagnosis_would():
    """One that never calls anything unknown against one that nearly always does; without evidence there is no row."""
    rng = np.random.default_rng(9)
    rows = [drawn(rng) | {"verdict": "none", "p": 1.0} for _ in range(30)]
    rows.append({"verdict": "none", "p": 1.0, "evidence": None})
    lax, strict = replace(VERDICT, excess_threshold=1e9), replace(VERDICT, excess_threshold=1e-9, excess_share=0.0)
    for settings in (lax, strict):
        judged = folds.judged_by(settings, rows)
        assert len(judged) == 30
        for row, given in zip(judged, rows, strict=False):
            expected = stated_by(settings, given["evidence"])
            assert row["p_by_name"] == expected
            assert row["verdict"] == max(expected, key=expected.get)
            assert row["p"] == max(expected.values())
    assert not any(row["verdict"] == "unknown" for row in folds.judged_by(lax, rows))
    assert sum(row["verdict"] == "unknown" for row in folds.judged_by(strict, rows)) > 20
