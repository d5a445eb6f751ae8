"""A machine that its own control moves, seen by the station alone: when it stands, where, and whether it stays there.

One reflector of the platform is followed from visit to visit. Where it comes to rest it is compared with where the
visit that is next has it; anywhere else the campaign is refused, for the readings would be taken for another pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.frame import Frame
from calibration.base.rotation import rotation_matrix
from calibration.instruments import station_geometry
from calibration.machine.inverse import nominal_poses
from calibration.machine.led_path import approach_point, forward_pose, tool_coordinates
from drivers.errors import NotSettled, StationError
from drivers.station.laser_tracker import LockState, MeanReading, SettleCriterion, average
from pkm_rig.errors import CampaignRefused
from pkm_rig.rig.devices import (
    INITIAL_SEARCH_WINDOW_RAD,
    SEARCH_WINDOW_RAD,
    SETTLE_READINGS,
    SETTLED_ACROSS_M,
    ReadingTags,
)
from pkm_rig.rig.led_motion import is_led, side_of
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.schedule import Block, PlannedVisit
from pkm_rig.rig.unread_drives import UnreadDrives
from pkm_rig.rig.worker import Worker, WorkStatus

LONGEST_WAIT_S = 3600.0  # for the machine to stand at the next pose
LOOK_S = 1.0  # between two looks at a machine that does not stand yet
SEEK_S, LONG_LOOK_S = 30.0, 5.0  # after so long it is sought at all poses, if it is lost, and looked at less often
STILL_S = 5.0  # within which a reflector that stands has come to rest
LEFT = 0.05  # of the approach's length: farther off the machine has left its last pose
SAME_PLACE = 0.4  # of the approach's length: within it a reflector is where a pose has it
FIRST_TOLERANCE_M = 0.020  # before the frame is known by more than the floor nests
MOVED_SIGMA = 5.0
ELSEWHERE_LOOKS = 2  # looks in a row at which it stands where it should not: between two moves it may for a moment


@dataclass(frozen=True)
class Place:
    """Where the followed reflector stands, (3,) in the station's frame, and its covariance (3, 3)."""

    point_m: Array
    covariance_m2: Array

    def is_away(self, other: Place, limit_m: float) -> bool:
        """Whether another place is farther off than a limit and the noise of both explain."""
        apart = other.point_m - self.point_m
        spread = self.covariance_m2 + other.covariance_m2 + (limit_m / MOVED_SIGMA) ** 2 * np.eye(3)
        return float(apart @ np.linalg.solve(spread, apart)) > MOVED_SIGMA**2


@dataclass(frozen=True)
class Leaving:
    """`set(visit)`: look once more after a visit's readings. CampaignRefused if the machine has moved meanwhile."""

    look: Callable[[PlannedVisit], WorkStatus]
    name: str = "leaving"
    parent: None = None

    def set(self, visit: PlannedVisit) -> WorkStatus:
        """Make sure that the machine still stands there, and follow it from now on."""
        return self.look(visit)


