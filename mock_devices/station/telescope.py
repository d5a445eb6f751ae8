"""The instrument behind the station's protocol: turning, aiming, measuring one reflector.

A measurement lasts `_DURATION_S` of its distance mode and sees the reflector where it is in the middle.
The distance that comes out is (d_true scale + constant + noise) (1 + (ppm set - ppm of the air) 1e-6) + prism constant,
the reflectors' own constant being 0. Face II readings are Hz + pi and 2 pi - V; collimation and vertical index error
have opposite signs there.
A break of the beam ends a lock. Not modelled: search by spirals, prediction of a lost target, weak signals,
compensator, self-heating, reflectors that hide one another or turn away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from mock_devices.faults import NO_FAULTS, FaultPlan
from mock_devices.plant.atmosphere import ppm
from mock_devices.plant.base_plant import BasePlant, Sighting
from mock_devices.plant.optics import TWO_PI, Polar, direction_between, hz_difference

OK = 0
ANGLE_OK = 1285
NO_TARGET = 8710
MULTIPLE_TARGETS = 8711
NO_LOCK = 8725

ATR_WINDOW_RAD = 0.020
LINE_OF_SIGHT_RAD = 1.0e-3
_KNOCK_RAD = 1.0e-4
_NEIGHBOUR_RAD = 2.0e-3
_TURN_START_S = 0.2
_TURN_RATE_RAD_PER_S = 1.5
_FINE_ADJUST_S = 0.4
_STANDARD_S = 1.0
_DURATION_S = {3: 0.5, 6: 0.3, 7: 0.3, 8: 0.3, 9: 0.2, 10: 3.0, 11: 3.0, 12: 3.0, 13: 2.0}

STANDARD_MODE = 2


class AimError(Exception):
    """Aiming or measuring failed; `code` is GeoCOM's."""

    def __init__(self, code: int) -> None:
        super().__init__(f"GeoCOM {code}")
        self.code = code


@dataclass(frozen=True)
class TelescopeReading:
    """One measurement in the readings of the present face."""

    hz_rad: float
    v_rad: float
    distance_m: float
    t_s: float


@dataclass
class Air:
    """The air that the station corrects for, as its user has set it."""

    wavelength_m: float = 0.658e-6
    pressure_hpa: float = 1013.25
    dry_c: float = 12.0
    wet_c: float = 8.0


