"""What a campaign answered to an effect is replayed by what was asked, in whatever order."""

from __future__ import annotations

import pytest

from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.twin.answers import RecordedAnswers
from calibration.effects.api import EffectInputs
from tests.calibration.diagnosis.campaigns import simulated

QUESTIONS = (
    (0, 4e-3, 4e-2), (1, 4e-3, 4e-2), (0, 1e-5, 2e-3), (0, 4e-3, 4e-2, (0.0, 1.0)), (0, 4e-3, 4e-2, (-1.0, 1.0)),
)  # fmt: skip


@pytest.fixture(scope="module")
def inputs() -> EffectInputs:
    likelihood = MarginalLikelihood.of(linearise_recording(simulated("planar4", 40)))
    return inputs_of_recording(likelihood, periodograms(likelihood))


def ask(inputs: EffectInputs, order: int = 1) -> list[tuple[float, ...]]:
    periods = [tuple(value for value, _ in inputs.periods(*question)) for question in QUESTIONS[::order]]
    onsets = [tuple(value for value, _ in inputs.onsets(c)) for c in (("travel.left",), ["travel.right"])[::order]]
    return [*periods[::order], *onsets[::order]]


def test_answers_do_not_depend_on_the_order_of_questions(inputs):
    recorded = RecordedAnswers.record(inputs, ask)
    direct = ask(inputs)
    assert len(set(direct)) == len(direct)
    replay = recorded.replay(inputs)
    assert ask(replay) == ask(replay, -1) == direct


def test_a_question_may_be_repeated_and_left_out(inputs):
    recorded = RecordedAnswers.record(inputs, lambda used: [ask(used), ask(used)])
    assert recorded == RecordedAnswers.record(inputs, ask)
    replay = recorded.replay(inputs)
    assert ask(replay)[2] == ask(inputs)[2]
    assert replay.periods(1, 1e-5, 2e-3) == []
