"""Ordinary disturbances that a rig declares (`[nuisance]`): drift, reseating, reversal, temperature, one sd each.

And friction in the torque of a drive, which is no disturbance of any reading.
"""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import (
    Deviation,
    Effect,
    EffectArguments,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
    StatefulEffect,
    StationSight,
)
from mock_devices.effects.friction_windup import FRICTION_PARAMETERS, FRICTION_VARIANTS, FrictionWindup
from mock_devices.effects.instrument import LEVER_M, move_station
from mock_devices.effects.walks import RandomWalk


class OrdinaryDrift(Effect):
    """The station's frame walks: a coordinate at 3 m has the declared deviation after one hour."""

    def setup(self) -> None:
        """Start the walk."""
        self.walk = RandomWalk(self.rng, 6)

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Move the frame; rotation and shift have equal parts of the variance across the line of sight."""
        y = self.size / np.sqrt(2.0) * self.walk.at(self.elapsed_s(state))
        move_station(sight, y[:, :3] / LEVER_M, y[:, 3:])


class OrdinaryReseat(Effect):
    """Platform reflectors are taken off with every exchange of payload; each then sits a little elsewhere."""

    def setup(self) -> None:
        """Draw the places after each exchange."""
        self.shifts = self.rng.standard_normal((32, len(self.site.machine.smrs), 2))
        self.shifts[0] = 0.0

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the reflectors."""
        on = np.array([smr.on == "platform" for smr in self.site.machine.smrs])
        number = state.exchanges.astype(int) % 32
        deviation.smr_m[:, :, :2] += self.size * self.shifts[number] * on[None, :, None]


class OrdinaryReversal(StatefulEffect):
    """Each drive stands a little apart by the side that it came from; half of the loop has the declared deviation."""

    def setup(self) -> None:
        """Draw each drive's loop."""
        self.halves = self.rng.standard_normal(len(self.site.machine.sliders))

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """The last side."""
        return -leg.direction if leg.direction else before

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the sliders."""
        for a, half in enumerate(self.halves):
            side = np.where(state.direction[:, a] != 0.0, -state.direction[:, a], self.state_before(state, a))
            deviation.travel_m[:, a] += self.size * half * side


class OrdinaryTemperature(Effect):
    """Parts are not quite as warm as their sensors: slow waves of the declared deviation, one a strut and a column."""

    def setup(self) -> None:
        """Draw phases and periods."""
        count = len(self.site.machine.struts) + len(self.site.machine.sliders)
        self.phases = self.rng.uniform(0.0, 2.0 * np.pi, count)
        self.periods_s = self.rng.uniform(1500.0, 9000.0, count)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Grow struts and scales."""
        machine = self.site.machine
        wave_k = self.size * np.sqrt(2.0) * np.sin(2.0 * np.pi * state.t_s[:, None] / self.periods_s + self.phases)
        struts = len(machine.struts)
        for i, strut in enumerate(machine.struts):
            deviation.length_m[:, i] += machine.expansion["struts"].coefficient_per_k * strut.length_m * wave_k[:, i]
        for a in range(len(machine.sliders)):
            deviation.travel_m[:, a] += (
                machine.expansion["drives"].coefficient_per_k * state.q_m[:, a] * wave_k[:, struts + a]
            )


class OrdinaryFriction(Effect):
    """Friction that is left in a drive after a stop, in a way of one that winds up its screw; this one is too stiff."""

    def setup(self) -> None:
        """Draw the way and the friction."""
        variant = str(self.rng.choice(FRICTION_VARIANTS))
        values = {"windup_m_per_n": 0.0}
        for parameter in FRICTION_PARAMETERS:
            values[parameter.name] = float(np.exp(self.rng.uniform(np.log(parameter.low), np.log(parameter.high))))
        values["friction_n"] *= self.size
        self.friction = FrictionWindup(EffectArguments(self.site, self.place, variant, values, self.rng))

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Which side it is left on depends on the former legs."""
        self.friction.record_leg(drive, leg)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Load the drive, and move nothing."""
        deviation.force_n[:, self.place] += self.friction.friction_n(state)


_FACTS: tuple[tuple[str, type[Effect], EffectParameter, str], ...] = (
    ("ordinary_drift", OrdinaryDrift, EffectParameter("drift_m", 1e-7, 1e-5, 1e-3, "sd after one hour at 3 m"), "time"),
    ("ordinary_reseat", OrdinaryReseat, EffectParameter("reseat_m", 1e-7, 2e-6, 1e-3, "sd of a coordinate"), "payload"),
    (
        "ordinary_reversal",
        OrdinaryReversal,
        EffectParameter("reversal_m", 1e-7, 1e-6, 1e-3, "sd of half a loop"),
        "side",
    ),
    (
        "ordinary_temperature",
        OrdinaryTemperature,
        EffectParameter("temperature_k", 1e-4, 2e-2, 5.0, "sd of a part"),
        "time",
    ),
)

EFFECTS = (
    *(
        EffectSpec(
            name=name,
            kind="nuisance",
            place="rig",
            size=size,
            variants=("plain",),
            final="",
            reveals=reveals,
            make=make,
        )
        for name, make, size, reveals in _FACTS
    ),
    EffectSpec(
        name="ordinary_friction",
        kind="nuisance",
        place="drive",
        size=EffectParameter("ratio", 0.0, 1.0, 10.0, "of a friction that is drawn"),
        variants=("plain",),
        final="",
        reveals="torque",
        make=OrdinaryFriction,
    ),
)
