"""One drive's axis in MuJoCo: motor, transmission, nut, carriage, and the digital controller that moves them.

Nothing here says where the carriage comes to rest. Play is a two-sided stop, wind-up a spring, friction is friction
loss of a joint, settling the integral action of the controller; what a station sees of them follows. All coordinates
are along the axis, in m, from the target of the visit; forces in N, positive upwards.

The integration step is 0.1 ms. Contacts have a time constant of two steps and friction is solved without slip: with
MuJoCo's defaults a play of 15 um stands open by 350 to 500 um, and friction creeps and forgets within a second.

Two faults do not load the motor. A cable that drags pulls the bracket of the read head, by which the controller then
takes the carriage elsewhere; a tooth that broke off lies under the carriage, which pushes it along by its ends and is
lifted where it lies beneath.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_S = 1e-4
CYCLE_S = 1e-3  # of the controller
STEPS = round(CYCLE_S / STEP_S)
SOLREF = f"{2 * STEP_S} 1"
SOLIMP = "0.99 0.99 1e-6"
MOTOR_KG, NUT_KG, CARRIAGE_KG = 150.0, 60.0, 250.0  # the motor's inertia seen along the axis; half a platform with it
HEAD_KG, CABLE_KG, TOOTH_KG, TOOTH_N = 0.1, 0.05, 0.2, 10.0  # the last: friction of a tooth that is pushed along
STIFF_N_PER_M = 2e9
GAIN_N_PER_M, SHORT_S = 2e7, 0.03
ACCELERATION_M_PER_S2, RAMP_S = 3.0, 0.1  # a ramp takes several times what the position loop does: nothing swings
SLOW_M = 1.5e-3  # travelled at least before the target, so that a play or a spring of 1 mm is passed through
STILL_M_PER_S, STILL_M = 1e-6, 5e-8
STRIBECK_M_PER_S = 4e-3
LOOK = 20  # cycles between two looks whether all is at rest


@dataclass(frozen=True)
class DrivePart:
    """What a drive is made of; the defaults are a good one.

    stiffness_n_per_m: motor to nut; play_m: the nut's, end to end; friction of the guide and of the motor, and the
    share of each that is lost once it moves; viscous_n_s_per_m: of the guide; gain_n_per_m: position loop;
    integral_s: time in which its integral action does what the gain does; integral_in_motion: false: it begins anew
    at each standstill. clamp_n, clamp_n_per_m: force at which the carriage's clamp on the nut
    slips, and what holds it then. cable_n, cable_n_per_m: dry friction of the read head's cable, and its elasticity;
    bracket_n_per_m: what the head is held by. tooth_m, tooth_reach_m: height of a broken-off tooth, and how far
    from the carriage's middle it may lie.
    counterweight_n: a constant force upwards; balance: share of the load that a regulated balance takes.
    """

    stiffness_n_per_m: float = STIFF_N_PER_M
    play_m: float = 0.0
    friction_n: float = 100.0
    weakening: float = 0.0
    motor_friction_n: float = 20.0
    motor_weakening: float = 0.0
    viscous_n_s_per_m: float = 200.0
    gain_n_per_m: float = GAIN_N_PER_M
    integral_s: float = SHORT_S
    integral_in_motion: bool = True
    clamp_n: float = math.inf
    clamp_n_per_m: float = 2e7
    cable_n: float = 0.0
    cable_n_per_m: float = 1e2
    bracket_n_per_m: float = 2e5
    tooth_m: float = 0.0
    tooth_reach_m: float = 0.2
    counterweight_n: float = 0.0
    balance: float = 0.0

    @property
    def has_nut(self) -> bool:
        """Whether nut and carriage are two bodies."""
        return self.play_m > 0.0 or math.isfinite(self.clamp_n)

    def net_load_n(self, load_n: float) -> float:
        """What is left to the transmission of the struts' force on the carriage."""
        return (1.0 - self.balance) * load_n + self.counterweight_n

    def lifted_m(self, off_m: float) -> float:
        """How far a broken-off tooth lifts the carriage that lies so far from its middle."""
        inside = abs(off_m) < self.tooth_reach_m
        return self.tooth_m * math.cos(0.5 * math.pi * off_m / self.tooth_reach_m) ** 2 if inside else 0.0


