"""Noise in place of readings: what a diagnosis still finds then, it has not from these."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.withheld.cases import Slot
from benchmarks.withheld.diagnoser import REAL, loaded
from benchmarks.withheld.making import make_case
from benchmarks.withheld.noise import noise_only
from calibration.recording.folder import read_folder
from mock_devices.effects import CATALOGUE
from mock_devices.recordings.files import write_recording
from tests.benchmarks.withheld_cases import designs

STAND_IN = "stand_in:diagnose"


@pytest.mark.parametrize(
    ("function", "names", "at_least"),
    [(STAND_IN, CATALOGUE[::3], 1), (REAL, ("backlash",), 1)],
    ids=["stand-in", "real"],
)
def test_noise_in_place_of_readings_tells_nothing(tmp_path, function, names, at_least):
    diagnose = loaded(function)
    slots = [Slot(f"effect-{k}", "effect", (name,), (5.0,)) for k, name in enumerate(names)]
    named = before = 0
    for number, slot in enumerate(slots):
        case = make_case(slot, np.random.default_rng([6, number]), designs(), final=False)
        write_recording(case.recording, tmp_path / slot.key)
        recording = read_folder(tmp_path / slot.key)
        before += diagnose(recording, ()).verdict == slot.effects[0]
        noise = noise_only(recording, np.random.default_rng(number))
        named += diagnose(noise, ()).verdict == slot.effects[0]
    assert before >= at_least
    assert named <= len(names) // 10  # chance would name one of twenty
