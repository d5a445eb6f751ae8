"""Poses at rest against a frame solver, one machine of each kind: sliders, legs, cranks, guide planes."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("Pynite", reason="PyNiteFEA, a development dependency, is not installed")

from calibration.base.rotation import rotation_vector
from tests.calibration import pynite_model
from tests.calibration.machine.test_reference_model import twin
from tests.calibration.mujoco_model import with_errors

POSES = 5
SAME_PLACE_M = 5e-10
SAME_TURN_RAD = 5e-10


@pytest.mark.parametrize("name", ["planar4", "delta8", "gough8", "rrr4", "prs3"])
def test_the_platform_rests_where_a_frame_solver_puts_it(name):
    t = twin(name)
    trial = t.reference.trial(seed=41, count=POSES)
    rest = t.solve(trial)
    assert rest.converged.all()
    file = with_errors(t.machine.text, trial.theta)
    far = turn = 0.0
    for i, (case, start) in enumerate(zip(trial.cases, trial.starts, strict=True)):
        place, rotation, rounds = pynite_model.rest(file, case, start)
        far = max(far, float(np.linalg.norm(rest.position_m[i] - place)))
        turn = max(turn, float(np.linalg.norm(rotation_vector((rest.rotation[i] @ rotation.T)[None])[0])))
    print(f"\n{name}: {far:.1e} m, {turn:.1e} rad after {rounds} linearisations")
    assert far < SAME_PLACE_M
    assert turn < SAME_TURN_RAD
