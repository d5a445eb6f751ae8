"""Alternatives without any physics: something acts at a channel and depends on a coordinate, in whatever form.

Where they explain more than the catalogue, the effect is unknown, and they say where it lives and on what it depends.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from calibration.effects.base import Forms, Setting
from calibration.gap.channels import Channels
from calibration.gap.evidence import Readout
from calibration.gap.shapes import brownian, products, smooth
from calibration.machine import Array

WITHOUT_VISITS = ("light.", "station.", "floor.", "smr.")
REST_S = 6.0
SMALLEST_SIGMA, LARGEST_SIGMA = 0.5, 60.0


@dataclass(frozen=True)
class Alternative:
    """Something at channels that depends on a coordinate ('time', 'place', 'direction', 'rest', 'load', 'visit')."""

    channel: str
    coordinate: str
    forms: Forms
    low: float
    high: float


def alternatives(setting: Setting, readout: Readout, tried: Collection[str]) -> Iterator[Alternative]:
    """All of them but those of single visits; of the machine's channels only those that are to be tried."""
    shared = _shared(setting)
    for group in _groups(setting, readout.channels):
        if not group[0].startswith(WITHOUT_VISITS) and group[0] not in tried:
            continue
        own = dict(shared)
        drive = _drive_of(setting, group[0])
        if drive is not None:
            own |= _of_drive(setting, drive)
        elif group[0].startswith("length."):
            strut = setting.machine.strut_names.index(group[0].split(".")[1])
            own |= _of_drive(setting, max(int(setting.machine.strut_drive[strut]), 0))
        elif group[0].startswith(WITHOUT_VISITS):
            own = {"time": shared["time"]} | ({"place": _sight(setting)} if group[0].startswith("light") else {})
        for coordinate, shapes in own.items():
            yield _alternative(readout, group, coordinate, shapes)


def of_visits(setting: Setting, readout: Readout) -> Iterator[Alternative]:
    """Every visit on its own: whatever a reading's visit has in common and no coordinate explains."""
    arrival = setting.moments.arrival
    each = (arrival[:, None] == np.arange(int(arrival.max()) + 1)).astype(np.float64)
    for group in _groups(setting, readout.channels):
        if not group[0].startswith(WITHOUT_VISITS):
            yield _alternative(readout, group, "visit", each)


def _alternative(readout: Readout, group: tuple[str, ...], coordinate: str, shapes: Array) -> Alternative:
    f = Forms()
    rms = [max(float(np.sqrt(np.mean(readout.response(c) ** 2))), 1e-300) for c in group]
    # Each channel of a group in its own unit: relative to what one sigma of it is.
    columns = [k for c, r in zip(group, rms, strict=True) for k in f.add((c, shapes * (rms[0] / r)))]
    f.form(columns)
    return Alternative(group[0], coordinate, f, SMALLEST_SIGMA / rms[0], LARGEST_SIGMA / rms[0])


def _groups(setting: Setting, channels: Channels) -> Iterator[tuple[str, ...]]:
    machine = setting.machine
    for a, drive in enumerate(machine.drive_names):
        yield (f"travel.{drive}",)
        yield from ((c,) for c in (*channels.sideways(a), *channels.turns(a)))
    yield from ((f"length.{strut}",) for strut in machine.strut_names)
    yield from ((c,) for c in channels.poses())
    platform = [i for i, smr in enumerate(machine.smrs) if smr.on == "platform"]
    yield from (channels.smrs(i) for i in platform)
    yield tuple(c for i in platform for c in channels.smrs(i))
    yield channels.stations()
    yield channels.floors()
    yield ("light.v",)
    yield ("light.hz",)


def _drive_of(setting: Setting, channel: str) -> int | None:
    kind, _, rest = channel.partition(".")
    if kind not in ("travel", "sideways", "turn"):
        return None
    return setting.machine.drive_names.index(rest.split(".")[0])


def _with_load(setting: Setting, shapes: Array) -> Array:
    """The same, and larger or smaller under load."""
    return np.concatenate([shapes, shapes * (setting.load - 0.5)[:, None]], axis=1)


def _shared(setting: Setting) -> dict[str, Array]:
    """Functions of what all channels share: time, side, rest and speed, load, place of the platform."""
    m = setting.moments
    t = m.elapsed_s / max(float(m.elapsed_s.max()), 1.0)
    speed = m.speed_m_per_s / max(float(m.speed_m_per_s.max()), 1e-9)
    rest = np.stack([np.exp(-m.dwell_s / tau) for tau in (1.5, REST_S, 4.0 * REST_S)], axis=1)
    moved = np.concatenate([rest, rest * speed[:, None], rest * np.sqrt(speed)[:, None], speed[:, None]], axis=1)
    sides = m.direction
    places = [smooth(q, 4, roughness=1.0, constant=True) for q in m.drives.T]
    place = places[0]
    for other in places[1:]:
        place = products(place, other)[:, :40]
    return {
        "time": _with_load(setting, np.concatenate([brownian(t, 40), smooth(t, 6)], axis=1)),
        "direction": _with_load(setting, sides),
        "rest": np.concatenate([moved, products(sides, moved)], axis=1),
        "load": np.stack([setting.load, setting.load**2], axis=1),
        "place": _with_load(setting, place[:, 1:]),
        "direction and place": products(sides, place),
        "time and place": products(brownian(t, 24), place[:, :5]),
    }


def _of_drive(setting: Setting, drive: int) -> dict[str, Array]:
    q = setting.moments.drives[:, drive]
    curve = smooth(q, 16, roughness=1.0)
    return {
        "place": _with_load(setting, curve),
        "direction and place": products(setting.moments.direction[:, drive : drive + 1], curve),
    }


def _sight(setting: Setting) -> Array:
    p = setting.sight_m
    return products(smooth(p[:, 0], 5, roughness=1.0, constant=True), smooth(p[:, 2], 4, roughness=1.0, constant=True))
