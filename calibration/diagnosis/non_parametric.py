"""Non-parametric alternatives: an arbitrary function of one coordinate that acts through one or several channels.

If they explain more than the catalogue, the effect is unknown; their channel and coordinate then tell where to look.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.arbitrary_functions import functions_for_all_channels, functions_of_drive, functions_of_sight
from calibration.diagnosis.basis_set_evidence import log_evidence_of_sizes, log_sum
from calibration.diagnosis.channels import Channels, alike_but_for_zero
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.effects.api import EffectInputs
from calibration.effects.columns import ColumnsByChannel

REFLECTOR = "smr."
NOT_ON_MACHINE = ("light.", "station.", "floor.", REFLECTOR)
NEGLIGIBLE_RESPONSE = 1e-9  # sigma per unit of a channel
SIZES_SIGMA = np.geomspace(0.5, 60.0, 9)
LEFT_SIGMA = np.geomspace(0.02, 20.0, 40)  # of what may be left from visit to visit
CHANNELS_TRIED = 6  # channels with the largest evidence of shifts per visit, on which all coordinates are tried


@dataclass(frozen=True)
class NonParametricEffect:
    """An arbitrary function of a coordinate ('visit', or one of `arbitrary_functions`), through channels.

    channels: names, each with the amount that moves a reading by one sigma; shapes (n, k): basis functions of the
    coordinate, common to the channels. log_evidence: over `none`; size: the most likely one, in sigma.
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

    def columns(self, likelihood: MarginalLikelihood) -> Array:
        """Whitened columns (n, w, k), each times its prior standard deviation."""
        parts = [
            likelihood.response(name)[:, :, None] * self.shapes[:, None, :] * (self.size * unit)
            for name, unit in self.channels
        ]
        return np.concatenate(parts, axis=2)


def rank_non_parametric(likelihood: MarginalLikelihood, inputs: EffectInputs) -> list[NonParametricEffect]:
    """Non-parametric alternatives, the most likely first.

    First an approximate test with independent shifts per visit at each channel of the machine and each reflector; then
    all coordinates at the machine's channels and at the reflector with the largest evidence.
    """
    groups = list(_channel_groups(inputs, likelihood.channels))
    on_machine = [group for group in groups if _on_machine(group)]
    # Of all reflectors together, which are the last of these groups, the platform's coordinates stand for the shifts.
    reflectors = [group for group in groups if group[0].startswith(REFLECTOR)][:-1]

    def evidence(group: tuple[str, ...]) -> float:
        return evidence_of_shifts_by_visit(likelihood, group)

    tried_on_machine = sorted(on_machine, key=evidence, reverse=True)[:CHANNELS_TRIED]
    tried_groups = tried_on_machine + sorted(reflectors, key=evidence, reverse=True)[:1]
    by_visit = visit_indicators(inputs)
    # Not at a reflector: to lie elsewhere at each visit is an effect of the catalogue.
    alternatives = [
        _non_parametric_evidence(likelihood, inputs, group, "visit", by_visit) for group in tried_on_machine
    ]
    alternatives += [
        _non_parametric_evidence(likelihood, inputs, group, coordinate, shapes)
        for group, coordinate, shapes in _alternatives(inputs, likelihood.channels, tried_groups)
    ]
    return sorted(alternatives, key=lambda alternative: -alternative.log_evidence)


def largest_evidence_by_visit(likelihood: MarginalLikelihood, inputs: EffectInputs) -> float:
    """The largest approximate log evidence of shifts per visit, of all groups of channels of the machine and its
    reflectors: of noise alone none is above zero but by chance."""
    groups = [g for g in _channel_groups(inputs, likelihood.channels) if g[0].startswith(REFLECTOR) or _on_machine(g)]
    return max(evidence_of_shifts_by_visit(likelihood, group) for group in groups)


def _on_machine(group: tuple[str, ...]) -> bool:
    return not group[0].startswith(NOT_ON_MACHINE)


def visit_indicators(inputs: EffectInputs) -> Array:
    """Which readings are of each visit (n, v): 1, the others 0."""
    arrival = inputs.context.arrival
    return inputs.once("by visit", lambda: (arrival[:, None] == np.arange(int(arrival.max()) + 1)).astype(np.float64))


def _log_evidence_by_visit(likelihood: MarginalLikelihood, channel: str, sizes_sigma: Array) -> Array:
    """Log evidence (a,) of shifts per visit at a channel, approximated as independent, for each size (a,)."""
    information, score = likelihood.information_by_visit(channel)
    square = (sizes_sigma[:, None] * channel_unit(likelihood, channel)) ** 2
    grown = 1.0 + square * information
    return np.asarray(np.sum(0.5 * square * score**2 / grown - 0.5 * np.log(grown), axis=1))


def evidence_of_shifts_by_visit(likelihood: MarginalLikelihood, channels: Iterable[str]) -> float:
    """Approximate log evidence of independent shifts per visit at each of some channels."""
    return sum(float(log_sum(_log_evidence_by_visit(likelihood, channel, SIZES_SIGMA))) for channel in channels)


