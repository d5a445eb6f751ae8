"""Reversal values of drives that a campaign's diagnosis has found: what tables by direction compensate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.compensation.samples import CorrectionSamples
from calibration.machine.description import Machine
from calibration.reduction.figures import COVERAGE_FACTOR
from pkm_rig.jobs.former_correction import SAMPLES
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt

REVERSAL = "backlash"  # the effect whose size is the reversal value of a drive (ISO 230-2)


def diagnosed_reversals(attempt: DiagnosisAttempt, machine: Machine) -> Array:
    """Reversal value (d,) in m of each drive: by how much more it must be commanded after motion in positive direction.

    Zero where the diagnosis considers none present, or none beyond its expanded uncertainty U (k = 2).
    """
    reversal_m = np.zeros(len(machine.drive_names))
    effects = () if attempt.diagnosis is None else attempt.diagnosis.effects
    for found in (place for effect in effects if effect.effect == REVERSAL for place in effect.places):
        if found.place in machine.drive_names and found.size.value > COVERAGE_FACTOR * found.size.u:
            reversal_m[machine.drive_names.index(found.place)] = found.size.value
    return reversal_m


def stored_reversals(activated: Mapping[str, Any], drives: int) -> Array:
    """Those (d,) of a correction that was tried, as its event has kept them; zero in older ones."""
    return CorrectionSamples.of_json(activated[SAMPLES]).reversal if SAMPLES in activated else np.zeros(drives)
