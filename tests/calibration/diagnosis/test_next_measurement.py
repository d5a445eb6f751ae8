"""What is proposed to be measured next: possible visits, ranked, and such as can tell what the campaign could not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis.basis_set_evidence import BasisSetEvidence
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.findings.next_measurement import _ChannelResponse, _Hypotheses
from calibration.diagnosis.findings.proposals import duration_min, proposals
from calibration.diagnosis.ranking import Cause
from calibration.diagnosis.result import NONE, UNKNOWN
from calibration.effects.api import BasisSet, Departure
from calibration.effects.catalogue import load_catalogue
from calibration.effects.combined_context import append_context
from calibration.machine.description import load_machine
from mock_devices.effects import EffectChoice
from mock_devices.recordings.design import DesignOptions
from tests.calibration.diagnosis.campaigns import PLANAR, plant, recorded


@pytest.fixture(scope="module")
def one_sided():
    """Every pose from below: backlash is there and cannot be seen."""
    return diagnose(recorded(plant(60, EffectChoice("backlash", 6e-5), design=DesignOptions(both_directions=False))))


def test_candidates_are_ranked_by_information_a_minute(one_sided):
    additions = [c for c in one_sided.next_measurement if c.visits]
    rates = [c.gain_bit_per_min for c in additions]
    assert rates == sorted(rates, reverse=True)
    assert len({c.name for c in additions}) == len(additions) > 1


def test_candidates_can_be_carried_out(one_sided):
    machine = load_machine(PLANAR)
    low, high = machine.workspace.T
    for candidate in one_sided.next_measurement:
        assert candidate.minutes > 0.0
        assert candidate.gain_bit >= 0.0
        assert candidate.adds
        for visit in candidate.visits:
            assert np.all((low <= visit.target_m) & (visit.target_m <= high))
            assert set(visit.direction) <= {-1, 1}
            assert len(visit.direction) == len(machine.drive_names)
            assert visit.payload in range(3)
            assert visit.speed_m_per_s > 0.0
            assert visit.dwell_s >= 0.0


def test_no_more_is_promised_than_there_is_to_know(one_sided):
    """A cause among k names cannot take more than log2 k bits."""
    names = {*one_sided.ranking, *one_sided.not_tested}
    assert all(c.gain_bit <= np.log2(len(names)) for c in one_sided.next_measurement)


def test_what_is_to_be_settled_is_a_name(one_sided):
    known = {*one_sided.ranking, *one_sided.not_tested, NONE, UNKNOWN}
    for candidate in one_sided.next_measurement:
        assert set(candidate.settles) <= known


def test_backlash_that_was_not_tested_asks_for_both_directions(one_sided):
    assert "backlash" in one_sided.not_tested
    assert one_sided.verdict != "backlash"
    two_sided = {c.name: len({v.direction for v in c.visits}) > 1 for c in one_sided.next_measurement if c.visits}
    assert any(two_sided.values())
    for candidate in one_sided.next_measurement:
        if candidate.visits and "backlash" in candidate.settles:
            assert two_sided[candidate.name], candidate.name
    first = next(c for c in one_sided.next_measurement if c.visits)
    assert two_sided[first.name]
    assert "backlash" in first.settles


def test_further_visits_rest_and_last_as_long_as_those_of_the_campaign(small):
    """The rest before a visit's first reading counts, at all visits; later readings rest longer."""
    first = np.unique(small.visit[small.visit >= 0], return_index=True)[1]
    dwell_s = 100.0 + 0.1 * small.visit
    dwell_s[np.flatnonzero(small.visit >= 0)[first]] -= 100.0
    linear = replace(small, context=replace(small.context, dwell_s=dwell_s))
    count = len(first)
    same = next(proposals(linear))
    assert [visit.dwell_s for visit in same.visits] == pytest.approx([0.05 * (count - 1)] * 60)
    pace_s = np.median(np.diff(small.context.history.arrived_s))
    exchange = small.recording["payload"][small.rows][-1] != same.visits[0].payload
    expected_s = 1800.0 + len(same.visits) * pace_s + 300.0 * exchange
    assert duration_min(linear, same) == pytest.approx(expected_s / 60.0)


@pytest.mark.parametrize(
    ("speed_m_per_s", "dwell_s", "speeds", "said"),
    [
        (0.5, 4.0, {0.2, 0.5, 1.0}, "three speeds"),
        (1.1, 4.0, {0.44, 1.1, 2.0}, "three speeds"),
        (1.1, 1000.0, {0.44, 1.1, 2.0}, "three speeds"),
        (5.0, 4.0, {0.8, 2.0}, "two speeds, 2 m/s where it was faster"),
    ],
)
def test_visits_are_such_as_a_campaign_file_may_ask_for(small, speed_m_per_s, dwell_s, speeds, said):
    """A rig that was faster, or rested longer, comes as near to that as it may."""
    count = len(small.context.dwell_s)
    context = replace(small.context, dwell_s=np.full(count, dwell_s), speed_m_per_s=np.full(count, speed_m_per_s))
    proposed = list(proposals(replace(small, context=context)))
    visits = [visit for proposal in proposed for visit in proposal.visits]
    assert {round(visit.speed_m_per_s, 9) for visit in visits} == speeds
    assert {visit.dwell_s for visit in proposed[0].visits} == {min(dwell_s, 600.0)}
    assert max(visit.dwell_s for visit in visits) <= 600.0
    varied = next(proposal for proposal in proposed if proposal.name == "varied rest")
    assert varied.adds.endswith(said)
    assert ("600 s of rest where it was longer" in proposed[0].adds) is (dwell_s > 600.0)


