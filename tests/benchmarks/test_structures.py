"""The generator of structures: what it shares, what it draws, how that acts; the table; a run that goes on."""

from __future__ import annotations

import ast
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.results_file import ROOT
from benchmarks.structures import run, structure
from benchmarks.structures.acting import UNITS, Acting, name_of, places
from benchmarks.structures.coordinates import Readings, lagging, within_play
from benchmarks.structures.kinds import KNOWN, MEMORIES, OUTSIDE
from benchmarks.structures.structure import (
    KNOWN_CASE,
    NULL_CASE,
    OUTSIDE_CASE,
    TURNS,
    Generator,
    draw_kind,
    draw_structure,
)
from benchmarks.structures.table import is_right, measures, printed, row_of
from benchmarks.withheld.designs import MACHINE, Drawn
from benchmarks.withheld.sizes import raw_of
from mock_devices.effects import CATALOGUE
from mock_devices.machine_file import read_machine_file
from mock_devices.recordings.design import DesignOptions, draw_design
from mock_devices.recordings.timeline import plan
from mock_devices.settings import DisturbanceLevels
from tests.kept_results import until_stopped

MAKING = [name for name in run.MAKING if name.startswith("benchmarks/structures/")]


@pytest.fixture(scope="module")
def small():
    """A design of a few visits."""
    machine = read_machine_file(MACHINE)
    options = DesignOptions(visits=24, poses=20, fly_share=0.15)
    timeline = plan(machine, draw_design(machine, np.random.default_rng(1), options))
    start_s, end_s = timeline.design.start_s, float(timeline.t_s[-1])
    return Drawn("rich0", timeline, ((start_s, 0.0), (0.5 * (start_s + end_s), 1.5), (end_s, -1.0)))


@pytest.fixture(scope="module")
def plain(small):
    return small.bench(1, DisturbanceLevels())


@pytest.fixture(scope="module")
def readings(plain):
    return Readings.of(plain)


@pytest.fixture
def generator(small):
    made = Generator(1)
    made._designs = SimpleNamespace(one=lambda style, rng: small)
    return made


# --- what it shares


@pytest.mark.parametrize("path", MAKING)
def test_making_a_case_imports_neither_the_mocks_effects_nor_the_catalogue(path):
    imported = set()
    for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            imported |= {f"{node.module}.{alias.name}" for alias in node.names}
    assert len(MAKING) == 5
    assert not [name for name in imported if name.startswith(("mock_devices.effects", "calibration"))]


def test_kinds_are_known_or_outside_and_named_after_the_catalogue():
    assert {name for names in KNOWN.values() for name in names} <= set(CATALOGUE)
    assert not set(KNOWN) & set(OUTSIDE)
    assert len(set(OUTSIDE)) == len(OUTSIDE)
    for channel, _, memory in (*KNOWN, *OUTSIDE):
        assert channel in UNITS
        assert memory in MEMORIES


def test_every_effect_and_every_channel_is_drawn_as_often():
    rng = np.random.default_rng(1)
    first = [KNOWN[draw_kind(KNOWN_CASE, rng)][0] for _ in range(2000)]
    names = {names[0] for names in KNOWN.values()}
    assert set(first) == names
    assert max(map(first.count, names)) < 2 * min(map(first.count, names))
    channels = [draw_kind(OUTSIDE_CASE, rng)[0] for _ in range(600)]
    assert set(channels) == {kind[0] for kind in OUTSIDE}


# --- what it draws


@pytest.mark.parametrize("kind", [*KNOWN, *OUTSIDE], ids="-".join)
def test_every_kind_is_a_function_of_its_coordinate_alone(kind, readings, plain):
    drawn = draw_structure(kind, readings, plain.nominal, np.random.default_rng(3))
    assert drawn is not None
    assert np.all(np.isfinite(drawn.shifts))
    assert np.mean(drawn.shifts**2) == pytest.approx(1.0)
    _, coordinate, memory = kind
    if memory == "none" and coordinate in ("side", "load", "speed", "time"):
        x = [readings.coordinate(coordinate, own, "struts") for own in (0, 1)]
        assert any(all(np.ptp(drawn.shifts[each == level]) < 1e-9 for level in set(each)) for each in x)
    if memory == "none" and coordinate.startswith("side*"):
        sizes = [readings.side[:, own] * drawn.shifts[:, 0] for own in (0, 1)]
        visited = readings.side[:, 0] != 0.0
        assert any(np.all(size[visited] > 0.0) or np.all(size[visited] < 0.0) for size in sizes)


