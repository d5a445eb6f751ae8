"""Slots, designs and cases that tests of the check on withheld data share."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from benchmarks.withheld.cases import Slot
from benchmarks.withheld.designs import FEW, Designs
from benchmarks.withheld.making import make_case

EFFECT = Slot("effect-a", "effect", ("backlash",), (5.0,))
REMOVED = Slot("removed-a", "removed", ("tracker_drift",), (3.0,))
NULL = Slot("null-a", "null", profile="warm")
DECOY = Slot("null-b", "null", profile="small", decoy=True)
OUT = Slot("outside-a", "outside", ("cable_drag",), (3.0,))
UNDECLARED = Slot("null-c", "null", profile="drifting", style="poor", declared="not", gross=True)
NEXT = Slot("next-a", "next", ("column_compliance",), (5.0,))


@lru_cache
def designs():
    return Designs(3, FEW)


@lru_cache
def case_of(slot):
    return make_case(slot, np.random.default_rng(5), designs(), final=False)
