"""Effects outside the catalogue in the faces of a station, a bellows, a cam and a gear, each from a publication."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import (
    Array,
    Deviation,
    Effect,
    EffectArguments,
    EffectParameter,
    Leg,
    MotionState,
    StationSight,
)
from mock_devices.effects.outside_shapes import OutsideEffect, apply_variant, outside_effect

AXIS = (1.0, 3.0)  # of a station that is turned over: tilt of its axis over that of its beam, to either side
BELLOWS_AT, SLACK_HPA, PULL_HPA = 0.1 - 0.2j, (-0.05, 0.05), 0.1  # of a bellows: point of the platform; change of
# pressure at which it is slack; how much beyond that for the size
CAM_M = (0.12, 0.3)  # travel of the next drive in one turn of a cam
TEETH, WAY_M, TOGETHER_S = (3, 12), 0.5, 1.0e-3  # of an electronic gear: denominator of its ratios; way of the next
# drive for the size; motions that begin within it are geared


class TwoFaces(OutsideEffect):
    """The station is turned over to its other face at every exchange of the payload, and its errors change their sign.

    Beam and transit axis are askew, and the horizontal angle is off by one over the sine of the zenith angle and by its
    cotangent, to opposite sides in both faces, so that their mean is right: J. G. F. Bohnenberger, "Anleitung zur
    geographischen Ortsbestimmung" (1795). The size is the tilt of the beam.
    """

    def setup(self) -> None:
        """Tilt of the axis over that of the beam."""
        super().setup()
        self.axis = float(self.rng.uniform(*AXIS)) * float(self.rng.choice([-1.0, 1.0]))

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Read the horizontal circle wrongly."""
        face = 1.0 - 2.0 * (state.exchanges.astype(int) % 2)
        y = face[:, None] * (1.0 + self.axis * np.cos(sight.v_rad)) / np.sin(sight.v_rad)
        sight.hz_rad += self.size * apply_variant(y, self.variant, state.payload_kg[:, None])


class AneroidBellows(OutsideEffect):
    """A closed bellows between platform and frame, left from some vacuum line, pulls by the pressure of the atmosphere.

    L. Vidie, "Baromètre anéroïde" (1844). What is shut in keeps the pressure of one moment, near that of the campaign's
    begin, and the bellows pulls the platform aside by how far the air's pressure is from there.
    """

    def setup(self) -> None:
        """To which side it pulls, and the change of pressure at which it is slack."""
        super().setup()
        self.side = float(self.rng.choice([-1.0, 1.0]))
        self.slack_hpa = float(self.rng.uniform(*SLACK_HPA))

    def _unit(self, state: MotionState) -> Array:
        begin_s = np.full(len(state), self.site.start_s)
        change_hpa = state.thermal.pressure_series_hpa(state.t_s) - state.thermal.pressure_series_hpa(begin_s)
        return np.asarray(self.side * (change_hpa - self.slack_hpa) / PULL_HPA)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Pull sideways at the platform's lower edge."""
        deviation.loads.append((np.full(len(state), BELLOWS_AT), self.signal(state).astype(np.complex128)))