@dataclass(frozen=True)
class Arrival:
    """How a drive is sent to a target: its place on the axis, side (+1 from below), speed and the struts' force.

    rub: the guide's friction that day, as a share of the part's: it differs from stop to stop.
    """

    target_m: float
    direction: int
    speed_m_per_s: float
    load_n: float
    rub: float = 1.0


@dataclass(frozen=True)
class Rest:
    """What was there at the times asked for: place of the carriage over the commanded one (n,), motor's force (n,)."""

    carriage_m: Array
    motor_n: Array


def approach(arrival: Arrival, play_m: float) -> tuple[Array, Array]:
    """Commanded places (k,) from the target and speeds (k,) of the last part of a motion, one a controller cycle.

    The speed rises and falls as half a cosine: without jerks that would let the motor swing beyond the target.
    """
    v = arrival.speed_m_per_s
    ramp, cruise = max(0.5 * math.pi * v / ACCELERATION_M_PER_S2, RAMP_S), (SLOW_M + 2.0 * play_m) / v
    t = np.arange(math.ceil((2.0 * ramp + cruise) / CYCLE_S) + 1) * CYCLE_S
    end = 2.0 * ramp + cruise
    left = np.maximum(end - t, 0.0)
    whole = v * (ramp + cruise)

    def gone(s: NDArray[Any]) -> NDArray[Any]:
        return 0.5 * v * (s - ramp / math.pi * np.sin(math.pi * s / ramp))

    way = np.where(t < ramp, gone(t), np.where(left < ramp, whole - gone(left), v * (t - 0.5 * ramp)))
    slope = np.clip(np.minimum(t, left) / ramp, 0.0, 1.0)
    speed = v * (0.5 - 0.5 * np.cos(math.pi * slope))
    return arrival.direction * (way - whole), arrival.direction * speed


