from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.base.errors import InputError
from calibration.machine.description import load_machine, shipped_machine
from pkm_rig.rig.campaign_sections import CampaignSettings
from pkm_rig.rig.schedule import calibration_blocks, calibration_targets, verification_block


@pytest.fixture(scope="module")
def machine():
    return load_machine(shipped_machine("planar4"))


def test_three_blocks_both_sides_two_speeds_two_dwells_repeated_visits(machine):
    blocks = calibration_blocks(machine, CampaignSettings())
    assert [b.payload for b in blocks] == [0, 2, 0]
    visits = [v for b in blocks for v in b.visits]
    assert {v.direction for v in visits} == {(-1, -1), (1, 1)}
    assert len({v.speed_m_per_s for v in visits}) == 2
    assert len({v.dwell_s for v in visits}) == 2
    repeats = Counter((v.pose, v.payload, v.direction) for v in visits)
    assert sorted(set(repeats.values())) == [1, 3]
    assert sum(n == 3 for n in repeats.values()) == 40
    by_block = [{v.pose for v in b.visits} for b in blocks]
    assert by_block[0] == by_block[1] == by_block[2]


def test_order_is_random_but_repeatable(machine):
    one, again = (calibration_blocks(machine, CampaignSettings(seed=3)) for _ in range(2))
    assert [v.pose for v in one[0].visits] == [v.pose for v in again[0].visits]
    assert [v.pose for v in one[0].visits] != sorted(v.pose for v in one[0].visits)
    other = calibration_blocks(machine, CampaignSettings(seed=4))
    assert [v.pose for v in one[0].visits] != [v.pose for v in other[0].visits]


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), poses=st.integers(6, 64))
def test_every_target_lies_in_the_workspace_and_within_the_travel(seed, poses):
    machine = load_machine(shipped_machine("planar4"))
    chosen = CampaignSettings(seed=seed, calibration_poses=poses)
    blocks = (*calibration_blocks(machine, chosen), verification_block(machine, chosen, 1))
    low, high = machine.commanded_limits.T
    for block in blocks:
        for visit in block.visits:
            assert (visit.target_m[:2] >= low - 1e-12).all()
            assert (visit.target_m[:2] <= high + 1e-12).all()
            assert (visit.drives_m > machine.travel[:, 0] + chosen.approach_m).all()
            assert (visit.drives_m < machine.travel[:, 1] - chosen.approach_m).all()


def test_verification_poses_are_others_than_the_calibrations_and_reach_the_edge(machine):
    chosen = CampaignSettings()
    calibrated = {tuple(v.target_m) for b in calibration_blocks(machine, chosen) for v in b.visits}
    block = verification_block(machine, chosen, 0)
    assert len(block.visits) >= 30
    assert not calibrated & {tuple(v.target_m) for v in block.visits}
    low, high = machine.commanded_limits.T
    on_edge = [np.isclose(v.target_m[:2], low).any() or np.isclose(v.target_m[:2], high).any() for v in block.visits]
    assert sum(on_edge) >= 7
    again = verification_block(machine, chosen, 1)
    assert {tuple(v.target_m) for v in again.visits} == {tuple(v.target_m) for v in block.visits}


def test_chosen_targets_replace_the_drawn_ones(machine):
    rows = ((-0.35, -0.3), (0.35, 0.3), (0.0, 0.0), (0.35, -0.3), (-0.35, 0.3), (0.1, 0.1))
    chosen = CampaignSettings(targets=rows)
    targets = calibration_targets(machine, chosen)
    np.testing.assert_allclose(targets[:, :2], rows)
    blocks = calibration_blocks(machine, chosen)
    assert {v.pose for b in blocks for v in b.visits} == set(range(6))


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        (((0.0, 0.0),) * 3, "give 6 or more"),
        (((0.0, 0.0, 0.0),) * 6, "row 1 has 3 numbers"),
        (((0.0, 0.0),) * 5 + ((0.0, 0.9),), "row 6 lies outside the workspace"),
        (((0.0, 0.0),) * 5 + ((0.0, float("nan")),), "row 6 lies outside the workspace"),
    ],
)
def test_unfit_targets_are_named(machine, rows, complaint):
    with pytest.raises(InputError, match=complaint):
        calibration_targets(machine, CampaignSettings().model_copy(update={"targets": rows}))