class Telescope:
    """Line of sight, face, lock and the last measurement. All angles are readings, errors included."""

    def __init__(self, plant: BasePlant, faults: FaultPlan = NO_FAULTS) -> None:
        self._plant = plant
        self._faults = faults
        self._clock = plant.clock
        self.hz_rad = 0.0
        self.v_rad = 0.5 * math.pi
        self.prism_constant_m = 0.0
        self.edm_mode = STANDARD_MODE
        self.air = Air()
        self.locked: int | None = None
        self.last: TelescopeReading | None = None
        self._busy_until_s: float | None = None
        self._knocked_rad = 0.0

    @property
    def face(self) -> int:
        """0 is face I, 1 is face II."""
        return 0 if self.v_rad <= math.pi else 1

    def angles(self) -> tuple[float, float]:
        """Hz and V that the circles read now; they follow a locked reflector."""
        if self.locked is not None:
            self._point_at(self._sightings()[self.locked])
        return self.hz_rad, self.v_rad

    def turn_to(self, hz_rad: float, v_rad: float) -> None:
        """Turn; takes rig time."""
        self.locked = None
        hz_rad, v_rad = hz_rad % TWO_PI, v_rad % TWO_PI
        way_rad = max(abs(hz_difference(hz_rad, self.hz_rad)), abs(v_rad - self.v_rad))
        self._clock.sleep_s(_TURN_START_S + way_rad / _TURN_RATE_RAD_PER_S)
        self.hz_rad, self.v_rad = hz_rad, v_rad

    def change_face(self) -> None:
        """Turn to the other face."""
        self.turn_to(self.hz_rad + math.pi, TWO_PI - self.v_rad)

    def aim(self, width_rad: float = ATR_WINDOW_RAD, height_rad: float = ATR_WINDOW_RAD) -> int:
        """Point finely at the reflector nearest to the line of sight in a window of full width and height.

        Returns the index of the SMR. Raises AimError: none there, or two that cannot be told apart.
        """
        self._clock.sleep_s(_FINE_ADJUST_S)
        seen = self._sightings()
        hz, v = self._line_of_sight()
        if self._faults.strikes("tracker-no-target"):
            raise AimError(NO_TARGET)
        inside = [
            s
            for s in seen
            if s.visible
            and abs(hz_difference(s.polar.hz_rad, hz)) <= 0.5 * width_rad
            and abs(s.polar.v_rad - v) <= 0.5 * height_rad
        ]
        if not inside:
            raise AimError(NO_TARGET)
        nearest = min(inside, key=lambda s: direction_between(s.polar, hz, v))
        if self._faults.strikes("tracker-wrong-nest"):
            others = [s for s in seen if s is not nearest]
            nearest = min(others, key=lambda s: direction_between(s.polar, hz, v))
        spot = nearest.polar
        near = [s for s in seen if s.visible and direction_between(s.polar, spot.hz_rad, spot.v_rad) < _NEIGHBOUR_RAD]
        if len(near) > 1:
            raise AimError(MULTIPLE_TARGETS)
        self._point_at(nearest)
        return nearest.smr

    def lock_in(self) -> None:
        """Follow the reflector that is aimed at. Raises AimError."""
        target = self._in_line(self._sightings())
        if target is None:
            raise AimError(NO_LOCK)
        self.locked = target.smr

    def start_measurement(self) -> None:
        """Begin a distance measurement; `finish` ends it."""
        self.last = None
        self._busy_until_s = self._clock.now_s() + self.duration_s()

    def clear(self) -> None:
        """Forget the last measurement and stop one under way."""
        self.last = None
        self._busy_until_s = None

    def finish(self, wait_s: float) -> TelescopeReading | None:
        """The measurement that was begun, waiting for it no longer than `wait_s`; None if there is none.

        Raises AimError if no reflector was in the line of sight.
        """
        if self._busy_until_s is not None:
            left_s = self._busy_until_s - self._clock.now_s()
            self._clock.sleep_s(min(left_s, wait_s))
            if left_s > wait_s:
                return None
            middle_s = self._busy_until_s - 0.5 * self.duration_s()
            self._busy_until_s = None
            self.last = self._measure(middle_s)
        return self.last

    def measure(self) -> TelescopeReading | None:
        """Begin a measurement and wait for its end. Raises AimError."""
        self.start_measurement()
        return self.finish(self.duration_s())

    def duration_s(self) -> float:
        """How long a measurement lasts in the present distance mode."""
        return _DURATION_S.get(self.edm_mode, _STANDARD_S)

    def ppm_set(self) -> float:
        """The correction that the station applies."""
        return ppm(self.air.dry_c, self.air.pressure_hpa, wet_c=self.air.wet_c)

    def _measure(self, t_s: float) -> TelescopeReading:
        if self._faults.strikes("tracker-drift"):
            self._knocked_rad = _KNOCK_RAD
        seen = self._sightings_at(t_s)
        if self._faults.strikes("tracker-beam-break"):
            self.locked = None
            raise AimError(ANGLE_OK)
        if self.locked is not None and not seen[self.locked].visible:
            self.locked = None
        target = seen[self.locked] if self.locked is not None else self._in_line(seen)
        if target is None:
            raise AimError(ANGLE_OK)
        noise = self._plant.reading_noise(target.smr, t_s)
        hz, v = self._readings(target.polar)
        return TelescopeReading(
            (hz + noise.hz_rad / math.sin(target.polar.v_rad)) % TWO_PI,
            v + noise.v_rad,
            self._distance(target.polar.distance_m, noise.distance_m, t_s),
            t_s,
        )

    def _distance(self, true_m: float, noise_m: float, t_s: float) -> float:
        view, thermal = self._plant.view, self._plant.thermal
        ppm_air = ppm(thermal.air_c(t_s), thermal.pressure_hpa(t_s), humidity=thermal.humidity())
        raw_m = true_m * view.range_scale + view.range_constant_m + noise_m
        return raw_m * (1.0 + (self.ppm_set() - ppm_air) * 1.0e-6) + self.prism_constant_m

    def _sightings(self) -> list[Sighting]:
        return self._sightings_at(self._clock.now_s())

    def _sightings_at(self, t_s: float) -> list[Sighting]:
        """What the plant shows, seen from a stand that may have been knocked."""
        seen = self._plant.sightings(t_s)
        if not self._knocked_rad:
            return seen
        return [replace(s, polar=replace(s.polar, hz_rad=(s.polar.hz_rad + self._knocked_rad) % TWO_PI)) for s in seen]

    def _in_line(self, seen: list[Sighting]) -> Sighting | None:
        hz, v = self._line_of_sight()
        in_sight = [s for s in seen if s.visible]
        if not in_sight:
            return None
        nearest = min(in_sight, key=lambda s: direction_between(s.polar, hz, v))
        return nearest if direction_between(nearest.polar, hz, v) <= LINE_OF_SIGHT_RAD else None

    def _point_at(self, target: Sighting) -> None:
        self.hz_rad, self.v_rad = self._readings(target.polar)

    def _readings(self, polar: Polar) -> tuple[float, float]:
        """What the circles read in the present face when a direction is aimed at."""
        errors = self._plant.settings.instrument
        side = errors.collimation_rad / math.sin(polar.v_rad)
        if self.face == 0:
            return (polar.hz_rad + side) % TWO_PI, polar.v_rad + errors.vertical_index_rad
        return (polar.hz_rad + math.pi - side) % TWO_PI, TWO_PI - polar.v_rad + errors.vertical_index_rad

    def _line_of_sight(self) -> tuple[float, float]:
        """The direction looked at as face I angles; the face errors are far below any window."""
        if self.face == 0:
            return self.hz_rad, self.v_rad
        return (self.hz_rad + math.pi) % TWO_PI, TWO_PI - self.v_rad
