"""Every final form in a campaign: it is seen at a size that its range allows, and a seed makes it the same again."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from mock_devices.effects import CATALOGUE, OUTSIDE_FINAL, SPECS, draw
from mock_devices.recordings.effect_size import SizeScale
from mock_devices.recordings.visible_size import VisibleScale
from tests.mock_devices.effects_bench import FILE, bench

PROGRAMME = ((0.0, 0.0), (3600.0, 0.0), (5400.0, 2.0), (7200.0, -1.0))
WANTED, OF_ROUND_OFF = 5.0, 1.0e-12


@lru_cache
def visible(fly_share):
    sizes = SizeScale(bench(visits=160, fly_share=fly_share, temperature_programme=PROGRAMME))
    return VisibleScale(sizes.bench, sizes)


@pytest.mark.parametrize("name", [*CATALOGUE, *OUTSIDE_FINAL])
def test_a_final_form_is_seen_in_a_campaign(name):
    scale = visible(0.3 if name == "latency" else 0.0)
    choice = draw(name, FILE, np.random.default_rng(8), final=True, duration_s=4000.0)
    assert choice.variant == SPECS[name].final
    choice = scale.sizes.scaled(choice, WANTED)
    assert SPECS[name].size.low <= choice.size <= SPECS[name].size.high
    seen = scale.visible_size(choice)
    assert 0.05 * WANTED < seen <= 1.001 * WANTED
    change = scale.sizes.change_m(choice)
    assert np.array_equal(change, scale.sizes.change_m(choice))
    other = scale.sizes.change_m(replace(choice, seed=choice.seed + 1))
    assert np.abs(change - other).max() > OF_ROUND_OFF