class Drive:
    """One axis. It remembers how the former visit left it: springs, flanks, the integral action, the cable's grip and
    where the broken-off tooth lies.
    """

    def __init__(self, part: DrivePart) -> None:
        self.part = part
        self._model: Any = mujoco.MjModel.from_xml_string(_xml(part))
        self._data: Any = mujoco.MjData(self._model)
        self._transmission = int(self._model.tendon("transmission").id)
        self._last = 1 + part.has_nut  # the carriage, and after it the read head, cable and tooth, if they are there
        self._with = self._last + 1 + bool(part.cable_n)  # bodies that go with it
        self._left = np.zeros(self._with)  # each body's place over the commanded one, as the former visit left it
        self._at_m = 0.0
        self._behind_m = math.nan  # where the cable grips, or the tooth lies, on the axis
        self._integral_n = math.nan

    def visit(self, arrival: Arrival, dwell_s: Array) -> Rest:
        """Integrate the last part of the motion and the rest; dwell_s (n,): rising times since the target."""
        part, data = self.part, self._data
        commanded, speed = approach(arrival, part.play_m)
        self._model.dof_frictionloss[self._last] = part.friction_n * arrival.rub
        net_n = part.net_load_n(arrival.load_n)
        self._place(arrival, float(commanded[0]), net_n)
        push_n = (MOTOR_KG + CARRIAGE_KG) * np.diff(speed, append=0.0) / CYCLE_S
        for place, fast, ahead_n in zip(commanded.tolist(), speed.tolist(), push_n.tolist(), strict=True):
            self._cycle(place, fast, net_n, ahead_n)
        out = np.empty((len(dwell_s), 2))
        cycles, still = 0, False
        for i, after in enumerate(dwell_s.tolist()):
            while not still and cycles < round(after / CYCLE_S):
                self._cycle(0.0, 0.0, net_n)
                cycles += 1
                still = cycles % LOOK == 0 and self.is_still()
            out[i] = data.qpos[self._last], data.actuator_force[0]
        self._leave(arrival)
        return Rest(out[:, 0], out[:, 1])

    def hold(self, seconds: float, load_n: float) -> Rest:
        """Stay where the last visit ended; what is there at the end, integrated to it."""
        for _ in range(round(seconds / CYCLE_S)):
            self._cycle(0.0, 0.0, self.part.net_load_n(load_n))
        return Rest(self._data.qpos[[self._last]].copy(), self._data.actuator_force[[0]].copy())

    def is_still(self) -> bool:
        """Whether nothing moves, and the integral action has nothing left to do."""
        data = self._data
        return bool(np.max(np.abs(data.qvel)) < STILL_M_PER_S and abs(self._seen_m()) < STILL_M)

    def _seen_m(self) -> float:
        """Where the controller takes the motor to be: by a bent bracket it is mistaken."""
        qpos = self._data.qpos
        bent = qpos[self._last + 1] - qpos[self._last] if self.part.cable_n else 0.0
        return float(qpos[0] + bent)

    def _cycle(self, place_m: float, speed_m_per_s: float, load_n: float, ahead_n: float = 0.0) -> None:
        """One cycle of the controller: it holds its set values while the mechanics are integrated."""
        part, data = self.part, self._data
        seen_m = self._seen_m()
        if speed_m_per_s == 0.0 or part.integral_in_motion:
            self._integral_n += part.gain_n_per_m * (place_m - seen_m) * CYCLE_S / part.integral_s
        middle_m = place_m + 0.5 * CYCLE_S * speed_m_per_s  # set values hold for a cycle: those of its middle
        rate = _rate_gain(part)
        mistaken_m = seen_m - data.qpos[0]
        data.ctrl[0] = part.gain_n_per_m * (middle_m - mistaken_m) + rate * speed_m_per_s + self._integral_n + ahead_n
        data.ctrl[1] = load_n + _given_back(part.friction_n * part.weakening, data.qvel[self._last])
        data.ctrl[2] = _given_back(part.motor_friction_n * part.motor_weakening, data.qvel[0])
        if part.tooth_m:
            lifted = part.lifted_m(data.qpos[self._with] - data.qpos[self._last])
            self._model.tendon_lengthspring[self._transmission] = lifted
        mujoco.mj_step(self._model, data, STEPS)

    def _place(self, arrival: Arrival, start_m: float, net_n: float) -> None:
        """Put the bodies at the begin of the last part, as the former visit left them to one another."""
        part, data = self.part, self._data
        mujoco.mj_resetData(self._model, data)
        data.qpos[: self._with] = start_m + self._left
        at_m = arrival.target_m + start_m
        if math.isnan(self._integral_n) or not part.integral_in_motion:
            self._integral_n = -net_n
        else:  # over the part of the motion that is not integrated it goes to what moving takes
            there = 1.0 if at_m > self._at_m else -1.0
            moving_n = -net_n + there * (part.friction_n * (1.0 - part.weakening) + part.motor_friction_n)
            gone = math.exp(-abs(at_m - self._at_m) / arrival.speed_m_per_s / part.integral_s)
            self._integral_n = moving_n + (self._integral_n - moving_n) * gone
        if part.cable_n or part.tooth_m:
            reach = part.tooth_reach_m if part.tooth_m else part.cable_n / part.cable_n_per_m
            before = at_m if math.isnan(self._behind_m) else self._behind_m
            self._behind_m = min(max(before, at_m - reach), at_m + reach)
            data.qpos[self._with] = self._behind_m - arrival.target_m

    def _leave(self, arrival: Arrival) -> None:
        self._left = self._data.qpos[: self._with].copy()
        self._at_m = arrival.target_m
        if self.part.cable_n or self.part.tooth_m:
            self._behind_m = arrival.target_m + float(self._data.qpos[self._with])


def _rate_gain(part: DrivePart) -> float:
    """Damping of the position loop, in N s/m: somewhat below critical."""
    return 1.6 * math.sqrt(part.gain_n_per_m * (MOTOR_KG + CARRIAGE_KG))