def test_memories_by_hand():
    lagged = lagging(np.array([0.0, 1.0, 3.0]), np.array([1.0, 3.0, 0.0]), 2.0)
    after = 3.0 - 2.0 * np.exp(-0.5)
    np.testing.assert_allclose(lagged, [1.0, after, after * np.exp(-1.0)])
    np.testing.assert_allclose(within_play(np.array([0.0, 1.0, 0.8, 0.0, -3.0]), 0.5), [0.0, 0.5, 0.3, -0.5, -0.5])


def test_a_case_is_that_of_its_number_and_has_the_size_that_it_says(generator, plain):
    for number in (0, 1, 3):
        made, again = generator.case(number), generator.case(number)
        assert made.truth == again.truth
        np.testing.assert_array_equal(made.recording.columns["x_m"], again.recording.columns["x_m"])
        assert made.truth["kind"] == TURNS[number]
        assert bool(made.truth["names"]) is (TURNS[number] == KNOWN_CASE)
        assert made.truth["visible"] >= (0.0 if TURNS[number] == NULL_CASE else structure.VISIBLE)
    assert generator.case(6).truth["size"] != generator.case(0).truth["size"]


def test_a_size_is_found_or_refused(readings, plain):
    drawn = draw_structure(("sideways", "place", "none"), readings, plain.nominal, np.random.default_rng(3))
    size = structure._size(plain, drawn, 5.0)
    change = structure._change_m(plain, drawn.acting(plain.nominal, size))
    assert raw_of(plain, change) == pytest.approx(5.0, rel=0.01)
    assert structure._size(plain, drawn, 1e4) is None


def test_nothing_is_wrong_with_a_null_case(generator, small):
    profile = generator.case(3).truth["profile"]
    seed = int(np.random.default_rng([1, 3]).integers(2**31))
    record = small.bench(seed, structure.PROFILES[profile]).record()
    np.testing.assert_array_equal(generator.case(3).recording.columns["x_m"], record.columns["x_m"])


# --- how it acts


def moved(bench, channel, place=0, direction=0.0, size=1e-4, axis=(0.0, 0.0, 1.0)):
    """Change of the readings in the machine's frame, and the machine file's SMR of each."""
    shifts = np.full((len(bench.timeline), len(bench.nominal.sliders)), size)
    acting = Acting(bench.nominal, channel, place, shifts, direction, axis)
    change = structure._change_m(bench, acting) @ bench.view.rotation
    names = np.array([smr.name for smr in bench.nominal.smrs])[bench.timeline.smr]
    return change, names


def test_channels_move_what_they_name(plain):
    change, names = moved(plain, "travel", 1)
    assert name_of("travel", 1, plain.nominal) == "right"
    np.testing.assert_allclose(change[names == "SR"], [[0.0, 1e-4, 0.0]] * np.sum(names == "SR"), atol=1e-6)
    np.testing.assert_allclose(change[names == "SL"], 0.0, atol=1e-9)
    assert np.mean(np.abs(change[names == "P1"][:, 1])) > 2e-5
    (first, *_) = places("reflector", plain.nominal)
    change, names = moved(plain, "reflector", first, 0.5 * np.pi)
    assert set(names[np.linalg.norm(change, axis=1) > 1e-7]) == {name_of("reflector", first, plain.nominal)}
    change, names = moved(plain, "floor")
    np.testing.assert_allclose(change[names == "P2"][:, 0], 1e-4, atol=1e-7)
    np.testing.assert_allclose(change[np.char.startswith(names, "N")], 0.0, atol=1e-9)
    change, names = moved(plain, "sideways", 0)
    np.testing.assert_allclose(change[names == "SL"][:, 0], -1e-4, atol=1e-6)
    for channel in UNITS.keys() - {"travel", "reflector", "floor", "sideways"}:
        change, _ = moved(plain, channel, 0, 1.0, UNITS[channel][0])
        assert np.max(np.linalg.norm(change, axis=1)) > 1e-7, channel


def test_a_station_that_moves_keeps_its_own_drift(small, plain):
    drifting = small.bench(1, DisturbanceLevels(drift_m=1e-3))
    shifts = np.full((len(plain.timeline), 1), 1e-4)
    acting = Acting(plain.nominal, "station", 0, shifts, 0.7, (0.0, 0.6, 0.8))
    campaign = structure.StructuredCampaign(small, 1, "drifting", acting)
    campaign.settings = drifting.settings
    both = campaign.points_m() - plain.points_m([])
    each = structure._change_m(plain, acting) + drifting.points_m() - plain.points_m([])
    assert np.max(np.linalg.norm(both, axis=1)) > 1.5e-4
    np.testing.assert_allclose(both, each, atol=1e-6)


