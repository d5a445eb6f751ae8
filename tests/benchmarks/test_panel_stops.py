"""When it is decided whether a page makes stops slower."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.panel_stops import FAULTS, KINDS, TRIPS, block_of, interlock_ms, lines_of, ratio_of

INTERLOCK, FAULT = KINDS


def block(draw, factor, spell=0.0):
    """Stops of some ms, and in a slow spell, which lasts a block, of so many times as much."""
    factor = factor * (1.0 + spell * draw.exponential())
    return {
        "between_polls": (factor * draw.uniform(8.0, 12.0, 10 * TRIPS)).tolist(),
        "rest": (factor * draw.uniform(1.0, 3.0, TRIPS)).tolist(),
        "fault": (factor * draw.exponential(1.0, FAULTS)).tolist(),
    }


def pairs(count, slower, seed, spell=0.0):
    draw = np.random.default_rng(seed)
    return [{"without": block(draw, 1.0, spell), "with": block(draw, slower, spell)} for _ in range(count)]


@pytest.mark.parametrize(
    ("count", "slower", "verdict"), [(60, 1.0, "ok"), (60, 1.4, "missed"), (3, 1.08, "not decided")]
)
def test_it_is_decided_where_there_are_enough_pairs(count, slower, verdict):
    found = ratio_of(pairs(count, slower, seed=3), FAULT)
    assert found.verdict == verdict
    assert found.low < found.with_ms / found.without_ms < found.high
    assert found.count == count * FAULTS
    assert ratio_of(pairs(count, slower, seed=3), INTERLOCK).count == count * TRIPS
    rows, good = lines_of(pairs(count, slower, seed=3))
    assert [row[-1] for row in rows][1] == verdict
    assert good == (verdict == "ok")


@pytest.mark.parametrize("kind", KINDS)
def test_the_interval_holds_the_truth_as_often_as_it_says(kind):
    """Also where a busy computer slows whole blocks: stops of one block are no independent ones."""
    found = [ratio_of(pairs(30, 1.05, seed=seed, spell=0.2), kind, seed, draws=100) for seed in range(40)]
    assert sum(one.low <= 1.05 <= one.high for one in found) >= 34  # of 40 at 95 %: fewer with a chance below 1 %


def test_what_is_expected_is_the_mean_over_a_bit_that_opens_at_any_time():
    """Polls 4 and 12 ms apart in turns, stop frames 2 ms after a poll, bits that open at any time."""
    ends = np.cumsum([4.0, 12.0] * 500)
    opened = np.random.default_rng(1).uniform(0.0, ends[-1], 200_000)
    waited = ends[np.searchsorted(ends, opened)] - opened
    one = {"between_polls": [4.0, 12.0] * 500, "rest": [2.0] * 5, "fault": []}
    assert interlock_ms([one]) == pytest.approx(float(np.mean(waited)) + 2.0, rel=0.01)


def test_a_stop_that_found_the_drives_at_rest_says_nothing():
    rows = [
        {"total_ms": 7.0, "polling_ms": 5.0, "between_polls_ms": [10.0, 9.0]},
        {},
        {"fault_ms": 1.0, "between_polls_ms": [11.0]},
    ]
    assert block_of(rows) == {"between_polls": [10.0, 9.0, 11.0], "rest": [2.0], "fault": [1.0]}
