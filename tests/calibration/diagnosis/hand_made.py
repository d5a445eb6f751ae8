"""Evidence made by hand: causes and searches of which nothing but their evidence matters."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from calibration.effects.catalogue import load_catalogue
from calibration.machine.description import load_machine
from tests.calibration.diagnosis.campaigns import PLANAR

CATALOGUE = load_catalogue()
MACHINE = load_machine(PLANAR)


class _Context(SimpleNamespace):
    """Readings of which only the visits matter."""

    def __len__(self) -> int:
        return len(self.arrival)


CONTEXT = _Context(arrival=np.repeat(np.arange(400), 3))
INPUTS = SimpleNamespace(machine=MACHINE, once=lambda _, make: make(), context=CONTEXT)


@dataclass(frozen=True)
class Evidence:
    """A cause of which only the evidence matters, and the channel that it acts through; a share of the verdict's signal
    is left beside it."""

    name: str
    log_evidence: float
    place: str = "left"
    left_of_signal: float = 0.0
    channel: str = "travel.left"
    departure_gain: float = 0.0

    @property
    def contributions(self):
        return (((self.channel, np.ones(1)),),)

    @property
    def channels(self):
        return ((self.channel, 1.0),)

    @property
    def effect(self):
        return CATALOGUE.effect(self.name)

    @property
    def best(self):
        return SimpleNamespace(coefficients=np.ones(1))

    @property
    def parts(self):
        return (self,)


def found(
    *causes: Evidence, explained: float | None = None, excess: float = 0.0, departure_gain: float = 0.0
) -> SimpleNamespace:
    """The result of a search: all evidence, how much is explained, and what departures add of that."""
    explained = max((c.log_evidence for c in causes), default=0.0) if explained is None else explained
    return SimpleNamespace(
        ranking=causes,
        causes=causes[:1],
        log_evidence=explained,
        excess_log_evidence=excess,
        departure_gain=departure_gain,
        non_parametric_alone=(),
    )