# --- the table


def case(key, kind, names=(), **more):
    return {
        "key": key, "kind": kind, "channel": "travel", "coordinate": "place", "memory": "none", "place": "left",
        "names": list(names), "size": 1e-5, "raw": 3.0, "visible": 2.0, "profile": "small", **more,
    }  # fmt: skip


def said(verdict, p=0.9, **ranking):
    return {
        "seconds": 1.0,
        "diagnosis": {"verdict": verdict, "ranking": {verdict: p, **ranking}, "effects": [], "clues": []},
    }  # fmt: skip


def test_the_table_is_counted_by_hand():
    two = ("backlash", "friction_windup")
    rows = [
        row_of(case("a", KNOWN_CASE, two), said("friction_windup", 0.995)),
        row_of(case("b", KNOWN_CASE, two), said("unknown", 0.6, latency=0.2, backlash=0.1)),
        row_of(case("c", KNOWN_CASE, two, raw=5.0), said("latency", 0.999)),
        row_of(case("d", KNOWN_CASE, two), {"seconds": 1.0, "error": "InputError: x"}),
        row_of(case("e", OUTSIDE_CASE), said("unknown")),
        row_of(case("f", OUTSIDE_CASE, memory="play"), said("backlash", 0.5, unknown=0.4)),
        row_of(case("g", NULL_CASE), said("none")),
        row_of(case("h", NULL_CASE), said("unknown")),
        row_of(case("i", NULL_CASE), said("backlash", 0.6)),
    ]
    assert [is_right(row) for row in rows] == [True, False, False, False, True, False, True, False, False]
    by_name = {m.name.strip(): (m.value, m.n) for m in measures(rows)}
    assert by_name["structure of a known effect: named right"] == (0.25, 4)
    assert by_name["one right name among the first three"] == (0.5, 4)
    assert by_name["another effect named"] == (0.25, 4)
    assert by_name["called unknown"] == (0.25, 4)
    assert by_name["structure of none called unknown"] == (0.5, 2)
    assert by_name["called an effect"] == (0.5, 2)
    assert by_name["null cases called an effect"] == (pytest.approx(1 / 3), 3)
    assert by_name["right when p > 0.99"] == (0.5, 2)
    assert by_name["known, raw 3.0: named right"] == (pytest.approx(1 / 3), 3)
    assert by_name["diagnoses that failed"] == (pytest.approx(1 / 9), 9)
    text = printed(rows)
    assert "d: travel left by place (backlash or friction_windup; raw 3, visible 2.0, small disturbances): In" in text
    assert "f: travel left by place, play (outside; raw 3" in text
    assert "i: nothing, small disturbances: backlash (backlash 0.600)" in text
    assert "\na: " not in text


# --- a run


def test_a_run_that_is_stopped_goes_on_and_grows(tmp_path, monkeypatch, capsys):
    asked, stop = [], [1]

    class Diagnoser:
        def __init__(self, *_, **__):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def diagnose(self, folder):
            assert folder.name == "recording"  # nothing that tells which case it is
            if len(asked) == stop[0]:
                stop[0] = -1
                raise KeyboardInterrupt
            asked.append(folder)
            return said("none")

    made = SimpleNamespace(case=lambda k: SimpleNamespace(recording=None, truth=case(f"s5-{k}", NULL_CASE)))
    monkeypatch.setattr(run, "SealedDiagnoser", Diagnoser)
    monkeypatch.setattr(run, "Generator", lambda seed: made)
    monkeypatch.setattr(run, "write_recording", lambda recording, folder: None)
    arguments = ["--seed", "5", "--out", str(tmp_path), "--n"]
    assert until_stopped(lambda: run.main([*arguments, "2"])) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "stopped; the same command goes on from here"
    assert run.main([*arguments, "2"]) == 0
    assert len(asked) == 2
    capsys.readouterr()
    assert run.main([*arguments, "3"]) == 0
    assert len(asked) == 3
    (line,) = [text for text in capsys.readouterr().out.splitlines() if text.startswith("null cases")]
    assert line.split()[-2] == "3"
    monkeypatch.setattr(run, "code_digest", lambda *_: "another version")
    assert run.main([*arguments, "1"]) == 0
    assert len(asked) == 4


def test_a_diagnoser_that_cannot_be_shut_in_ends_the_run_with_a_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("benchmarks.withheld.sealed_diagnoser.WAYS", ())
    monkeypatch.setattr(run, "Generator", lambda seed: None)
    assert run.main(["--n", "1", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("structures: the diagnoser cannot be shut in here")