def test_basis_sets_are_built_over_the_visits_of_the_campaign_and_the_planned_ones(small):
    hypotheses = _Hypotheses(small, SimpleNamespace(ranking=()), {NONE: 1.0}, ())
    planned, pose = hypotheses._planned_context(next(proposals(small)))
    observed = hypotheses._observed_model(planned, pose, np.array([0]))
    together = hypotheses._with_campaign(append_context(small.context, planned), observed)
    assert planned.dwell_s == pytest.approx(1.0 + np.array([visit.dwell_s for visit in next(proposals(small)).visits]))
    poses = together.poses.equilibrium.coordinates()[together.visit]
    on_pose = np.flatnonzero(small.visit >= 0)
    assert poses[on_pose] == pytest.approx(small.poses.equilibrium.coordinates()[small.visit[on_pose]], abs=1e-8)
    assert poses[len(small.visit) :] == pytest.approx(observed.poses.equilibrium.coordinates(), abs=1e-8)


def test_only_what_differs_from_the_nearest_measured_visit_tells_anything(small):
    """A shift of 10 um that is the same at all visits predicts nothing new; alone it is 10 um over the noise."""
    hypotheses = _Hypotheses(small, SimpleNamespace(ranking=()), {NONE: 1.0}, ())
    observed = hypotheses._observed_model(*hypotheses._planned_context(next(proposals(small))), np.array([0]))
    rows = len(small.visit) + np.arange(len(observed.smr))
    response = _ChannelResponse(small, observed, rows, np.zeros(len(rows), dtype=np.intp))
    everywhere = (("smr.P1.x", np.full(len(small.visit) + len(rows), 1e-5)),)
    assert np.all(response(everywhere) == 0.0)
    sigma_m = np.median(np.linalg.det(small.recording.covariances_m2[small.rows]) ** (1.0 / 6.0))
    size = np.linalg.norm(response(everywhere, absolute=True).reshape(-1, 3), axis=1)
    assert size == pytest.approx(1e-5 / sigma_m, rel=0.2)


def test_each_proposal_varies_what_it_says(small):
    """Approach side, rest, speed and payload; all visit the same poses."""
    varied = {}
    for proposal in proposals(small):
        visits = proposal.visits
        varied[proposal.name] = tuple(
            len({getattr(visit, name) for visit in visits}) > 1
            for name in ("direction", "dwell_s", "speed_m_per_s", "payload")
        )
        heaviest = int(np.argmax([payload.mass_kg for payload in small.recording.file.payloads]))
        assert sum(visit.payload == heaviest for visit in visits) in (0, len(visits) // 2)
    assert varied == {
        "random poses": (False, False, False, False),
        "both directions": (True, False, False, False),
        "varied rest": (False, True, True, False),
        "directions and rest": (True, True, True, False),
        "another payload": (False, False, False, True),
        "everything varied": (True, True, True, True),
    }
    assert len({tuple(visit.target_m for visit in proposal.visits) for proposal in proposals(small)}) == 1


@pytest.mark.parametrize(("coordinate", "told"), [("payload", True), ("way.left", False), ("temperature", False)])
def test_what_goes_with_a_way_or_a_temperature_yet_to_come_is_not_predicted(small, coordinate, told):
    """Their ranges are those of the campaign's own readings; that of the payload is known."""
    effect = replace(load_catalogue().effect("backlash"), varies_with=("payload", "way", "temperature"))
    basis_set = BasisSet((0,), (1.0, 1.0), departures=(Departure(0, coordinate, 0),))
    best = BasisSetEvidence(basis_set, 50.0, 1e-5, np.array([5e-5, 3e-5]), np.eye(2))
    cause = Cause(effect, 50.0, {"left": 1.0}, "left", best, ())
    hypotheses = _Hypotheses(small, SimpleNamespace(ranking=(cause,)), {NONE: 0.5, "backlash": 0.5}, ())
    both_sides = next(proposal for proposal in proposals(small) if proposal.name == "both directions")
    assert np.any(hypotheses.predict(both_sides)[1] != 0.0) is np.bool_(told)


def test_an_untested_effect_that_no_planned_reading_shows_predicts_nothing(small):
    """Latency where planned visits rest: what the drives' noise said of the campaign's velocities is no scale of it."""
    noise = 3e-6 * np.random.default_rng(8).standard_normal(small.context.velocity_m_per_s.shape)
    noisy = replace(small, context=replace(small.context, velocity_m_per_s=noise))
    latency = load_catalogue().effect("latency")
    hypotheses = _Hypotheses(noisy, SimpleNamespace(ranking=()), {NONE: 1.0}, (latency,))
    predictions = hypotheses.predict(next(proposals(noisy)))
    assert predictions.shape[0] == 2
    assert np.all(predictions == 0.0)
