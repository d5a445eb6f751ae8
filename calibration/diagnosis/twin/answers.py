"""What a campaign answered to the questions of an effect: prominent periods and onsets, recorded and replayed.

Basis sets of a twin are built anew for every reading that is simulated, but periods and onsets are properties of the
campaign. They are recorded under what was asked, so a replay does not depend on the order of the questions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from calibration.effects.api import EffectInputs
from calibration.effects.columns import Contributions

PeriodQuestion = tuple[int, float, float, tuple[float, ...]]  # drive, shortest and longest period in m, over what
OnsetQuestion = tuple[str, ...]  # channels
Values = tuple[float, ...]
Use = Callable[[EffectInputs], object]


@dataclass(frozen=True)
class RecordedAnswers:
    """Periods in m and onsets in s, by question; those of strengths by the name of the column."""

    periods_m: Mapping[PeriodQuestion, Values] = field(default_factory=dict)
    onsets_s: Mapping[OnsetQuestion, Values] = field(default_factory=dict)
    strength_onsets_s: Mapping[str, Values] = field(default_factory=dict)

    @classmethod
    def record(cls, inputs: EffectInputs, use: Use) -> RecordedAnswers:
        """Everything that is asked of some inputs while they are used."""
        periods_m: dict[PeriodQuestion, Values] = {}
        onsets_s: dict[OnsetQuestion, Values] = {}
        strength_onsets_s: dict[str, Values] = {}

        def periods(
            drive: int, shortest_m: float, longest_m: float, over: tuple[float, ...] = ()
        ) -> Sequence[tuple[float, float]]:
            answer = inputs.periods(drive, shortest_m, longest_m, over)
            periods_m[drive, shortest_m, longest_m, over] = tuple(float(period_m) for period_m, _ in answer)
            return answer

        def onsets(channels: Sequence[str]) -> Sequence[tuple[float, float]]:
            answer = inputs.onsets(channels)
            onsets_s[tuple(channels)] = tuple(float(onset_s) for onset_s, _ in answer)
            return answer

        def strength_onsets(name: str, column: Contributions) -> Sequence[tuple[float, float]]:
            answer = inputs.strength_onsets(name, column)
            strength_onsets_s[name] = tuple(float(onset_s) for onset_s, _ in answer)
            return answer

        use(replace(inputs, periods=periods, onsets=onsets, strength_onsets=strength_onsets))
        return cls(periods_m, onsets_s, strength_onsets_s)

    def replay(self, inputs: EffectInputs) -> EffectInputs:
        """The same inputs with the recorded answers; a question that was never asked has none."""

        def periods(
            drive: int, shortest_m: float, longest_m: float, over: tuple[float, ...] = ()
        ) -> Sequence[tuple[float, float]]:
            return [(period_m, 1.0) for period_m in self.periods_m.get((drive, shortest_m, longest_m, over), ())]

        def onsets(channels: Sequence[str]) -> Sequence[tuple[float, float]]:
            return [(onset_s, 1.0) for onset_s in self.onsets_s.get(tuple(channels), ())]

        def strength_onsets(name: str, _: Contributions) -> Sequence[tuple[float, float]]:
            return [(onset_s, 1.0) for onset_s in self.strength_onsets_s.get(name, ())]

        return replace(inputs, periods=periods, onsets=onsets, strength_onsets=strength_onsets)
