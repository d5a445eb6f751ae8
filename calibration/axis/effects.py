"""Effects of one drive alone: what the gap between motor and second position is as a function of motion and load.

Gap: second position less the motor's, both on the load's side (docs/reference/axis-effects.md). Basis sets are those of
`calibration.effects.api`, with the gap as their only channel. Each column is a law, which holds for other recordings of
the same drive too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.axis.signals import WIDEST_REVERSAL, Signals
from calibration.axis.smooth_function import smooth_function
from calibration.base.arrays import Array
from calibration.effects.api import BasisSet, BasisSets, EffectParameter

GAP = "gap"
SHORTEST_DELAY_S, LONGEST_DELAY_S = 2e-5, 0.1
SMALLEST, LARGEST = {"rad": 1e-7, "m": 1e-8}, {"rad": 0.05, "m": 0.005}  # of an effect's part of the gap
NEAR = (0.93, 1.0, 1.07)  # half widths of a reversal over what least squares say
CROSSED = (0.92, 1.0, 1.08)  # half widths of a crossing over half the play: the load may drift across it
TURNS_ROUND = (1.0, 1.15)  # half widths of a reversal over the wind-up
SOFT = (0.05, 0.2)  # load over its RMS within which a flank is left
FLEXIBLE = 0.5  # standard deviation of a departure from the textbook's law, over the size
AVERAGED_S = (0.0, 0.1, 0.3)  # times over which a torque is averaged before it winds up the drive

Periods = Callable[[float, float], Sequence[tuple[float, float]]]
Law = Callable[[Signals], Array]  # columns (n,) or (n, k) for the signals of a recording


class LawSets(BasisSets):
    """Basis sets over columns that are laws; law of each column, and which of its columns it is."""

    def __init__(self, signals: Signals) -> None:
        super().__init__()
        self.signals = signals
        self.laws: list[tuple[Law, int]] = []

    def add_law(self, law: Law) -> list[int]:
        """Columns of a law. Returns their numbers."""
        numbers = self.add((GAP, law(self.signals)))
        self.laws += [(law, k) for k in range(len(numbers))]
        return numbers

    def add_one(
        self,
        main: Sequence[int],
        flexible: Sequence[int] = (),
        *,
        weight: float = 1.0,
        **parameters: float,
    ) -> None:
        """One basis set: unlike `add_set`, not the main columns alone beside it."""
        relative = (1.0,) * len(main) + (FLEXIBLE,) * len(flexible)
        self.sets.append(BasisSet((*main, *flexible), relative, parameters, weight))


@dataclass(frozen=True)
class AxisEffect:
    """An effect of one drive.

    size: its parameter with plausible range; one_sign: whether physics allows positive sizes only. others: further
    parameters; `asymmetry`, in a basis set that has it, is the second coefficient over the first. built: its basis
    sets; refined: those at a size, for laws that are not linear in it; consistent: only those count. rms: the size is
    the RMS of what it does to the gap. untested: why the recording cannot show it. friction: it shows
    in the torque too if it winds up the drive. several: whether it may be there more than once, with other parameters.
    """

    name: str
    size: EffectParameter
    built: Callable[[], LawSets]
    one_sign: bool = False
    others: tuple[EffectParameter, ...] = ()
    refined: Callable[[float], LawSets] | None = None
    consistent: bool = False
    rms: bool = False
    untested: str | None = None
    friction: bool = False
    several: bool = False


def axis_effects(signals: Signals, periods: Periods) -> tuple[AxisEffect, ...]:
    """The catalogue for the recording of one axis; periods: prominent spatial periods within limits, with priors."""
    return (
        _delay(signals),
        _viscous(signals),
        _coulomb(signals),
        _backlash(signals),
        _compliance(signals),
        _weight(signals),
        _inertia(signals),
        _ripple(signals, periods),
        _position_error(signals),
    )


def _range(signals: Signals, column: Array) -> tuple[float, float]:
    """Plausible sizes of a coefficient, from what its column (n,) does to the gap."""
    rms = max(float(np.std(column)), 1e-300)
    return SMALLEST[signals.unit] / rms, LARGEST[signals.unit] / rms


def _delay(signals: Signals) -> AxisEffect:
    """The second position is that of a time earlier; not quite alike in both directions."""

    def late(by_time: Law) -> LawSets:
        sets = LawSets(signals)
        main = sets.add_law(by_time)
        sets.add_one(main)
        sets.add_one(main, sets.add_law(_uneven))
        return sets

    def built() -> LawSets:
        return late(lambda s: -s.velocity)

    def refined(delay_s: float) -> LawSets:
        delay_s = math.copysign(max(abs(delay_s), SHORTEST_DELAY_S), delay_s)
        return late(lambda s: s.moved_late(delay_s) / delay_s)

    meaning = "time by which the second position is later than the motor's"
    size = EffectParameter("delay_s", SHORTEST_DELAY_S, LONGEST_DELAY_S, "s", meaning)
    return AxisEffect("delay", size, built, refined=refined)


def _viscous(signals: Signals) -> AxisEffect:
    """Friction that grows with speed winds up the drive; not alike in both directions, or not in proportion."""
    fastest = max(float(np.abs(signals.velocity).max()), 1e-300)

    def built() -> LawSets:
        sets = LawSets(signals)
        main = sets.add_law(lambda s: -s.velocity)
        sets.add_one(main)
        sets.add_one(main, sets.add_law(_uneven), asymmetry=0.0)
        sets.add_one(main, sets.add_law(lambda s: -s.velocity * np.abs(s.velocity) / fastest))
        return sets

    size = EffectParameter("windup_s", SHORTEST_DELAY_S, LONGEST_DELAY_S, "s", "wind-up per speed")
    return AxisEffect("viscous", size, built, one_sign=True, others=(_ASYMMETRY,), friction=True)


def _uneven(signals: Signals) -> Array:
    """What makes an effect that goes with the velocity differ between its two directions."""
    return -np.abs(signals.velocity)


def _coulomb(signals: Signals) -> AxisEffect:
    """Dry friction winds up the drive, to the side that it moves to; not alike in both directions."""

    def built() -> LawSets:
        sets = LawSets(signals)
        for half_width in _transitions(signals):

            def side(s: Signals, half_width: float = half_width) -> Array:
                return -s.side(half_width)

            def both(s: Signals, half_width: float = half_width) -> Array:
                return -np.abs(s.side(half_width))

            main = sets.add_law(side)
            sets.add_one(main, transition=half_width)
            sets.add_one(main, sets.add_law(both), transition=half_width, asymmetry=0.0)
        return sets

    def refined(windup: float) -> LawSets:
        """It turns round within what it winds up, or little more."""
        sets = LawSets(signals)
        for factor in TURNS_ROUND:
            half_width = factor * abs(windup)
            if signals.resolution <= half_width <= WIDEST_REVERSAL * signals.travel:

                def side(s: Signals, half_width: float = half_width) -> Array:
                    return -s.side(half_width)

                sets.add_one(sets.add_law(side), transition=half_width)
        return sets

    textbook = signals.side(signals.resolution)
    low, high = _range(signals, textbook)
    size = EffectParameter("windup", low, high, signals.unit, "wind-up in motion to either side")
    meaning = "half the motion within which friction turns round"
    transition = EffectParameter("transition", 0.0, high, signals.unit, meaning)
    return AxisEffect(
        "coulomb", size, built, one_sign=True, others=(transition, _ASYMMETRY), refined=refined, friction=True
    )


def _backlash(signals: Signals) -> AxisEffect:
    """A play, crossed when the motion reverses, or when what loads it does."""
    of_torque = signals.torque is not None and float(np.ptp(signals.torque)) > 0.0

    def load(s: Signals) -> Array:
        return torque_or_zero(s) if of_torque else s.acceleration

    rms = max(float(np.sqrt(np.mean(load(signals) ** 2))), 1e-300)

    def leaning(half_widths: Sequence[float]) -> LawSets:
        sets = LawSets(signals)
        for half_width in half_widths:

            def side(s: Signals, half_width: float = half_width) -> Array:
                return -s.side(half_width)

            sets.add_one(sets.add_law(side))
        if float(load(signals).min()) < 0.0 < float(load(signals).max()):
            for soft in SOFT:

                def flank(s: Signals, soft: float = soft) -> Array:
                    return -np.tanh(load(s) / (soft * rms))

                sets.add_one(sets.add_law(flank))
        return sets

    def refined(half_play: float) -> LawSets:
        widths = [factor * abs(half_play) for factor in CROSSED]
        return leaning([float(np.clip(w, signals.resolution, WIDEST_REVERSAL * signals.travel)) for w in widths])

    low, high = _range(signals, signals.side(signals.resolution))
    size = EffectParameter("half_play", low, high, signals.unit, "half of the play")
    return AxisEffect(
        "backlash", size, lambda: leaning(_transitions(signals)), one_sign=True, refined=refined, consistent=True
    )


def _compliance(signals: Signals) -> AxisEffect:
    """The torque winds up the drive; a motor's also accelerates the motor, and that part does not."""
    torque = torque_or_zero(signals)
    largest = max(float(np.max(np.abs(torque))), 1e-300)
    of_motor = float(np.std(torque)) / max(float(np.std(signals.acceleration)), 1e-300)

    def built() -> LawSets:
        sets = LawSets(signals)
        for width_s in AVERAGED_S:

            def transmitted(s: Signals, width_s: float = width_s) -> Array:
                return -s.averaged(torque_or_zero(s), width_s)

            def progressive(s: Signals, width_s: float = width_s) -> Array:
                x = s.averaged(torque_or_zero(s), width_s)
                return -x * np.abs(x) / largest

            main = sets.add_law(transmitted)
            sets.add_one(main)
            sets.add_one(main, sets.add_law(progressive))
            if signals.torque_of_motor:
                sets.add_one(main, sets.add_law(lambda s: s.acceleration * of_motor))
        return sets

    untested = None
    if signals.torque is None:
        untested = "no torque or force was recorded"
    elif float(np.ptp(torque)) <= 1e-9 * largest:
        untested = "the torque or force does not vary"
    low, high = _range(signals, torque)
    unit = f"{signals.unit}/{signals.load_unit}"
    size = EffectParameter("compliance", low, high, unit, "wind-up per torque or force")
    return AxisEffect("compliance", size, built, one_sign=True, untested=untested)