def log_evidence_at_platform(likelihood: MarginalLikelihood, sizes_sigma: Array) -> Array:
    """Log evidence (c, a) of shifts per visit at each coordinate of the platform, for each size (a,)."""
    channels = likelihood.channels.pose_channels()
    return np.array([_log_evidence_by_visit(likelihood, channel, sizes_sigma) for channel in channels])


def left_at_platform(likelihood: MarginalLikelihood) -> Array:
    """Expected square (c,) of shifts per visit at each coordinate of the platform that the model does not have, in the
    coordinate's units: as likely to be there as not, of any size."""
    logs = log_evidence_at_platform(likelihood, LEFT_SIGMA) - np.log(len(LEFT_SIGMA))
    there = np.exp(logs - np.logaddexp(log_sum(logs, axis=1), 0.0)[:, None])
    units = [channel_unit(likelihood, channel) for channel in likelihood.channels.pose_channels()]
    return np.asarray(there @ LEFT_SIGMA**2 * np.array(units) ** 2)


def channel_unit(likelihood: MarginalLikelihood, channel: str) -> float:
    """The amount of a channel that moves the readings by one standard deviation RMS; zero if no reading responds."""
    rms = float(np.sqrt(np.mean(likelihood.response(channel) ** 2)))
    return 1.0 / rms if rms > NEGLIGIBLE_RESPONSE else 0.0


def _units(likelihood: MarginalLikelihood, group: tuple[str, ...]) -> dict[str, float]:
    """Units of channels that are tried together."""
    out = dict[str, float]()
    for names in alike_but_for_zero(group):
        units = np.array([channel_unit(likelihood, name) for name in names])
        moving = units[units > 0.0]
        out |= dict.fromkeys(names, float(np.mean(moving**-2.0) ** -0.5) if moving.size else 0.0)
    return out


def _non_parametric_evidence(
    likelihood: MarginalLikelihood, inputs: EffectInputs, group: tuple[str, ...], coordinate: str, shapes: Array
) -> NonParametricEffect:
    channels = tuple(_units(likelihood, group).items())
    columns = inputs.once((group, coordinate), lambda: ColumnsByChannel.through(channels, shapes))
    logs = log_evidence_of_sizes(likelihood.kept_information_and_score(columns), SIZES_SIGMA)
    evidence = float(log_sum(logs) - np.log(len(logs)))
    return NonParametricEffect(channels, coordinate, shapes, evidence, float(SIZES_SIGMA[int(np.argmax(logs))]))


def _alternatives(
    inputs: EffectInputs, channels: Channels, tried_groups: list[tuple[str, ...]]
) -> Iterator[tuple[tuple[str, ...], str, Array]]:
    """Channels, coordinate and shapes (n, k); of the machine's channels only `tried_groups`, of others only these with
    all coordinates."""
    common = inputs.once("common", lambda: functions_for_all_channels(inputs))

    def of_drive(drive: int) -> dict[str, Array]:
        return inputs.once(("of drive", drive), lambda: functions_of_drive(inputs, drive))

    for group in _channel_groups(inputs, channels):
        not_on_machine = not _on_machine(group)
        if not not_on_machine and group not in tried_groups:
            continue
        bases = dict(common)
        drive = _drive_of(inputs, group[0])
        if not_on_machine and group not in tried_groups:
            bases = {"time": common["time"]}
            if group[0].startswith("light"):
                bases["place"] = functions_of_sight(inputs)
        elif drive is not None:
            bases |= of_drive(drive)
        elif group[0].startswith("length."):
            strut = inputs.machine.strut_names.index(group[0].split(".")[1])
            bases |= of_drive(max(int(inputs.machine.strut_drive[strut]), 0))
        for coordinate, shapes in bases.items():
            yield group, coordinate, shapes


def _channel_groups(inputs: EffectInputs, channels: Channels) -> Iterator[tuple[str, ...]]:
    """Channels that are tried together, such as all coordinates of a reflector."""
    machine = inputs.machine
    for a, drive in enumerate(machine.drive_names):
        yield (f"travel.{drive}",)
        yield from ((c,) for c in (*channels.sideways_channels(a), *channels.rotation_channels(a)))
    yield from ((f"length.{strut}",) for strut in machine.strut_names)
    yield from ((c,) for c in channels.pose_channels())
    yield from ((c,) for c in channels.force_channels())
    if machine.planar:  # elsewhere six at a time would take too long
        yield channels.force_channels()
    if not channels.observed.by_station:
        return
    platform = [i for i, smr in enumerate(machine.smrs) if smr.on == "platform"]
    yield from (channels.reflector_channels(i) for i in platform)
    yield tuple(c for i in platform for c in channels.reflector_channels(i))
    yield channels.station_channels()
    yield channels.floor_channels()
    yield ("light.v",)
    yield ("light.hz",)
    yield ("light.range",)


def _drive_of(inputs: EffectInputs, channel: str) -> int | None:
    kind, _, place = channel.partition(".")
    if kind not in ("travel", "sideways", "turn"):
        return None
    return inputs.machine.drive_names.index(place.split(".")[0])
