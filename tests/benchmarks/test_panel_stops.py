"""When it is decided whether a page makes stops slower."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.panel_stops import TRIPS, lines_of, ratio_of


def pairs(count, slower, seed, spell_ms=0.0):
    """Pairs of blocks of stops of 3 to 13 ms; in some blocks, without a page or with one alike, all are slow."""
    draw = np.random.default_rng(seed)

    def block(factor):
        return (factor * draw.uniform(3.0, 13.0, TRIPS) + spell_ms * draw.exponential()).tolist()

    times = ({"without": block(1.0), "with": block(slower)} for _ in range(2 * count))
    return [{"total_ms": one, "fault_ms": other} for one, other in zip(times, times, strict=True)]


@pytest.mark.parametrize(
    ("count", "slower", "verdict"), [(200, 1.0, "ok"), (40, 1.4, "missed"), (4, 1.0, "not decided")]
)
def test_it_is_decided_where_there_are_enough_pairs(count, slower, verdict):
    found = ratio_of(pairs(count, slower, seed=3), "total_ms")
    assert found.verdict == verdict
    assert found.low < found.with_ms / found.without_ms < found.high
    assert found.count == count * TRIPS
    rows, good = lines_of(pairs(count, slower, seed=3))
    assert {row[-1] for row in rows} == {verdict}
    assert good == (verdict == "ok")


def test_the_interval_holds_the_truth_as_often_as_it_says():
    """Also where a busy computer slows whole blocks: stops of one block are no independent ones."""
    found = [ratio_of(pairs(30, 1.05, seed=seed, spell_ms=2.0), "total_ms", seed, draws=100) for seed in range(40)]
    many = [pair["total_ms"] for pair in pairs(4000, 1.05, seed=99, spell_ms=2.0)]
    middle = np.median([pair["with"] for pair in many]) / np.median([pair["without"] for pair in many])
    assert sum(one.low <= middle <= one.high for one in found) >= 34  # of 40 at 95 %: fewer with a chance below 1 %
