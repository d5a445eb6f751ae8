"""Where one drive is at any time: a chain of profiles, stops and times under the brake.

Positions are increments in command coordinates; the encoder counts command + correction - following error. The true
position of the axis is its count plus a shift, which homing and a restart change (`recount`) while the axis does not
move. A past time can be queried as long as its segment is kept. A table by direction takes the one in which the command
has moved last, from the start of a motion on. Not modelled: slip of the brake, noise of the encoder, a ramp of the step
at a reversal.
"""

from __future__ import annotations

from dataclasses import dataclass

from mock_devices.drives.motion_profile import Profile, decelerate_to_rest, move, standstill
from mock_devices.drives.table_bank import Table
from mock_devices.plant.base_plant import SetPoint

_KEPT = 8
_INVERSIONS = 6
_TURNED_INC = 100  # by which a command has to come back before its direction is another one


@dataclass(frozen=True)
class Dynamics:
    """Limits of a motion in increments and seconds."""

    speed: float
    acceleration: float
    deceleration: float


@dataclass(frozen=True)
class Course:
    """Direction in which the command has moved last (1, -1; 0: not yet), and how far it has come in it."""

    direction: int = 0
    farthest_inc: float = 0.0

    def after(self, from_inc: float, to_inc: float) -> Course:
        """The course after a motion; a direction turns only where the command comes back by more than a rounding."""
        farthest_inc = self.farthest_inc if self.direction else from_inc
        way_inc = to_inc - farthest_inc
        if self.direction * way_inc > 0.0:
            return Course(self.direction, to_inc)
        if abs(way_inc) < _TURNED_INC:
            return self
        return Course(1 if way_inc > 0.0 else -1, to_inc)


NOT_MOVED = Course()


@dataclass(frozen=True)
class _Segment:
    start_s: float
    profile: Profile
    table: Table | None
    set_point: SetPoint
    braked_at_inc: float | None = None  # the encoder under the brake
    shift_inc: float = 0.0
    course: Course = NOT_MOVED

    @property
    def end_s(self) -> float:
        return self.start_s + self.profile.duration_s


