"""Poses at rest against MuJoCo's forces, for every shipped machine (and a guide line in the plane and in space)."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco, a development dependency, is not installed")

from calibration.base.rotation import rotation_vector
from tests.calibration.machine.test_reference_model import every_machine, twin
from tests.calibration.mujoco_model import MujocoMachine, with_errors

POSES = 100
SAME_REST = 1e-13  # m and rad


@every_machine
def test_the_platform_rests_where_mujoco_holds_it(make):
    """Random errors within the tolerances; payload, push and temperatures of every pose its own."""
    t = make()
    trial = t.reference.trial(seed=31, count=POSES)
    rest = t.solve(trial)
    assert rest.converged.all()
    nominal = t.solve(type(trial)(dict.fromkeys(trial.theta, 0.0), trial.cases, trial.starts))
    file = with_errors(t.machine.text, trial.theta)
    far = turn = 0.0
    for i, (case, start) in enumerate(zip(trial.cases, trial.starts, strict=True)):
        place, rotation = MujocoMachine(file, case).rest(start)
        far = max(far, float(np.linalg.norm(rest.position_m[i] - place)))
        turn = max(turn, float(np.linalg.norm(rotation_vector((rest.rotation[i] @ rotation.T)[None])[0])))
    moved = np.linalg.norm(rest.position_m - nominal.position_m, axis=1).max()
    print(f"\n{t.machine.name}: {far:.1e} m, {turn:.1e} rad; the errors move it by up to {moved * 1e6:.0f} um")
    assert max(far, turn) < SAME_REST
    assert moved > 1e-5  # or agreement would say nothing about the errors


def test_a_wrong_stiffness_is_seen():
    """The comparison can fail: a hundred-thousandth of one stiffness is far above the agreement asked for."""
    t = twin("planar4")
    trial = t.reference.trial(seed=32, count=5)
    rest = t.solve(trial)
    theta = trial.theta | {"ln_stiffness.left_upper": trial.theta["ln_stiffness.left_upper"] + 1e-5}
    file = with_errors(t.machine.text, theta)
    places = [MujocoMachine(file, c).rest(s)[0] for c, s in zip(trial.cases, trial.starts, strict=True)]
    assert np.linalg.norm(rest.position_m - np.array(places), axis=1).max() > 100.0 * SAME_REST
