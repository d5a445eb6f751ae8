"""What is changed, and what is left alone."""

from __future__ import annotations

import json

import pytest

from tests.copied_tree import ROOT
from tests.mutants import run
from tests.mutants.mutate import mutants
from tests.mutants.run import ROOMS, SAMPLE, draw, recorded, to_try


def changed(source):
    return {mutant.apply(source) for mutant in mutants(source)}


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("x = a < b", {"x = (a <= b)", "x = (a >= b)"}),
        ("x = a + b", {"x = (a - b)"}),
        ("x = a and b", {"x = (a or b)"}),
        ("x = not a", {"x = (a)"}),
        ("x = -a", {"x = (a)"}),
        ("x = 3", {"x = (4)"}),
        ("x = 0.0", {"x = (1.0)"}),
        ("x = True", {"x = (False)"}),
        ("x += a", {"x -= a"}),
        ("def f():\n    return a", {"def f():\n    return None"}),
        ("def f():\n    go()", {"def f():\n    pass"}),
        ("def f():\n    raise E('a' + b)", {"def f():\n    pass"}),
        ("x = 'ä' + y", {"x = ('ä' - y)"}),
        ("x = (a\n     == b)", {"x = ((a != b))"}),
    ],
)
def test_one_place_is_changed_at_a_time(source, expected):
    assert changed(source) == expected


@pytest.mark.parametrize(
    "source",
    [
        '"""Text."""', "import a", "x: 'a < b' = y", "x = f'{a + 1}'", "def f(a: int | None = None) -> 'b' : ...",
        "@d(1)\ndef f(): ...", "def f():\n    _log.info('%d', 1)", "__all__ = ['a'] + ['b']",
        "def f():\n    return None",
        "class A(B, c=1): ...",
    ],
)  # fmt: skip
def test_what_is_no_behaviour_is_left_alone(source):
    assert changed(source) <= {source.replace("...", "pass")}


def test_every_mutant_of_the_code_is_a_change_in_its_place_only():
    path = ROOT / "drivers" / "can" / "sdo.py"
    text = path.read_text(encoding="utf-8")
    every = mutants(text)
    assert len(every) > 50
    for mutant in every:
        spoilt = mutant.apply(text)
        assert spoilt != text
        assert spoilt.startswith(text[: mutant.start])
        assert spoilt.endswith(text[mutant.end :])


def test_a_sample_is_the_same_for_the_same_seed_and_of_all_rooms():
    first, other = draw(100, 12), draw(100, 13)
    assert [drawn.key for drawn in first[:30]] == [drawn.key for drawn in draw(30, 12)]
    assert {drawn.key for drawn in first} != {drawn.key for drawn in other}
    assert {drawn.room for drawn in draw(300, 12)} == set(ROOMS)


def test_what_is_left_of_the_recorded_sample_is_found_again_and_nothing_else():
    names = [line.split()[:2] for line in SAMPLE.read_text(encoding="utf-8").splitlines()]
    found = recorded()
    assert len(found) >= 0.8 * len(names), "record a new sample: too much of the code has changed"
    assert len({drawn.key for drawn in found}) == len(found)
    assert [[drawn.identity, drawn.file] for drawn in found] == [
        name for name in names if name[0] in {drawn.identity for drawn in found}
    ]


@pytest.mark.parametrize(("survivors", "expected"), [(False, [3]), (True, [1, 3])])
def test_survivors_are_tried_again_if_asked_unless_they_are_equivalent(tmp_path, monkeypatch, survivors, expected):
    sample = recorded()[:4]
    file, where, before, after = sample[2].texts
    listed = {"file": file, "where": where, "before": before, "after": after, "reason": "text"}
    lines = [f"{key} = {json.dumps(value)}" for key, value in listed.items()]
    (tmp_path / "survivors.toml").write_text("\n".join(["[[survivor]]", *lines, "equivalent = true"]))
    monkeypatch.setattr(run, "SURVIVORS", tmp_path / "survivors.toml")
    known = {sample[i].key: {"ran": ran} for i, ran in enumerate(["red", "green", "green"])}
    assert to_try(sample, known, survivors=survivors) == [sample[i] for i in expected]


def test_results_that_were_taken_over_are_known_the_next_time(tmp_path):
    results = [{"key": drawn.key, "mutant": str(drawn), "ran": "red"} for drawn in recorded()[:3]]
    run.keep(tmp_path / "results.txt", results)
    assert list(run.read_kept(tmp_path / "results.txt").values()) == results