class NeighboursCam(OutsideEffect):
    """The next drive turns a cam, on which an end of the strut lies, and lifts and lowers it.

    Wheels whose radius goes by the angle: C. Camus, "Cours de mathématique" (1749). This one is a circle off its axis,
    so that the strut is longer and shorter in waves of where the next drive stands.
    """

    def setup(self) -> None:
        """Travel in a turn of the cam."""
        super().setup()
        self.cam_m = float(self.rng.uniform(*CAM_M))
        self.next = (self.site.machine.struts[self.place].drive + 1) % len(self.site.machine.sliders)

    def _unit(self, state: MotionState) -> Array:
        return np.sin(2.0 * np.pi * state.q_m[:, self.next] / self.cam_m + self.phase)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lengthen and shorten the strut."""
        deviation.length_m[:, self.place] += self.signal(state)


class RoundedRatio(Effect):
    """An electronic gear lets a drive follow the next one by a ratio of whole numbers, the nearest to their ways' own.

    A. Brocot, "Calcul des rouages par approximation" (1861): some ratios can be had and all others by what is near
    them. In motions of both drives together the slider goes by the ratio that its gear has, with the same denominator
    always, and stands beside its target by the rest, which goes on adding up; a motion alone is not geared. The size is
    the most that one motion leaves when the next drive's way is WAY_M.
    """

    def __init__(self, arguments: EffectArguments) -> None:
        self._begun: list[list[tuple[float, float]]] = [[] for _ in arguments.site.machine.sliders]
        super().__init__(arguments)

    def setup(self) -> None:
        """The denominator, and the drive that leads."""
        self.teeth = int(self.rng.integers(TEETH[0], TEETH[1] + 1))
        self.next = (self.place + 1) % len(self.site.machine.sliders)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Remember when each way began, and how long it was."""
        self._begun[drive].append((leg.start_s, leg.to_m - leg.from_m))

    def _left(self, way_m: Array, lead_m: Array) -> Array:
        """What a ratio leaves of a way (n,), over the most when the way that leads is WAY_M."""
        moves = np.abs(lead_m) > 0.0
        teeth = np.rint(self.teeth * way_m / np.where(moves, lead_m, 1.0))
        return np.where(moves, 2.0 * (teeth * lead_m - self.teeth * way_m) / WAY_M, 0.0)

    def _left_before(self) -> Array:
        """The sum of what is left before each recorded leg, and after the last."""
        own, lead = (np.array(self._begun[drive]).reshape(-1, 2) for drive in (self.place, self.next))
        if not len(own) or not len(lead):
            return np.zeros(len(own) + 1)
        at = np.maximum(np.searchsorted(lead[:, 0], own[:, 0] + TOGETHER_S, side="right") - 1, 0)
        together = np.abs(lead[at, 0] - own[:, 0]) <= TOGETHER_S
        left = self._left(own[:, 1], np.where(together, lead[at, 1], 0.0))
        return np.concatenate([[0.0], np.cumsum(left)])

    def _left_since(self, state: MotionState, lead_m: Array) -> Array:
        """What the last way of the drive that leads has left (n,) if this one has moved alone since then."""
        begun = self._begun[self.place]
        if not begun:
            return np.zeros(len(state))
        own, begins_s = np.array(begun), state.leg_start_s[:, self.next]
        at = np.maximum(np.searchsorted(own[:, 0], begins_s + TOGETHER_S, side="right") - 1, 0)
        still = (state.leg[:, self.next] == len(self._begun[self.next])) & (at < state.leg[:, self.place])
        together = np.abs(own[at, 0] - begins_s) <= TOGETHER_S
        return self._left(own[at, 1], np.where(still & together, lead_m, 0.0))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Leave the slider beside its target."""
        a, b = self.place, self.next
        way_m, lead_m = ((state.q_m - state.from_m)[:, drive] for drive in (a, b))
        together = np.abs(state.leg_start_s[:, a] - state.leg_start_s[:, b]) <= TOGETHER_S
        left = self._left_before()[state.leg[:, a]] + self._left_since(state, lead_m)
        left = left + self._left(way_m, np.where(together, lead_m, 0.0))
        deviation.travel_m[:, a] += self.size * apply_variant(left, self.variant, state.payload_kg)


EFFECTS = (
    outside_effect(
        "two_faces",
        "rig",
        TwoFaces,
        EffectParameter("error_rad", 1e-6, 2e-5, 1e-3, "of the beam, to either side"),
        "horizontal angles, to one side after each exchange of payload and to the other after the next, by height; all "
        "SMRs and nests alike",
    ),
    outside_effect(
        "aneroid_bellows",
        "rig",
        AneroidBellows,
        EffectParameter("force_n", 5.0, 400.0, 3e4, "at 0.1 hPa from where it is slack"),
        "pressure of the air, not the place; rotation",
    ),
    outside_effect(
        "neighbours_cam",
        "strut",
        NeighboursCam,
        EffectParameter("lift_m", 1e-6, 3e-5, 1e-3, "either way"),
        "the other drive's coordinate, in waves; not a slider's SMR",
    ),
    outside_effect(
        "rounded_ratio",
        "drive",
        RoundedRatio,
        EffectParameter("left_m", 1e-6, 3e-5, 1e-3, "of one motion, at most, when the other drive's way is 0.5 m"),
        "ratios of both drives' ways in all motions together, by what is left of them; SMRs on the sliders",
    ),
)
