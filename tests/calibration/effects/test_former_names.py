"""Effect files of version 0.1 go on working: every name that they may use, against the names that replaced them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.effects.api import BasisSets, EffectInputs
from calibration.effects.catalogue import load_catalogue
from tests.calibration.diagnosis.campaigns import simulated

FILE = '''
"""An effect that uses whatever version 0.1 offered."""

import numpy as np
from calibration.effects.base import (
    Curve, Effect, Form, Forms, Parameter, Setting, Tangent, ladder, strongest_onset, varied,
)


def everything(s: Setting, drive):
    f, m = Forms(), s.moments
    travel = f"travel.{s.drive(drive)}"
    way = np.abs(m.drives - m.former)[:, drive]
    main = f.add((travel, way * s.along(drive)))
    warm = [f.add((travel, m.warmth(drive, tau))) for tau in ladder(300.0, 3000.0, 2)]
    late = f.add((travel, m.lag_k("air", 900.0)), (s.of_drive("sideways", drive)[0], s.load))
    forces = [s.tension_n[:, 0], s.answer_n_per_m[:, 0, 0], s.pull_n[:, drive, 0], s.moment_nm[:, drive]]
    forces = np.stack(forces, axis=1)
    pulled = f.add((travel, forces))
    middle, half = s.middle_m(drive)
    others = [f.add((travel, (m.drives[:, other] - middle) / half)) for other in s.partners(drive)]
    seen = f.add((travel, s.sight_m[:, 2] + s.height_m(drive) + m.elapsed_s + np.where(m.moving, 1.0, 0.0)))
    onsets = s.onsets((travel,))
    f.form(main)
    f.form(main, (*late, *pulled), share=0.5, weight=2.0, tau_s=300.0)
    f.form((*main, *warm[0], *warm[1]), [c for other in others for c in other], **strongest_onset(onsets))
    for period, prior in s.periods(drive, 4e-3, 4e-2):
        f.form(seen, weight=prior, period_m=period)
    assert len(f.acts) > len(main)
    assert all(isinstance(form, Form) for form in f.forms)
    assert set(s.channels) >= {travel}
    return f


def why_not(setting):
    return None if varied(setting.moments.drives, 0.01) else "the drives hardly moved"


def bent(s, drive):
    travel = f"travel.{s.drive(drive)}"

    def tangent(at):
        column = np.exp(at[0]) * s.along(drive)
        acts = (((travel, column),), ((travel, column),))
        return Tangent(acts, (1.0, 0.4), (1.0,), (1.0, 1.0), lambda c: c[1:])

    return (Curve(np.zeros((1, 1)), np.array([-1.0]), np.array([1.0]), np.array([np.inf]), tangent),)


EFFECTS = (
    Effect(
        "everything", "drive", Parameter("size_m", 1e-6, 1e-3, "m", "of it"), "anything", (), everything,
        (Parameter("tau_s", 1.0, 1e4, "s", "of it"),), why_not, lambda nuisance: nuisance.drift_m, "norm", bent,
    ),
    Effect(
        name="by_keyword", place="rig", size=Parameter("size_m", 1e-6, 1e-3, "m", "of it"), reveals="anything",
        confounded=("everything",), forms=everything, others=(), untested=why_not, declared=lambda n: 0.0,
        measured="rms", curves=bent,
    ),
)
'''


@pytest.fixture(scope="module")
def inputs() -> EffectInputs:
    likelihood = MarginalLikelihood.of(linearise_recording(simulated("planar4", 30)))
    return inputs_of_recording(likelihood, periodograms(likelihood))


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory):
    path = tmp_path_factory.mktemp("effects") / "mine.py"
    path.write_text(FILE, encoding="utf-8")
    return load_catalogue([Path(path)])


@pytest.mark.parametrize("name", ["everything", "by_keyword"])
def test_an_effect_file_of_version_0_1_builds_its_columns(inputs, catalogue, name):
    effect = catalogue.effect(name)
    assert effect.untested(inputs) is None
    built = effect.forms(inputs, 1)
    context = inputs.context
    way = np.abs(context.drives - context.previous_drives)[:, 1] * inputs.normalised_travel(1)
    np.testing.assert_array_equal(built.contributions[0][0][1], way)
    np.testing.assert_array_equal(built.contributions[1][0][1], context.motion_heat(1, 300.0))
    np.testing.assert_array_equal(built.contributions[3][0][1], context.thermal_lag_k("air", 900.0))
    np.testing.assert_array_equal(built.contributions[3][1][1], inputs.payload_ratio)
    np.testing.assert_array_equal(built.contributions[5][0][1], inputs.tension_response_n_per_m[:, 0, 0])
    flexible = built.sets[2]
    assert flexible.weight == 2.0
    assert flexible.parameters == {"tau_s": 300.0}
    assert flexible.relative == (1.0,) + (0.5,) * 5
    assert len(effect.contributions(inputs, 1, (0, (0.5,)))) == 2


def test_effects_of_users_come_after_the_shipped_ones_in_their_order(catalogue):
    assert catalogue.names[-2:] == ("everything", "by_keyword")
    orders = [effect.order for effect in catalogue.effects[:-2]]
    assert orders == sorted(orders)
    assert len(set(orders)) == len(orders)


def test_former_names_cannot_be_assigned(inputs):
    with pytest.raises(AttributeError):
        BasisSets().forms = []
    with pytest.raises(AttributeError):
        inputs.moments = None
