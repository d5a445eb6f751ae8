"""A form of an effect: one way in which it may show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.scene import Scene

# Of a scene at a place, with constants that are drawn. The place is the number of a drive, strut or reflector; forms of
# the rig do not use it.
Shape = Callable[[Scene, int, np.random.Generator], Contribution]

LARGEST_M = 3e-4


@dataclass(frozen=True)
class Form:
    """contribution: for an amplitude of one; largest: amplitude that a machine may have, in m or as the form has it."""

    name: str
    largest: float
    contribution: Shape


def form(largest: float = LARGEST_M, name: str = "") -> Callable[[Shape], Form]:
    """Make a form of a function, of its name unless another is given."""
    return lambda shape: Form(name or shape.__name__, largest, shape)
