"""Non-parametric alternatives: an arbitrary function of one coordinate that acts through one or several channels.

If they explain more than the catalogue, the effect is unknown; their channel and coordinate then tell where to look.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import log_evidence_of_sizes, log_sum
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.effects.api import EffectInputs
from calibration.effects.basis_functions import cosine_basis, random_walk_basis, tensor_product
from calibration.effects.columns import ColumnsByChannel

REFLECTOR = "smr."
NOT_ON_MACHINE = ("light.", "station.", "floor.", REFLECTOR)
NEGLIGIBLE_RESPONSE = 1e-9  # sigma per unit of a channel
DWELL_S = 6.0
SIZES_SIGMA = np.geomspace(0.5, 60.0, 9)
LEFT_SIGMA = np.geomspace(0.02, 20.0, 40)  # of what may be left from visit to visit
ASK_FOR = {  # the field of the context without which a coordinate is none
    "time": "t_s", "direction": "direction", "rest": "dwell_s", "direction and place": "direction",
    "time and place": "t_s",
}  # fmt: skip
CHANNELS_TRIED = 6  # channels with the largest evidence of shifts per visit, on which all coordinates are tried


@dataclass(frozen=True)
class NonParametricEffect:
    """An arbitrary function of a coordinate ('time', 'place', 'direction', 'rest', 'load', 'visit'), through channels.

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
    on_machine = [group for group in groups if not group[0].startswith(NOT_ON_MACHINE)]
    # Of all reflectors together, which are the last of these groups, the platform's coordinates stand for the shifts.
    reflectors = [group for group in groups if group[0].startswith(REFLECTOR)][:-1]

    def evidence(group: tuple[str, ...]) -> float:
        return evidence_of_shifts_by_visit(likelihood, group)

    tried_on_machine = sorted(on_machine, key=evidence, reverse=True)[:CHANNELS_TRIED]
    tried_groups = tried_on_machine + sorted(reflectors, key=evidence, reverse=True)[:1]
    by_visit = inputs.once("by visit", lambda: _visit_indicators(inputs))
    # Not at a reflector: to lie elsewhere at each visit is an effect of the catalogue.
    alternatives = [
        _non_parametric_evidence(likelihood, inputs, group, "visit", by_visit) for group in tried_on_machine
    ]
    alternatives += [
        _non_parametric_evidence(likelihood, inputs, group, coordinate, shapes)
        for group, coordinate, shapes in _alternatives(inputs, likelihood.channels, tried_groups)
    ]
    return sorted(alternatives, key=lambda alternative: -alternative.log_evidence)


def _visit_indicators(inputs: EffectInputs) -> Array:
    arrival = inputs.context.arrival
    return (arrival[:, None] == np.arange(int(arrival.max()) + 1)).astype(np.float64)


def _log_evidence_by_visit(likelihood: MarginalLikelihood, channel: str, sizes_sigma: Array) -> Array:
    """Log evidence (a,) of shifts per visit at a channel, approximated as independent, for each size (a,)."""
    information, score = likelihood.information_by_visit(channel)
    square = (sizes_sigma[:, None] * _channel_unit(likelihood, channel)) ** 2
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
    units = [_channel_unit(likelihood, channel) for channel in likelihood.channels.pose_channels()]
    return np.asarray(there @ LEFT_SIGMA**2 * np.array(units) ** 2)


def _channel_unit(likelihood: MarginalLikelihood, channel: str) -> float:
    """The amount of a channel that moves the readings by one standard deviation RMS; zero if no reading responds."""
    rms = float(np.sqrt(np.mean(likelihood.response(channel) ** 2)))
    return 1.0 / rms if rms > NEGLIGIBLE_RESPONSE else 0.0


def _non_parametric_evidence(
    likelihood: MarginalLikelihood, inputs: EffectInputs, group: tuple[str, ...], coordinate: str, shapes: Array
) -> NonParametricEffect:
    channels = tuple((name, _channel_unit(likelihood, name)) for name in group)
    columns = inputs.once((group, coordinate), lambda: ColumnsByChannel.through(channels, shapes))
    logs = log_evidence_of_sizes(likelihood.kept_information_and_score(columns), SIZES_SIGMA)
    evidence = float(log_sum(logs) - np.log(len(logs)))
    return NonParametricEffect(channels, coordinate, shapes, evidence, float(SIZES_SIGMA[int(np.argmax(logs))]))


