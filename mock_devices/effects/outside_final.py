"""Effects outside the catalogue that only a final scoring uses, each from a published description.

Their plain variant, which is what the description says, is the one of final scorings.
"""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, EffectParameter, Leg, MotionState, StationSight
from mock_devices.effects.followers import Dragged
from mock_devices.effects.outside_counts import LastLongWay
from mock_devices.effects.outside_shapes import OutsideEffect, outside_effect

PLAY_M = (0.01, 0.06)  # way of a drive that takes up half of a tangent screw's play
ROPE_AT, PULLS, TIED = -0.1 - 0.2j, (0.3, 1.0), 64  # of a rope: point of the platform; its pulls over the size; knots
SEALED_HPA, SHORTENS_HPA = (-0.05, 0.05), 0.1  # of a tube: pressure in it beyond that of the begin; change for the size
FELT_M, WAY_M = (0.03, 0.12), 0.3  # of a disc and a wheel: shortest way that moves them; way of both for the size


class PlayOfTangentScrew(OutsideEffect):
    """A tangent screw with play turns the station's horizontal circle after the platform, which so lags behind.

    J. Ramsden, "Description of an Engine for Dividing Mathematical Instruments" (1777). All horizontal angles are off
    to the side from which the platform has come, by half the size for each of the first two drives, and a short way
    back changes that by a part only. Where the line of sight goes from one reflector to the next takes up nothing.
    """

    def setup(self) -> None:
        """Play of the screw, by the ways of the first two drives."""
        super().setup()
        self.play_m = float(self.rng.uniform(*PLAY_M))
        self._lags = [Dragged(self.play_m, self.site.drive_range_m(drive)[0]) for drive in range(2)]

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Take up the play."""
        if drive < len(self._lags):
            self._lags[drive].record(leg)

    def _unit(self, state: MotionState) -> Array:
        left, right = ((state.q_m[:, drive] - lag.at(state, drive)) for drive, lag in enumerate(self._lags))
        return np.asarray(0.5 * (left - right) / self.play_m)

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Read the horizontal circle wrongly."""
        sight.hz_rad += self.signal(state)[:, None]


class RetiedRope(OutsideEffect):
    """A rope that holds the payload on the platform is tied anew at every exchange, and pulls that to another side.

    Forces of ropes: S. Stevin, "De Beghinselen der Weeghconst" (1586). Each knot pulls as hard until the next one.
    """

    def setup(self) -> None:
        """How hard each knot pulls, and to which side."""
        super().setup()
        self.pulls = self.rng.uniform(*PULLS, TIED) * self.rng.choice([-1.0, 1.0], TIED)

    def _unit(self, state: MotionState) -> Array:
        return np.asarray(self.pulls[state.exchanges.astype(int) % TIED])

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Pull sideways at the platform's lower edge."""
        deviation.loads.append((np.full(len(state), ROPE_AT), self.signal(state).astype(np.complex128)))


class SealedTube(OutsideEffect):
    """A strut is a sealed tube with a thin wall, which the pressure of the atmosphere shortens.

    E. Bourdon, "Description du manomètre métallique" (1851). What is shut in keeps a pressure near that of the
    campaign's begin, and the strut is longer or shorter by the difference.
    """

    def setup(self) -> None:
        """What is shut in."""
        super().setup()
        self.sealed_hpa = float(self.rng.uniform(*SEALED_HPA))

    def _unit(self, state: MotionState) -> Array:
        begin_s = np.full(len(state), self.site.start_s)
        change_hpa = state.thermal.pressure_series_hpa(state.t_s) - state.thermal.pressure_series_hpa(begin_s)
        return np.asarray((self.sealed_hpa - change_hpa) / SHORTENS_HPA)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Shorten the strut."""
        deviation.length_m[:, self.place] += self.signal(state)


class ProductOfWays(OutsideEffect):
    """A disc that one drive turns drives a wheel, which the next one has set off its middle: their ways are multiplied.

    V. Bush, "The Differential Analyzer" (1931): the wheel turns by the disc's turn times its distance from the middle.
    Springs take up short ways. Both begin anew with every long one, and the slider stands by the product of the last
    long ways of both.
    """

    def setup(self) -> None:
        """Which ways the springs take up."""
        super().setup()
        self.felt_m = float(self.rng.uniform(*FELT_M))
        self.next = (self.place + 1) % len(self.site.machine.sliders)
        self._felt = {drive: LastLongWay(self.felt_m) for drive in (self.place, self.next)}

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Remember a long way."""
        if drive in self._felt:
            self._felt[drive].record(leg)

    def _unit(self, state: MotionState) -> Array:
        own_m, others_m = (self._felt[drive].at(state, drive) for drive in (self.place, self.next))
        return np.asarray(own_m * others_m / WAY_M**2)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider."""
        deviation.travel_m[:, self.place] += self.signal(state)


EFFECTS = (
    outside_effect(
        "play_of_tangent_screw",
        "rig",
        PlayOfTangentScrew,
        EffectParameter("error_rad", 1e-6, 2e-5, 1e-3, "of horizontal angles, to either side"),
        "horizontal angles by the side from which the platform has come; all SMRs and nests alike",
        final_only=True,
    ),
    outside_effect(
        "retied_rope",
        "rig",
        RetiedRope,
        EffectParameter("force_n", 5.0, 400.0, 3e4, "of the hardest pull, to either side"),
        "exchanges of payload, each time another one, not the place; rotation",
        final_only=True,
    ),
    outside_effect(
        "sealed_tube",
        "strut",
        SealedTube,
        EffectParameter("shortens_m", 1e-6, 3e-5, 1e-3, "by 0.1 hPa more outside than within"),
        "pressure of the air; not a slider's SMR",
        final_only=True,
    ),
    outside_effect(
        "product_of_ways",
        "drive",
        ProductOfWays,
        EffectParameter("stands_m", 1e-6, 3e-5, 1e-3, "after ways of 0.3 m of both drives in the same direction"),
        "the last long ways of both drives, by their product; SMRs on the sliders",
        final_only=True,
    ),
)