def _weight(signals: Signals) -> AxisEffect:
    """The load's weight, whose lever turns with the axis, winds up or bends what carries it."""

    def built() -> LawSets:
        sets = LawSets(signals)
        sets.add_one(sets.add_law(lambda s: np.column_stack([np.sin(s.position), np.cos(s.position)])))
        return sets

    untested = None if signals.rotary else "the lever of a linear axis' weight does not change"
    smallest, largest = SMALLEST[signals.unit], LARGEST[signals.unit]
    size = EffectParameter("windup", smallest, largest, signals.unit, "wind-up where the lever is longest")
    return AxisEffect("weight", size, built, untested=untested)


def _inertia(signals: Signals) -> AxisEffect:
    """The load's inertia winds up the drive when it accelerates."""

    def built() -> LawSets:
        sets = LawSets(signals)
        sets.add_one(sets.add_law(lambda s: -s.acceleration))
        return sets

    low, high = _range(signals, signals.acceleration)
    size = EffectParameter("windup_s2", low, high, "s2", "wind-up per acceleration")
    return AxisEffect("inertia", size, built, one_sign=True)


def _ripple(signals: Signals, periods: Periods) -> AxisEffect:
    """A wave over position: a tooth, a bearing, a turn of the motor, an eccentric scale, the interpolation of one."""
    shortest, longest = ripple_limits(signals)

    def built() -> LawSets:
        sets = LawSets(signals)
        for period, weight in periods(shortest, longest):

            def wave(s: Signals, period: float = period) -> Array:
                phase = 2.0 * np.pi * s.position / period
                return np.column_stack([np.cos(phase), np.sin(phase)])

            sets.add_one(sets.add_law(wave), weight=weight, period=period)
        return sets

    untested = None if shortest < longest else "the samples are too far apart, or the motion too short, for a wave"
    size = EffectParameter("amplitude", SMALLEST[signals.unit], LARGEST[signals.unit], signals.unit, "amplitude")
    period_of = EffectParameter("period", shortest, longest, signals.unit, "period over position")
    return AxisEffect("ripple", size, built, others=(period_of,), untested=untested, several=True)


def _position_error(signals: Signals) -> AxisEffect:
    """A smooth error over position: of a scale, of a gear, of an eccentric disc that turns less than once."""
    over_position = smooth_function(signals.position)

    def built() -> LawSets:
        sets = LawSets(signals)
        sets.add_one(sets.add_law(lambda s: over_position(s.position)))
        return sets

    smallest, largest = SMALLEST[signals.unit], LARGEST[signals.unit]
    size = EffectParameter("error", smallest, largest, signals.unit, "RMS over the recording")
    return AxisEffect("position_error", size, built, rms=True)


def ripple_limits(signals: Signals) -> tuple[float, float]:
    """Periods between three samples in motion and half the travel."""
    return 3.0 * signals.spacing, 0.5 * signals.travel


def torque_or_zero(signals: Signals) -> Array:
    """The recorded torque (n,), zero where none was."""
    return np.zeros(len(signals)) if signals.torque is None else signals.torque


def _transitions(signals: Signals) -> list[float]:
    """Half widths of reversals to be tried."""
    return [signals.resolution, *(factor * signals.reversal for factor in NEAR)]


_ASYMMETRY = EffectParameter("asymmetry", -1.0, 1.0, "1", "half difference of the two directions over their mean")