def _given_back(most_n: float, speed_m_per_s: float) -> float:
    """What moving takes off the friction at rest: it falls with speed, as between lubricated ways (Stribeck)."""
    return most_n * math.tanh(speed_m_per_s / STRIBECK_M_PER_S) if most_n else 0.0


def _xml(part: DrivePart) -> str:
    damping = 0.2 * math.sqrt(part.stiffness_n_per_m * NUT_KG)
    bodies = [_body("motor", MOTOR_KG, part.motor_friction_n)]
    tendons = []
    end = "carriage"
    if part.has_nut:
        end = "nut"
        bodies.append(_body("nut", NUT_KG, 0.0))
        reach = f"{-0.5 * part.play_m} {0.5 * part.play_m}"
        between = f'limited="true" range="{reach}" solreflimit="{SOLREF}" solimplimit="{SOLIMP}"'
        if math.isfinite(part.clamp_n):
            between = (
                f'frictionloss="{part.clamp_n}" solreffriction="{SOLREF}" solimpfriction="{SOLIMP}" springlength="0" '
                f'stiffness="{part.clamp_n_per_m}" damping="{0.1 * math.sqrt(part.clamp_n_per_m * CARRIAGE_KG)}"'
            )
        tendons.append(f'<fixed name="joint" {between}>{_difference("carriage", "nut")}</fixed>')
    spring = f'stiffness="{part.stiffness_n_per_m}" damping="{damping}" springlength="0"'
    tendons.append(f'<fixed name="transmission" {spring}>{_difference(end, "motor")}</fixed>')
    bodies.append(_body("carriage", CARRIAGE_KG, part.friction_n, part.viscous_n_s_per_m))
    if part.cable_n:
        bodies += [_body("head", HEAD_KG, 0.0), _body("cable", CABLE_KG, part.cable_n)]
        damping = 2.0 * math.sqrt(part.bracket_n_per_m * HEAD_KG)
        bracket = f'stiffness="{part.bracket_n_per_m}" damping="{damping}" springlength="0"'
        tendons.append(f'<fixed name="bracket" {bracket}>{_difference("head", "carriage")}</fixed>')
        pull = f'stiffness="{part.cable_n_per_m}" damping="1" springlength="0"'
        tendons.append(f'<fixed name="cable" {pull}>{_difference("head", "cable")}</fixed>')
    if part.tooth_m:
        bodies.append(_body("tooth", TOOTH_KG, TOOTH_N))
        ends = f'limited="true" range="{-part.tooth_reach_m} {part.tooth_reach_m}" '
        ends += f'solreflimit="{SOLREF}" solimplimit="{SOLIMP}"'
        tendons.append(f'<fixed name="ends" {ends}>{_difference("tooth", "carriage")}</fixed>')
    rate = _rate_gain(part)
    servo = f'gaintype="fixed" gainprm="1" biastype="affine" biasprm="0 {-part.gain_n_per_m} {-rate}"'
    actuators = [f'<general joint="motor" {servo}/>', '<motor joint="carriage"/>', '<motor joint="motor"/>']
    return (
        f'<mujoco><option timestep="{STEP_S}" gravity="0 0 0" integrator="implicitfast" iterations="30" '
        f'noslip_iterations="8"><flag contact="disable"/></option><worldbody>{"".join(bodies)}</worldbody>'
        f"<tendon>{''.join(tendons)}</tendon><actuator>{''.join(actuators)}</actuator></mujoco>"
    )


def _body(name: str, mass_kg: float, friction_n: float, viscous_n_s_per_m: float = 0.0) -> str:
    rubs = f'frictionloss="{friction_n}" solreffriction="{SOLREF}" solimpfriction="{SOLIMP}"' if friction_n else ""
    return (
        f'<body><joint name="{name}" type="slide" axis="0 1 0" damping="{viscous_n_s_per_m}" {rubs}/>'
        f'<inertial pos="0 0 0" mass="{mass_kg}" diaginertia="1 1 1"/></body>'
    )


def _difference(one: str, other: str) -> str:
    return f'<joint joint="{one}" coef="1"/><joint joint="{other}" coef="-1"/>'