def _alternatives(
    inputs: EffectInputs, channels: Channels, tried_groups: list[tuple[str, ...]]
) -> Iterator[tuple[tuple[str, ...], str, Array]]:
    """Channels, coordinate and shapes (n, k); of the machine's channels only `tried_groups`, of others only these with
    all coordinates."""
    common = inputs.once("common", lambda: _common_basis_functions(inputs))

    def drive_basis_functions(drive: int) -> dict[str, Array]:
        return inputs.once(("of drive", drive), lambda: _drive_basis_functions(inputs, drive))

    for group in _channel_groups(inputs, channels):
        not_on_machine = group[0].startswith(NOT_ON_MACHINE)
        if not not_on_machine and group not in tried_groups:
            continue
        bases = dict(common)
        drive = _drive_of(inputs, group[0])
        if not_on_machine and group not in tried_groups:
            bases = {"time": common["time"]}
            if group[0].startswith("light"):
                bases["place"] = _line_of_sight_basis(inputs)
        elif drive is not None:
            bases |= drive_basis_functions(drive)
        elif group[0].startswith("length."):
            strut = inputs.machine.strut_names.index(group[0].split(".")[1])
            bases |= drive_basis_functions(max(int(inputs.machine.strut_drive[strut]), 0))
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


def _with_payload_interaction(inputs: EffectInputs, shapes: Array) -> Array:
    """Shapes (n, k), followed by their products with the payload."""
    return np.concatenate([shapes, shapes * (inputs.payload_ratio - 0.5)[:, None]], axis=1)


def _common_basis_functions(inputs: EffectInputs) -> dict[str, Array]:
    """Basis functions for all channels: of time, approach direction, dwell and speed, payload, position."""
    context = inputs.context
    t = context.elapsed_s / max(float(context.elapsed_s.max()), 1.0)
    speed = context.speed_m_per_s / max(float(context.speed_m_per_s.max()), 1e-9)
    decay = np.stack([np.exp(-context.dwell_s / tau) for tau in (1.5, DWELL_S, 4.0 * DWELL_S)], axis=1)
    settling = np.concatenate([decay, decay * speed[:, None], decay * np.sqrt(speed)[:, None], speed[:, None]], axis=1)
    sides = context.direction
    by_drive = [cosine_basis(q, 4, roughness=1.0, constant=True) for q in context.drives.T]
    place = by_drive[0]
    for other in by_drive[1:]:
        place = tensor_product(place, other)[:, :40]
    over_time = np.concatenate([random_walk_basis(t, 28), cosine_basis(t, 4)], axis=1)
    bases = {
        "time": _with_payload_interaction(inputs, over_time),
        "direction": _with_payload_interaction(inputs, sides),
        "rest": np.concatenate([settling, tensor_product(sides, settling)], axis=1),
        "load": np.stack([inputs.payload_ratio, inputs.payload_ratio**2], axis=1),
        "place": _with_payload_interaction(inputs, place[:, 1:]),
        "direction and place": tensor_product(sides, place),
        "time and place": tensor_product(random_walk_basis(t, 12), place[:, :5]),
    }
    return {name: shapes for name, shapes in bases.items() if ASK_FOR.get(name) not in context.missing}


def _drive_basis_functions(inputs: EffectInputs, drive: int) -> dict[str, Array]:
    curve = cosine_basis(inputs.context.drives[:, drive], 16, roughness=1.0)
    bases = {"place": _with_payload_interaction(inputs, curve)}
    if "direction" not in inputs.context.not_said:
        bases["direction and place"] = tensor_product(inputs.context.direction[:, drive : drive + 1], curve)
    return bases


def _line_of_sight_basis(inputs: EffectInputs) -> Array:
    """Basis functions (n, k) of where the measured point is, seen from the station."""
    across, height = inputs.sight_m[:, 0], inputs.sight_m[:, 2]
    return tensor_product(
        cosine_basis(across, 5, roughness=1.0, constant=True), cosine_basis(height, 4, roughness=1.0, constant=True)
    )
