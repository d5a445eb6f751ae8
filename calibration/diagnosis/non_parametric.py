"""Alternatives without any physics: something acts at a channel and depends on a coordinate, in whatever form.

Where they explain more than the catalogue, the effect is unknown, and they say where it lives and on what it depends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.evidence import Readout, log_evidence_of_sizes, log_sum
from calibration.effects.api import Setting
from calibration.effects.basis_functions import brownian, products, smooth

WITHOUT_VISITS = ("light.", "station.", "floor.", "smr.")
UNSEEN = 1e-9  # sigma a unit of a channel
REST_S = 6.0
SIZES_SIGMA = np.geomspace(0.5, 60.0, 9)
CHANNELS_TRIED = 4  # coordinates are tried where single visits stand out most


@dataclass(frozen=True)
class Formless:
    """Something at channels that depends on a coordinate ('time', 'place', 'direction', 'rest', 'load', 'visit').

    channels: names, each with what is one sigma of it; shapes (n, k): functions of the coordinate, common to them.
    log_evidence: over `none`; size: the likeliest, in sigma.
    """

    channels: tuple[tuple[str, float], ...]
    coordinate: str
    shapes: Array
    log_evidence: float
    size: float

    @property
    def channel(self) -> str:
        """The first of its channels."""
        return self.channels[0][0]

    def columns(self, readout: Readout) -> Array:
        """Whitened columns (n, 3, k), each times its prior standard deviation."""
        parts = [
            readout.response(name)[:, :, None] * self.shapes[:, None, :] * (self.size * unit)
            for name, unit in self.channels
        ]
        return np.concatenate(parts, axis=2)


def weigh_formless(readout: Readout, setting: Setting) -> list[Formless]:
    """Form-free alternatives, the likeliest first.

    Every visit on its own at each channel, roughly; then all coordinates at the channels where that says most.
    """
    each = _each_visit(setting)
    machines = [group for group in _groups(setting, readout.channels) if not group[0].startswith(WITHOUT_VISITS)]
    machines.sort(key=lambda group: -log_sum(_of_single_visits(readout, group[0], setting, SIZES_SIGMA)))
    tried = machines[:CHANNELS_TRIED]
    found = [_weighed(readout, group, "visit", each) for group in tried]
    found += [
        _weighed(readout, group, coordinate, shapes)
        for group, coordinate, shapes in _alternatives(setting, readout.channels, tried)
    ]
    return sorted(found, key=lambda f: -f.log_evidence)


def _each_visit(setting: Setting) -> Array:
    arrival = setting.moments.arrival
    return (arrival[:, None] == np.arange(int(arrival.max()) + 1)).astype(np.float64)


def _of_single_visits(readout: Readout, channel: str, setting: Setting, sizes_sigma: Array) -> Array:
    """Logarithm (a,) of the evidence of single visits at a channel, as if independent of one another, by size (a,)."""
    information, score = readout.by_visit(channel, setting.moments.arrival)
    square = (sizes_sigma[:, None] * _sigma(readout, channel)) ** 2
    grown = 1.0 + square * information
    return np.asarray(np.sum(0.5 * square * score**2 / grown - 0.5 * np.log(grown), axis=1))


def platform_hides(readout: Readout, setting: Setting, sizes_sigma: Array) -> Array:
    """The same (c, a) at each coordinate of the platform."""
    return np.array([_of_single_visits(readout, c, setting, sizes_sigma) for c in readout.channels.poses()])


def _sigma(readout: Readout, channel: str) -> float:
    """What of a channel moves a reading by one standard deviation, RMS; zero where nothing sees it."""
    rms = float(np.sqrt(np.mean(readout.response(channel) ** 2)))
    return 1.0 / rms if rms > UNSEEN else 0.0


def _weighed(readout: Readout, group: tuple[str, ...], coordinate: str, shapes: Array) -> Formless:
    channels = tuple((name, _sigma(readout, name)) for name in group)
    logs = log_evidence_of_sizes(readout.judge_through(channels, shapes), SIZES_SIGMA)
    evidence = float(log_sum(logs) - np.log(len(logs)))
    return Formless(channels, coordinate, shapes, evidence, float(SIZES_SIGMA[int(np.argmax(logs))]))


def _alternatives(
    setting: Setting, channels: Channels, tried: list[tuple[str, ...]]
) -> Iterator[tuple[tuple[str, ...], str, Array]]:
    """Channels, coordinate and shapes; of the machine's channels only those that are to be tried."""
    shared = _shared(setting)
    for group in _groups(setting, channels):
        elsewhere = group[0].startswith(WITHOUT_VISITS)
        if not elsewhere and group not in tried:
            continue
        own = dict(shared)
        drive = _drive_of(setting, group[0])
        if elsewhere:
            own = {"time": shared["time"]} | ({"place": _sight(setting)} if group[0].startswith("light") else {})
        elif drive is not None:
            own |= _of_drive(setting, drive)
        elif group[0].startswith("length."):
            strut = setting.machine.strut_names.index(group[0].split(".")[1])
            own |= _of_drive(setting, max(int(setting.machine.strut_drive[strut]), 0))
        for coordinate, shapes in own.items():
            yield group, coordinate, shapes


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
        "time": _with_load(setting, np.concatenate([brownian(t, 28), smooth(t, 4)], axis=1)),
        "direction": _with_load(setting, sides),
        "rest": np.concatenate([moved, products(sides, moved)], axis=1),
        "load": np.stack([setting.load, setting.load**2], axis=1),
        "place": _with_load(setting, place[:, 1:]),
        "direction and place": products(sides, place),
        "time and place": products(brownian(t, 12), place[:, :5]),
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
