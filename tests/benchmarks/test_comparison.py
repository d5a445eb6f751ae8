"""The study of comparisons: its pairs, their visible sizes, and its table."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from benchmarks.comparison.cases import NOTHING, STRUCTURE, make_pair
from benchmarks.comparison.change import Change, both
from benchmarks.comparison.planar import Circumstances, PlanarCampaign, nominal
from benchmarks.comparison.spatial import Circumstances as SpatialCircumstances
from benchmarks.comparison.spatial import SpatialCampaign
from benchmarks.comparison.table import is_named, is_right, measures
from benchmarks.comparison.visible import VisibleScale, derivatives, even, straight
from mock_devices.settings import DisturbanceLevels

QUIET = DisturbanceLevels()


def test_a_pair_is_the_same_each_time_and_says_nothing_of_its_truth():
    pair, again = make_pair(5, 2), make_pair(5, 2)
    assert pair.truth == again.truth
    assert pair.truth["kind"] in STRUCTURE
    assert pair.truth["visible"] >= 1.0
    for one, other in ((pair.before, again.before), (pair.after, again.after)):
        assert np.array_equal(one.positions_m, other.positions_m)
    assert (pair.before.file.campaign, pair.after.file.campaign) == ("first", "second")
    assert pair.truth["kind"] not in str(pair.after.file.model_dump())
    heads = [pair.before.file.model_dump(), pair.after.file.model_dump()]
    for head in heads:
        for key in ("campaign", "station", "nuisance", "payloads"):
            head.pop(key)
    assert heads[0] == heads[1]


def test_two_of_five_pairs_are_nothing():
    kinds = [make_pair(6, k).truth["kind"] for k in range(2)]
    assert kinds == [NOTHING, NOTHING]


def test_both_plants_move_their_tool_by_a_longer_strut_and_not_their_floor():
    change = Change(length_m={0: 1e-4})
    planar = PlanarCampaign(1, Circumstances(1, 1, 0), QUIET, Change())
    spatial = SpatialCampaign("delta6", 1, SpatialCircumstances(1, 1, 0), QUIET, Change())
    for campaign, smr in ((planar, planar.timeline.smr), (spatial, spatial.design.smr)):
        shift = np.linalg.norm(campaign.shifted_m(change), axis=1)
        floor = np.array([one.on == "floor" for one in nominal()[1].smrs] if campaign is planar else [
            one.on == "floor" for one in campaign.machine.smrs
        ])[smr]  # fmt: skip
        assert np.all(shift[floor] < 1e-12)
        assert 2e-5 < np.sqrt(np.mean(shift[campaign.platform] ** 2)) < 5e-4


def test_what_both_campaigns_leave_open_is_not_visible():
    campaigns = tuple(PlanarCampaign(1, Circumstances(1, k, k), QUIET, Change()) for k in range(2))
    machine = nominal()[1]
    errors = tuple(
        derivatives(("planar4", k), machine, PlanarCampaign(1, Circumstances(1, 1, k), QUIET, Change()))
        for k in range(2)
    )
    stands = tuple(-c.view.rotation.T @ c.view.translation_m for c in campaigns)
    scale = VisibleScale(campaigns, errors, stands, (1e-4, 1e-6))
    shifted = campaigns[1].places_m[:, :1] * 0.0 + np.array([1e-4, 2e-4, 0.0])
    moved_station = type("", (), {"weight": campaigns[1].weight, "shifted_m": lambda self, change: shifted})()
    scale.after = moved_station
    assert np.max(np.abs(scale.left(Change()))) < 0.05
    scale.after = campaigns[1]
    left = scale.left(Change(travel={0: even(1e-4)}))
    assert np.sqrt(np.mean(left**2)) > 0.5
    assert scale.left(Change(travel={0: even(2e-4)})) == pytest.approx(2.0 * left, rel=0.02, abs=0.02)


def test_changes_add_up():
    one, other = Change(travel={0: even(1e-5)}, smr_m={1: (1e-6, 0.0, 0.0)}), Change(travel={0: straight(2e-5)})
    together = both(both(one, other), Change(smr_m={1: (1e-6, 3e-6, 0.0)})).times(2.0)
    assert together.travel[0](np.array([0.5])) == pytest.approx(4e-5)
    assert together.smr_m[1] == pytest.approx((4e-6, 6e-6, 0.0))


def row(**other):
    plain = {
        "number": 0, "family": "planar4", "kind": "drive_offset", "structure": "drive_offset", "place": "left",
        "visible": 1.5, "value": 1e-5, "station": "as before", "tables": False, "verdict": "drive_offset",
        "place_named": "left", "equivalent": [], "ranking": {"drive_offset": 0.95}, "seconds": 1.0, "error": "",
        "changes": [{"structure": "drive_offset", "place": "left", "quantities": {"offset": [1.2e-5, 1.5e-6]}}],
    }  # fmt: skip
    return plain | other


def test_rows_are_scored_by_structure_and_place():
    assert is_named(row())
    wrong_place = row(place_named="right")
    assert not is_right(wrong_place)
    assert is_right(wrong_place | {"equivalent": [["drive_offset", "left"]]})
    nothing = row(kind=NOTHING, structure=NOTHING, place="", visible=0.0, verdict=NOTHING, place_named="", changes=[])
    assert is_right(nothing)
    assert not is_right(nothing | {"verdict": "unknown"})
    failed = row(verdict="", place_named="", ranking={}, changes=[], error="InputError: no")
    assert not is_right(failed)
    by_name = {m.name: m for m in measures([row(), wrong_place, nothing, nothing | {"verdict": "strut"}, failed])}
    assert by_name["changed: named, or equivalent to what is named"].value == pytest.approx(1 / 3)
    assert by_name["nothing called a change"].value == 0.5
    assert by_name["nothing called a change"].ok is False
    assert by_name["comparisons that failed"].ok is False
    assert by_name["U (k = 2) covers offset, scale or length"].value == 1.0
    assert all(asdict(m)["n"] >= 0 for m in by_name.values())
