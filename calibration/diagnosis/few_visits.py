"""What is off at few visits only, and at all others as it should be: a drive that lost counts, somebody who leaned on
the machine. No law over a coordinate does that, but one with enough freedom comes near it at the visits that it is off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import log_evidence_of_sizes, log_sum
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.non_parametric import NonParametricEffect, channel_unit
from calibration.diagnosis.search import SearchResult
from calibration.diagnosis.settings import VERDICT

FEW_VISITS = "few visits"  # as a coordinate
SHARE = 0.02  # of the visits, that are expected to be off where some are
MOST_SHARE, LEAST = 0.05, 2  # of the visits, and at least so many: more are no few
SIZES_SIGMA = np.geomspace(0.5, 500.0, 13)
CHANNELS_TRIED = 2


@dataclass(frozen=True)
class AtFewVisits(NonParametricEffect):
    """A displacement at few visits: their numbers in the source, and by how much the channel is off at each, in unit
    ("m" or "rad")."""

    visits: tuple[int, ...] = ()
    off: tuple[float, ...] = ()
    unit: str = "m"


def or_at_few_visits(result: SearchResult, likelihood: MarginalLikelihood) -> SearchResult:
    """What a search found; with what is off at few visits as the alternative that alone explains most, if it does.

    likelihood: without any cause. Of two explanations that differ by less than a model's error that is the simpler one.
    """
    alternative = at_few_visits(likelihood)
    explained = result.log_evidence
    model_error = float(VERDICT.threshold_of_excess(explained) - VERDICT.threshold_of_excess(0.0))
    excess = alternative.log_evidence - explained + model_error
    if alternative.log_evidence <= 0.0 or excess <= result.excess_log_evidence:
        return result
    return replace(
        result,
        excess_log_evidence=excess,
        non_parametric=result.non_parametric or (alternative,),
        non_parametric_alone=(alternative, *result.non_parametric_alone),
    )


def at_few_visits(likelihood: MarginalLikelihood) -> AtFewVisits:
    """The most likely displacement of a drive, a strut or the platform at few visits, its evidence less what it costs
    that any visits could be those: each is off by chance with a probability of SHARE."""
    machine, channels = likelihood.linear.machine, likelihood.channels
    names = [f"travel.{drive}" for drive in machine.drive_names]
    names += [*(f"length.{strut}" for strut in machine.strut_names), *channels.pose_channels()]
    likeliest = sorted(names, key=lambda name: -_evidence_of_single_visits(likelihood, name))[:CHANNELS_TRIED]
    return max((_at_channel(likelihood, name) for name in likeliest), key=lambda found: found.log_evidence)


def _gains(likelihood: MarginalLikelihood, channel: str) -> Array:
    """Log evidence (a, v) of a shift of each size at each visit alone."""
    information, score = likelihood.information_by_visit(channel)
    square = (SIZES_SIGMA[:, None] * channel_unit(likelihood, channel)) ** 2
    grown = 1.0 + square * information
    return np.asarray(0.5 * square * score**2 / grown - 0.5 * np.log(grown))


def _evidence_of_single_visits(likelihood: MarginalLikelihood, channel: str) -> float:
    """That some visits are off, as if the calibration did not tie them together."""
    gains = _gains(likelihood, channel)
    return float(np.max(np.sum(np.logaddexp(np.log1p(-SHARE), np.log(SHARE) + gains), axis=1)))


def _at_channel(likelihood: MarginalLikelihood, channel: str) -> AtFewVisits:
    arrival, unit = likelihood.linear.context.arrival, channel_unit(likelihood, channel)
    count = int(arrival.max()) + 1
    response, chosen, given = likelihood.response(channel), list[int](), likelihood
    most = max(LEAST, int(MOST_SHARE * count))
    while len(chosen) < most:
        gains = np.max(_gains(given, channel), axis=0)
        gains[chosen] = -np.inf
        worst = int(np.argmax(gains))
        if gains[worst] + np.log(SHARE) - np.log1p(-SHARE) <= 0.0:
            break
        chosen.append(worst)
        column = (response * (arrival == worst)[:, None])[:, :, None] * (SIZES_SIGMA[-1] * unit)
        given = given.including(column)
    chosen.sort()
    shapes = (arrival[:, None] == np.array(chosen, dtype=np.intp)).astype(np.float64)
    by_chance = len(chosen) * np.log(SHARE) + (count - len(chosen)) * np.log1p(-SHARE)
    if not chosen:
        return AtFewVisits(((channel, unit),), FEW_VISITS, shapes, float(by_chance), 0.0)
    columns = likelihood.information_and_score([((channel, unit * shape),) for shape in shapes.T])
    logs = log_evidence_of_sizes(columns, SIZES_SIGMA)
    evidence = float(log_sum(logs) - np.log(len(logs)) + by_chance)
    size = float(SIZES_SIGMA[int(np.argmax(logs))])
    off = unit * np.linalg.solve(columns.information + np.eye(len(chosen)) / size**2, columns.score)
    rotary = {f"travel.{drive}" for drive in likelihood.linear.machine.rotary_drives}
    turns = "rad" if channel in rotary or channel.startswith("pose.r") else "m"
    number, responds = likelihood.linear.visit_number, np.any(response, axis=1)
    visits = tuple(int(number[np.argmax(responds * shape)]) for shape in shapes.T)
    return AtFewVisits(((channel, unit),), FEW_VISITS, shapes, evidence, size, visits, tuple(off.tolist()), turns)
