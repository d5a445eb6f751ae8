"""One effect by itself: drives that are moved as a test says, temperatures that a test gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mock_devices.effects import SPECS, EffectChoice, EffectError
from mock_devices.effects.base import Deviation, Site, StationSight
from mock_devices.effects.catalogue import make
from mock_devices.effects.in_space import check_in_space
from mock_devices.machine_file import read_machine_file
from mock_devices.plant.affected_machine import motion_states
from mock_devices.plant.motion_history import MotionHistory
from mock_devices.recordings.design import DesignOptions, draw_design
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.settings import MockSettings
from mock_devices.spatial_file import read_spatial_machine

MACHINE = Path(__file__).parents[2] / "calibration" / "machine" / "data" / "planar4.toml"
FILE = read_machine_file(MACHINE)
STATION_M = (0.0, 0.3, 3.2)
HOME_M = 1.1


class Temperatures:
    """Every part and the air at `of(t)` degrees."""

    def __init__(self, of=lambda t: np.full_like(t, 20.0)):
        self._of = of

    def part_series_c(self, _name, t_s):
        return self._of(np.asarray(t_s, dtype=float))

    def air_series_c(self, t_s):
        return self._of(np.asarray(t_s, dtype=float))

    def pressure_series_hpa(self, t_s):
        return np.full_like(np.asarray(t_s, dtype=float), 1000.0)


class Alone:
    """An effect and the drives' motions. `move` waits until the drive stands; time goes on by itself."""

    def __init__(self, name, size, *, place="", variant="", seed=1, temperatures=None, start_s=0.0, **parameters):
        choice = EffectChoice(name, size, place, variant, tuple(parameters.items()))
        self.effect = make(choice, Site(FILE, STATION_M, start_s), seed)
        self.history = MotionHistory((HOME_M, HOME_M), [self.effect], start_s)
        self.q = [HOME_M, HOME_M]
        self.t_s = start_s
        self.temperatures = temperatures or Temperatures()

    def move(self, drive, to_m, *, speed=0.5, rest_s=1.0):
        end_s = self.t_s + abs(to_m - self.q[drive]) / speed
        self.history.add(drive, self.t_s, end_s, to_m, speed)
        self.q[drive] = to_m
        self.t_s = end_s + rest_s

    def distance_off_m(self, target_m, t_s):
        """By how much a station reads distances (n,) to a point (3,) wrongly at times (n,), the drives at home."""
        points = np.repeat(np.asarray(target_m)[None, None], len(t_s), axis=0)
        distance = np.linalg.norm(points, axis=-1)
        seen = StationSight(points, np.zeros_like(distance), np.zeros_like(distance), distance.copy())
        self.effect.apply_to_sight(self.motion_states(t_s, q=np.full((len(t_s), 2), HOME_M)), seen)
        return (seen.distance_m - distance)[:, 0]

    def motion_states(self, t_s=None, *, q=None, payload_kg=0.0, velocity=(0.0, 0.0), exchanges=0.0):
        t = np.atleast_1d(self.t_s if t_s is None else t_s).astype(float)
        n = len(t)
        at = np.tile(self.q, (n, 1)) if q is None else np.asarray(q, dtype=float)
        fixed = [np.full(n, value) for value in (payload_kg, exchanges)]
        return motion_states(self.history, t, at, np.tile(velocity, (n, 1)), *fixed, self.temperatures)

    def deviation(self, *args, **kinds) -> Deviation:
        m = self.motion_states(*args, **kinds)
        d = Deviation.none(len(m), FILE)
        self.effect.act(m, d)
        return d

    def travel_m(self, drive=0, **kinds):
        return float(self.deviation(**kinds).travel_m[0, drive])


def sight_of(points_m):
    """What a station sees of points (n, smrs, 3) in its own frame."""
    distance = np.linalg.norm(points_m, axis=-1)
    hz = np.arctan2(points_m[..., 0], points_m[..., 1])
    return StationSight(points_m.copy(), hz, np.arccos(points_m[..., 2] / distance), distance)


def travel(one, at_m, drive=0, **kinds):
    """Displacement (n,) of a slider at places."""
    t = kinds.pop("t_s", one.t_s)
    return one.deviation(t_s=np.full(len(at_m), t), q=along(at_m, drive), **kinds).travel_m[:, drive]


def drawn(name, variant, attribute, *, low, high):
    """What an effect has drawn: it is in its range, and another seed draws another one."""
    one, other = (getattr(Alone(name, 1e-5, variant=variant, seed=seed).effect, attribute) for seed in (1, 2))
    assert one != other
    assert low <= one <= high
    assert low <= other <= high
    return one


def amplitude(off_m, at_m, period_m):
    """Complex amplitude of a sine of a period in samples at places that cover whole periods."""
    return complex(2.0 * np.mean(off_m * np.exp(-2j * np.pi * at_m / period_m)))


def along(positions_m, drive=0):
    """Drive positions (n, 2) with one drive at many places."""
    q = np.full((len(positions_m), 2), HOME_M)
    q[:, drive] = positions_m
    return q


def bench(*, seed=4, visits=40, fly_share=0.0, platform_only=False, **settings):
    options = DesignOptions(visits=visits, poses=30, fly_share=fly_share, platform_only=platform_only)
    design = draw_design(FILE, np.random.default_rng(seed), options)
    return SimulatedCampaign(MACHINE, MockSettings(seed=seed, **settings), design)


def assert_machine_in_space_has(effect, machine, *, has):
    """A shipped machine in space has an effect, or refuses it."""
    file = read_spatial_machine(MACHINE.with_name(f"{machine}.toml"))
    choice = EffectChoice(effect, SPECS[effect].size.typical)
    if has:
        check_in_space(choice, file)
        return
    with pytest.raises(EffectError, match="does not have it"):
        check_in_space(choice, file)


def assert_drawn_by_seed(name, attribute):
    """What an effect draws is the same with the same seed, and another with another."""
    one, same, other = (
        getattr(Alone(name, SPECS[name].size.middle, seed=seed).effect, attribute) for seed in (3, 3, 5)
    )
    assert one == same
    assert one != other
