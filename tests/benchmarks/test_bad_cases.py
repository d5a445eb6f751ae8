"""Campaigns with a mistake: what becomes of a few of them, and what the benchmark counts."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.bad_cases.campaign import PlantCampaign, nothing
from benchmarks.bad_cases.cases import GOOD, KINDS, Case, draw
from benchmarks.bad_cases.run import REFUSED, SURVIVED, WORSE, run_case, table_of

SMALL = {"poses": 16, "verification_poses": 30}


def test_a_good_campaign_is_accepted_and_its_tables_are_truly_good(tmp_path):
    found = run_case(draw(GOOD, 0), tmp_path, **SMALL)
    assert (found["outcome"], set(found["true_m"])) == (SURVIVED, {0, 1})
    assert all(after < 0.3 * before for before, after in found["true_m"].values())


@pytest.mark.parametrize(
    ("case", "why"),
    [
        (Case(KINDS[0], 1, swapped=("P1", "P2")), "WrongTarget"),
        (Case(KINDS[0], 2, swapped=("P1", "P3"), swapped_from=0.2, guarded=False), ""),
        (Case(KINDS[2], 3, file_changes=(("length_m = 1.5", "length_m = 1.3"),)), "InputError: machine planar4"),
        (Case(KINDS[3], 4, turned=0), "WrongTarget"),
        (Case(KINDS[3], 5, turned_table=1), "verdict: "),
    ],
    ids=["reflectors", "reflectors, no guard", "file", "drive", "table"],
)
def test_mistakes_that_tell_are_refused(case, why, tmp_path):
    found = run_case(case, tmp_path, **SMALL)
    assert found["outcome"] == REFUSED
    assert found["why"].startswith(why)


def test_a_wrong_payload_ends_with_tables_that_are_better_than_none_or_with_none(tmp_path):
    found = run_case(Case(KINDS[1], 6, truly_kg={2: 0.0}), tmp_path, **SMALL)
    assert found["outcome"] in (REFUSED, SURVIVED)


def test_cases_follow_from_kind_and_number_and_differ():
    for kind in KINDS:
        cases = [draw(kind, number) for number in range(25)]
        assert cases == [draw(kind, number) for number in range(25)]
        assert len({case.what for case in cases}) >= 4
        assert all(case.kind == kind for case in cases)


def test_a_mistake_is_planted_where_it_says(tmp_path):
    plain, turned = (PlantCampaign(case, tmp_path) for case in (Case(GOOD, 1), Case(KINDS[3], 1, turned=1)))
    table = PlantCampaign(Case(KINDS[3], 1, turned_table=0), tmp_path)
    drives, added = np.array([0.7, 0.9]), np.array([1e-4, 2e-4])
    assert plain.stands_at(drives, lambda _q: added) == pytest.approx(drives + added)
    assert table.stands_at(drives, lambda _q: added) == pytest.approx([0.7 - 1e-4, 0.9 + 2e-4])
    assert turned.stands_at(drives, nothing) == pytest.approx([0.7, 0.32 + 1.70 - 0.9])


def row(kind, outcome):
    return {"kind": kind, "number": 3, "what": "w", "why": "y", "outcome": outcome}


def test_what_is_worse_than_none_is_named_and_fails():
    good = [row(GOOD, SURVIVED)] * 99 + [row(GOOD, REFUSED)]
    lines, reached = table_of([row(KINDS[0], REFUSED), row(KINDS[1], SURVIVED), *good])
    assert reached
    assert "ok    good ones accepted: 99 of 100, at least 99 of 100" in lines
    lines, reached = table_of([row(KINDS[0], WORSE), *good])
    assert not reached
    assert f"      {KINDS[0]} 3: w: y" in lines
    assert not table_of([row(GOOD, REFUSED)] * 2 + good)[1]
