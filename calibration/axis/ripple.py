"""Periods over position, without a gap: the periodogram of the gap under coloured noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.axis.likelihood import AxisLikelihood
from calibration.axis.noise import cosines
from calibration.axis.signals import Signals
from calibration.diagnosis.periodogram import CELLS_PER_PERIOD, OVERSAMPLING, SHORTEST_M, Periodogram

MOST_CELLS = 2**25  # of a periodogram's grid: a turn, or ten metres, in half micrometres
PROBES = 48  # frequencies at which the information of a wave is computed; it changes little between them


def strongest_periods(
    likelihood: AxisLikelihood, signals: Signals, shortest: float, longest: float
) -> Sequence[tuple[float, float]]:
    """Periods of the highest peaks of the likelihood ratio between two limits, with prior probabilities.

    A wave's information depends on how fast it passes, since noise is coloured.
    """
    shortest = max(shortest, SHORTEST_M)
    finest = finest_period(signals.travel, shortest)
    raw = Periodogram.from_scores(signals.position, likelihood.weighted_residual(), 1.0, finest)
    probes = np.geomspace(0.5 / longest, 2.0 / shortest, PROBES)
    phase = 2.0 * np.pi * np.outer(signals.position, probes)
    of_columns = cosines(np.concatenate([np.cos(phase), np.sin(phase)], axis=1))
    information = np.sum(of_columns**2 / likelihood.power[:, None], axis=0)
    both = information[:PROBES] + information[PROBES:]
    at = np.exp(np.interp(np.log(np.maximum(raw.frequency, probes[0])), np.log(probes), np.log(both)))
    return replace(raw, power=raw.power / at).strongest_periods(shortest, longest)


def finest_period(travel: float, shortest: float) -> float:
    """Period down to which a periodogram over a travel is computed, its grid being bounded.

    Over a long travel it is as fine as the samples are: periods below the shortest are not asked for.
    """
    bound = OVERSAMPLING * CELLS_PER_PERIOD * travel / MOST_CELLS
    return SHORTEST_M if bound <= SHORTEST_M else max(shortest, bound)