class WatchedMachine:
    """`set(visit)`: wait until the machine stands there; `leaving.set(visit)`: make sure that it still does.

    `order`: the blocks as the control's program visits them; their visits are its N1, N2, ...
    """

    name = "machine"
    parent = None

    def __init__(
        self, rig: Rig, worker: Worker, tags: ReadingTags, order: Sequence[Block], say: Callable[[str], None]
    ) -> None:
        if not isinstance(rig.drives, UnreadDrives):
            raise TypeError("a rig whose drives are not read is needed")
        self._rig, self._worker, self._tags, self._say, self._drives = rig, worker, tags, say, rig.drives
        visits = [visit for block in order for visit in block.visits]
        self._number = {(v.pose, v.pass_): n for n, v in enumerate(visits, start=1)}
        self._visits = visits
        self._drives.stand_at(visits[0].drives_m)  # nests are measured before the first visit
        self._smrs = [np.asarray(s.position_m) for s in rig.machine.smrs if s.on == "platform"]  # the first is followed
        self._follows = False
        self._last: Place | None = None
        self._last_visit: PlannedVisit | None = None
        self.leaving = Leaving(self._leave)

    def set(self, visit: PlannedVisit) -> WorkStatus:
        """Wait for the machine at a visit's pose. CampaignRefused if it stands at another one, or does not come."""
        return self._worker.submit(f"machine at N{self._n(visit)}", lambda: self._wait_for(visit))

    def _leave(self, visit: PlannedVisit) -> WorkStatus:
        return self._worker.submit(f"machine still at N{self._n(visit)}", lambda: self._require_still_there(visit))

    def stop(self, *, success: bool = False) -> None:
        """Called by the run engine at the end of a plan: the control stops its machine, not we."""

    def _n(self, visit: PlannedVisit) -> int:
        return self._number[visit.pose, visit.pass_]

    def _wait_for(self, visit: PlannedVisit) -> None:
        rig, number = self._rig, self._n(visit)
        rig.observer.going_to(visit.target_m, visit.pose)
        if self._last is None:  # where it stands before anybody starts the program is no mistake
            self._last = self._look(visit, seek=True)
        is_again = self._last_visit is not None and self._n(self._last_visit) == number  # made anew after a pause
        place = self._last if self._last_visit is None and self._last and self._is_at(self._last, visit) else None
        if place is None:
            if self._last_visit is None or self._last_visit.payload != visit.payload:
                self._say(f"the station watches: start the program at N{number}")
            place = self._stand_at(visit, left=self._last is None or is_again)
        self._drives.stand_at(visit.drives_m)
        tags = self._tags
        tags.visit, tags.arrived_s, tags.fresh_arrival = visit, rig.clock.now_s(), False
        tags.visit_number += 1
        self._last, self._last_visit = place, visit

    def _stand_at(self, visit: PlannedVisit, *, left: bool) -> Place:
        """Where it stands at a visit; left: that it has left the place where it stood before need not be seen."""
        rig, begin_s = self._rig, self._rig.clock.now_s()
        looks, seen_s = 0, begin_s
        while rig.clock.now_s() < begin_s + LONGEST_WAIT_S:
            rig.supervisor.require_good()
            place = self._look(visit, seek=rig.clock.now_s() > seen_s + SEEK_S)
            if place is not None:
                seen_s = rig.clock.now_s()
                left = left or self._last is None or self._last.is_away(place, LEFT * rig.file.campaign.approach_m)
            if place is not None and left:
                if self._is_at(place, visit):
                    return place
                looks = 0 if self._is_before(place, visit) else looks + 1
                if looks >= ELSEWHERE_LOOKS:
                    raise CampaignRefused(self._elsewhere(place, visit))
            elif place is None:
                looks = 0
            rig.clock.sleep_s(LOOK_S if rig.clock.now_s() < begin_s + SEEK_S else LONG_LOOK_S)
        raise CampaignRefused(
            f"N{self._n(visit)}: the machine did not come to stand at pose {visit.pose} within "
            f"{LONGEST_WAIT_S / 60.0:.0f} min; start the program at N{self._n(visit)} and go on with --resume"
        )

    def _require_still_there(self, visit: PlannedVisit) -> None:
        number = self._n(visit)
        advice = (
            f"let it stand longer, or press start only after 'N{number} is measured'; go on with --resume at N{number}"
        )
        try:
            self._aim(self._points(visit.target_m)[0])
            mean = average(self._rig.station.measure(SETTLE_READINGS))
        except StationError as error:
            raise CampaignRefused(
                f"N{number}: the machine has left pose {visit.pose} while it was measured ({error.what}); {advice}"
            ) from error
        place = self._place(mean)
        if self._last is None or self._last.is_away(place, self._rig.file.limits.moved_m):
            moved_m = math.inf if self._last is None else float(np.linalg.norm(place.point_m - self._last.point_m))
            raise CampaignRefused(
                f"N{number}: the machine moved by {moved_m * 1e6:.0f} um at pose {visit.pose} while it was measured; "
                f"{advice}"
            )
        self._follow()
        self._say(f"N{number} is measured")

    # --- the followed reflector

    def _look(self, visit: PlannedVisit, *, seek: bool) -> Place | None:
        """Where the followed reflector stands; None while it moves or is not found. seek: at all poses."""
        try:
            if not (self._follows and self._is_followed()) and not self._find(
                self._likely(visit, seek=seek), sure=seek
            ):
                return None
            still = SettleCriterion(SETTLE_READINGS, SETTLED_ACROSS_M, limit_s=STILL_S)
            return self._place(average(self._rig.station.measure(SETTLE_READINGS, settle=still)))
        except NotSettled:
            return None
        except StationError:
            self._follows = False
            return None

    def _is_followed(self) -> bool:
        return self._rig.station.lock_state() is LockState.IN

    def _follow(self) -> None:
        self._rig.station.lock()
        self._follows = True

    def _find(self, poses: Sequence[Array], *, sure: bool) -> bool:
        """Follow the reflector from where it is found at one of some platform poses (6,); False if at none.

        sure: of many poses one may have another reflector there, so a second one has to be in its place as well.
        """
        self._follows = False
        smrs = self._smrs[:2] if sure else self._smrs[:1]
        for pose in poses:
            try:
                if all(self._sees(mounting_m, pose) for mounting_m in reversed(smrs)):
                    self._follow()
                    return True
            except StationError:
                continue
        return False

    def _sees(self, mounting_m: Array, pose: Array) -> bool:
        """Whether a reflector of the platform is where a pose has it; the station then aims at it."""
        expected = self._point(mounting_m, pose)
        self._aim(expected)
        seen = self._place(average(self._rig.station.measure())).point_m
        return bool(np.linalg.norm(seen - expected) <= self._tolerance_m())

    def _aim(self, point: Array) -> None:
        """Aim at a reflector near a point (3,), station's frame. Raises StationError where there is none."""
        self._rig.refresh_atmosphere_if_stale()
        hz, v, _ = station_geometry.points_to_polar(point[None])
        window = SEARCH_WINDOW_RAD if self._tags.aim.is_fitted else INITIAL_SEARCH_WINDOW_RAD
        self._rig.station.point_and_aim(float(hz[0]), float(v[0]), window)

    def _likely(self, visit: PlannedVisit, *, seek: bool) -> list[Array]:
        """Platform poses (6,) at which it may be: the next visit's and before it, the last one's; or all poses."""
        if seek:
            machine = self._rig.machine
            middle = nominal_poses(machine, machine.commanded_limits.mean(axis=1)[None])[0]
            return [*{v.pose: v.target_m for v in (visit, *self._visits)}.values(), middle]
        last = [] if self._last_visit is None else [self._last_visit.target_m]
        return [visit.target_m, *last, *self._approaches(visit)]

    def _approaches(self, visit: PlannedVisit) -> list[Array]:
        """Platform poses (6,) from which a program of the drives, and one of the tool, approaches a visit."""
        machine, settings = self._rig.machine, self._rig.file.campaign
        led = is_led(machine, settings)
        commanded = tool_coordinates(machine, visit.target_m[None])
        side = side_of(machine, visit.target_m, visit.direction, settings.approach_m) if led else visit.direction[0]
        by_tool = nominal_poses(machine, approach_point(machine, commanded, side, settings.approach_m))[0]
        if led:
            return [by_tool]
        drives = visit.drives_m - np.array(visit.direction) * settings.approach_m
        return [nominal_poses(machine, forward_pose(machine, drives)[0][None])[0], by_tool]

    def _points(self, *poses: Array) -> list[Array]:
        """Where the followed reflector is seen at platform poses (6,)."""
        return [self._point(self._smrs[0], pose) for pose in poses]

    def _point(self, mounting_m: Array, pose: Array) -> Array:
        place = pose[:3] + rotation_matrix(pose[None, 3:])[0] @ mounting_m
        return np.asarray(self._frame().to_station(place[None])[0])

    def _frame(self) -> Frame:
        """The frame to compare in; before enough was measured the rough one, moved onto the floor nests."""
        aim = self._tags.aim
        rough = aim.frame or self._rig.rough_frame()
        if aim.is_fitted or len(aim.measured_m) < 2:
            return rough
        return onto_nests(rough, np.array(aim.expected_m), np.array(aim.measured_m))

    def _place(self, mean: MeanReading) -> Place:
        hz, v, distance = (np.array([x]) for x in (mean.hz_rad, mean.v_rad, mean.slope_distance_m))
        stated = self._rig.file.station.accuracy.to_station_accuracy()
        covariance = station_geometry.point_covariances(hz, v, distance, stated)[0] / mean.n
        return Place(station_geometry.polar_to_points(hz, v, distance)[0], covariance)

    # --- which pose it is

    def _tolerance_m(self) -> float:
        return SAME_PLACE * self._rig.file.campaign.approach_m if self._tags.aim.is_fitted else FIRST_TOLERANCE_M

    def _is_at(self, place: Place, visit: PlannedVisit) -> bool:
        """Whether it stands where a visit has it, and not rather where the visit is approached from."""
        target, *before = self._points(visit.target_m, *self._approaches(visit))
        off = np.linalg.norm(np.array([target, *before]) - place.point_m, axis=1)
        return bool(off[0] <= self._tolerance_m() and off[0] == off.min())

    def _is_before(self, place: Place, visit: PlannedVisit) -> bool:
        before = self._points(*self._approaches(visit))
        return any(np.linalg.norm(place.point_m - point) <= self._tolerance_m() for point in before)

    def _elsewhere(self, place: Place, visit: PlannedVisit) -> str:
        number = self._n(visit)
        points = np.array(self._points(*(v.target_m for v in self._visits)))
        off = np.linalg.norm(points - place.point_m, axis=1)
        nearest = self._visits[int(np.argmin(off))]
        if off.min() <= self._tolerance_m() and nearest.pose != visit.pose:
            where = f"at pose {nearest.pose} (N{self._n(nearest)})"
        else:
            away = float(off[self._visits.index(visit)])
            where = f"{away * 1e3:.1f} mm from there, at no pose of the program"
        return (
            f"the machine stands {where}, but pose {visit.pose} (N{number}) is next; have the program go on at "
            f"N{number}, and go on with --resume"
        )


def onto_nests(frame: Frame, machine_m: Array, station_m: Array) -> Frame:
    """A levelled frame, turned about the vertical and shifted until points (n, 3) of the machine lie where seen."""
    seen = frame.to_station(machine_m)
    centre, other = seen.mean(axis=0), station_m.mean(axis=0)
    a, b = (seen - centre)[:, :2], (station_m - other)[:, :2]
    angle = math.atan2(float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b)))
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Frame(turn @ frame.rotation, other + turn @ (frame.translation_m - centre))
