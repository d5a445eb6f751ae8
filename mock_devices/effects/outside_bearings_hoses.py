"""Effects outside the catalogue in bearings, hoses, joints and chains, each from a published description."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, EffectParameter, MotionState, StationSight
from mock_devices.effects.outside_shapes import OutsideEffect, apply_variant, outside_effect

BALLS, ORBIT = (12, 20), 0.42  # of a bearing; turns of its cage in one turn of the axis
HOSE_AT, STIFFER_K = 0.1 + 0.2j, 6.0  # point of the platform; by how much colder a hose is stiffer by e
FILM, THINS_S = 0.7, (6.0, 20.0)  # exponent of the speed; time in which a film is pressed out to 1 / sqrt(2)
HANGS, DRAGS = 0.6, 0.4  # share of a chain's moment that goes with its height, and that of its friction


class BearingWobble(OutsideEffect):
    """Balls of unequal size under the station's standing axis tilt it, whichever of them come by.

    The balls go round more slowly than the axis turns, so that the tilt repeats by their number times the turns of
    their cage and not with the circle: T. A. Harris, "Rolling Bearing Analysis" (1966).
    """

    def setup(self) -> None:
        """How often the axis is tilted in a turn."""
        super().setup()
        self.waves = ORBIT * float(self.rng.integers(BALLS[0], BALLS[1] + 1))

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Tilt the axis towards what is aimed at, and to its side a quarter of a wave later."""
        ball = self.waves * sight.hz_rad + self.phase
        towards, aside = (
            self.size * apply_variant(y, self.variant, state.payload_kg[:, None]) for y in (np.cos(ball), np.sin(ball))
        )
        sight.hz_rad += aside / np.tan(sight.v_rad)
        sight.v_rad += towards


class StiffHose(OutsideEffect):
    """A hose of plastic that is tied to frame and platform draws the platform back to the middle, more when it is cold.

    Stiffness of polymers against temperature: H. Leaderman, "Elastic and Creep Properties of Filamentous Materials and
    Other High Polymers" (1943). The size is its force at the edge, at the machine's reference temperature.
    """

    def _unit(self, state: MotionState) -> Array:
        colder_k = self.site.machine.reference_temperature_c - state.thermal.air_series_c(state.t_s)
        return -self.platform_x(state) * np.exp(colder_k / STIFFER_K)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Pull sideways at the platform's upper edge."""
        deviation.loads.append((np.full(len(state), HOSE_AT), self.signal(state).astype(np.complex128)))


class FloatingBall(OutsideEffect):
    """A strut's joint floats up on its grease while it swings, and its load presses the grease out again at rest.

    The film grows with the power 0.7 of the speed: D. Dowson, G. R. Higginson, "Elasto-Hydrodynamic Lubrication"
    (1966). At rest it thins with one over the root of time.
    """

    def setup(self) -> None:
        """How fast the film is pressed out."""
        super().setup()
        self.thins_s = float(self.rng.uniform(*THINS_S))

    def _unit(self, state: MotionState) -> Array:
        drive = self.site.machine.struts[self.place].drive
        film = (np.maximum(state.speed_m_per_s[:, drive], 0.0) / 0.5) ** FILM
        return np.asarray(film / np.sqrt(1.0 + state.since_s[:, drive] / self.thins_s))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lengthen the strut."""
        deviation.length_m[:, self.place] += self.signal(state)


class ChainOnCarriage(OutsideEffect):
    """A chain of cables hangs beside its carriage: it turns that by what it has lifted of it, and by the chain's drag.

    Cables among the disturbances of drives in Y. Altintas, A. Verl, C. Brecher, L. Uriarte, G. Pritschow, "Machine Tool
    Feed Drives" (2011). What hangs grows with the square of the height, as the chain's bend goes up half as far.
    """

    def _unit(self, state: MotionState) -> Array:
        low, high = self.site.machine.sliders[self.place].travel_m
        height = (state.q_m[:, self.place] - low) / (high - low)
        return np.asarray(HANGS * height**2 + DRAGS * state.direction[:, self.place])

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Turn the carriage."""
        deviation.yaw_rad[:, self.place] += self.signal(state)


EFFECTS = (
    outside_effect(
        "bearing_wobble",
        "rig",
        BearingWobble,
        EffectParameter("tilt_rad", 1e-6, 2e-5, 1e-3, "of the standing axis, either way"),
        "horizontal angle, in short waves, all SMRs and nests alike",
    ),
    outside_effect(
        "stiff_hose",
        "rig",
        StiffHose,
        EffectParameter("force_n", 5.0, 400.0, 9000.0, "at the edge, at the reference temperature"),
        "x, temperature of the air",
    ),
    outside_effect(
        "floating_ball",
        "strut",
        FloatingBall,
        EffectParameter("film_m", 1e-6, 3e-5, 2e-3, "at 0.5 m/s"),
        "speed, dwell",
    ),
    outside_effect(
        "chain_on_carriage",
        "drive",
        ChainOnCarriage,
        EffectParameter("yaw_rad", 2e-6, 6e-5, 2e-3, "at the upper end, going up"),
        "drive coordinate, direction, platform rotation; not a slider's SMR",
    ),
)