class AxisMotion:
    """The chain of one drive, which starts under the brake. Not safe for threads: the drive locks."""

    def __init__(self, encoder_inc: float, shift_inc: float = 0.0) -> None:
        start = standstill(encoder_inc)
        point = SetPoint(0, round(encoder_inc))
        self._chain = [_Segment(float("-inf"), start, None, point, encoder_inc, shift_inc)]
        self.trail: list[tuple[float, Profile, float]] = []  # motions: start, profile, shift; for effects with history

    def command(self, t_s: float) -> tuple[float, float, float]:
        """Commanded position, velocity, acceleration at `t_s`."""
        segment = self._at(t_s)
        return segment.profile.at(t_s - segment.start_s)

    def following_error(self, t_s: float) -> float:
        """Command minus actual, in increments."""
        segment = self._at(t_s)
        return 0.0 if segment.braked_at_inc is not None else segment.profile.following_error(t_s - segment.start_s)

    def encoder_inc(self, t_s: float, partner_inc: float | None) -> float:
        """What the encoder counts, for the partner's command that the drive knows."""
        segment = self._at(t_s)
        if segment.braked_at_inc is not None:
            return segment.braked_at_inc - segment.profile.following_error(t_s - segment.start_s)
        position = segment.profile.at(t_s - segment.start_s)[0]
        return position + _correction(segment.table, position, partner_inc, segment.course) - self.following_error(t_s)

    def true_position_inc(self, t_s: float, partner_inc: float | None) -> float:
        """The true position of the axis, whatever the encoder counts."""
        return self.encoder_inc(t_s, partner_inc) + self._at(t_s).shift_inc

    def set_point(self, t_s: float) -> SetPoint:
        """The set-point that was followed at `t_s`."""
        return self._at(t_s).set_point

    @property
    def course(self) -> Course:
        """Of the last motion."""
        return self._chain[-1].course

    def is_moving(self, t_s: float) -> bool:
        """Whether the command moves at `t_s` or a set-point waits."""
        return t_s < self.end_s

    @property
    def end_s(self) -> float:
        """When the last motion ends."""
        return max(self._chain[-1].start_s, self._chain[-1].end_s)

    def release(self, t_s: float, table: Table | None, partner_inc: float | None) -> None:
        """Release the brake: the command becomes the one that keeps the encoder where it is."""
        last = self._chain[-1]
        encoder = self.encoder_inc(max(t_s, last.start_s), partner_inc)
        position = command_for(encoder, table, partner_inc, last.course)
        start_s = max(t_s, last.start_s)
        self._append(
            _Segment(start_s, standstill(position), table, last.set_point, shift_inc=last.shift_inc, course=last.course)
        )

    def apply_brake(self, t_s: float, deceleration: float, partner_inc: float | None) -> None:
        """Stop with the given deceleration, then apply the brake."""
        self.stop(t_s, deceleration)
        last = self._chain[-1]
        if last.braked_at_inc is not None:
            return
        position, start_s = last.profile.target, max(t_s, last.end_s)
        encoder = position + _correction(last.table, position, partner_inc, last.course)
        settling = standstill(position, last.profile.following_error(start_s - last.start_s))
        self._append(_Segment(start_s, settling, last.table, last.set_point, encoder, last.shift_inc, last.course))

    def recount(self, t_s: float, count_inc: float) -> None:
        """Count from `count_inc` on, without compensation; if the axis moves, from where it comes to rest."""
        last = self._chain[-1]
        start_s = max(t_s, self.end_s)
        previous_inc = last.profile.target if last.braked_at_inc is None else last.braked_at_inc
        point = SetPoint(last.set_point.count + 1, round(count_inc))
        resting = standstill(count_inc, last.profile.following_error(start_s - last.start_s))
        braked_at_inc = None if last.braked_at_inc is None else count_inc
        shift_inc = last.shift_inc + previous_inc - count_inc
        self._append(_Segment(start_s, resting, None, point, braked_at_inc, shift_inc))

    def go(self, t_s: float, target_inc: int, dynamics: Dynamics, *, at_once: bool) -> None:
        """Follow a new set-point now, or after the present motion."""
        start_s = t_s if at_once else max(t_s, self.end_s)
        before = self._at(start_s)
        position, velocity, _ = before.profile.at(start_s - before.start_s)
        profile = move(
            position,
            velocity,
            float(target_inc),
            speed=dynamics.speed,
            acceleration=dynamics.acceleration,
            deceleration=dynamics.deceleration,
            following_error=before.profile.following_error(start_s - before.start_s),
        )
        point = SetPoint(self._chain[-1].set_point.count + 1, target_inc)
        course = before.course.after(position, float(target_inc))
        self._append(_Segment(start_s, profile, before.table, point, shift_inc=before.shift_inc, course=course))

    def stop(self, t_s: float, deceleration: float) -> None:
        """Stop at once; waiting set-points are dropped."""
        if t_s >= self.end_s:
            return
        now = self._at(t_s)
        position, velocity, _ = now.profile.at(t_s - now.start_s)
        following_error = now.profile.following_error(t_s - now.start_s)
        profile = decelerate_to_rest(position, velocity, deceleration=deceleration, following_error=following_error)
        course, set_point = now.course, self._chain[-1].set_point
        self._append(_Segment(t_s, profile, now.table, set_point, shift_inc=now.shift_inc, course=course))

    def _append(self, segment: _Segment) -> None:
        chain = [old for old in self._chain if old.start_s < segment.start_s] or self._chain[:1]
        self._chain = [*chain[-_KEPT:], segment]
        while self.trail and self.trail[-1][0] >= segment.start_s:
            self.trail.pop()
        if segment.profile.phases:
            self.trail.append((segment.start_s, segment.profile, segment.shift_inc))

    def _at(self, t_s: float) -> _Segment:
        for segment in reversed(self._chain):
            if segment.start_s <= t_s:
                return segment
        return self._chain[0]


def command_for(
    encoder_inc: float, table: Table | None, partner_inc: float | None, course: Course = NOT_MOVED
) -> float:
    """The command that a table maps to an encoder position."""
    position = encoder_inc
    for _ in range(_INVERSIONS):
        position = encoder_inc - _correction(table, position, partner_inc, course)
    return position


def _correction(table: Table | None, position_inc: float, partner_inc: float | None, course: Course) -> float:
    if table is None or partner_inc is None:
        return 0.0
    return table.correction_inc(position_inc, partner_inc, course.direction)
