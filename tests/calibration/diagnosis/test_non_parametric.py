"""Where an effect of no catalogue is looked for: at forces on the platform and single reflectors too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import LinearModel
from calibration.diagnosis.non_parametric import NonParametricEffect, rank_non_parametric


def ranked(linear: LinearModel, planted: dict[str, np.ndarray], size_sigma: float = 8.0) -> list[NonParametricEffect]:
    """Alternatives where functions (n,) act through channels, of a size RMS together."""
    likelihood = MarginalLikelihood.of(linear)
    change = sum(likelihood.response(channel) * shape[:, None] for channel, shape in planted.items())
    noise = np.random.default_rng(5).standard_normal(linear.residual.shape)
    change = np.asarray(change) * (size_sigma / np.sqrt(np.mean(np.asarray(change) ** 2)))
    likelihood = MarginalLikelihood.of(replace(linear, residual=noise + change))
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    return rank_non_parametric(likelihood, inputs)


@pytest.mark.parametrize("channel", ["force.x", "force.y", "force.rz"])
def test_a_force_on_the_platform_that_goes_with_its_place_is_told_from_what_moves_it(small, channel):
    """What moves the platform alike everywhere is none: struts give way to one force by their directions."""
    left, right = small.context.drives.T
    found = ranked(small, {channel: np.sin(3.0 * left) * np.cos(2.0 * right)})[0]
    assert [name for name, _ in found.channels] == [channel]
    assert found.coordinate == "place"


def test_forces_and_moments_of_a_field_act_together(small):
    left, right = small.context.drives.T
    field = {"force.x": 1.0 * np.sin(3.0 * left), "force.y": np.cos(3.0 * right), "force.rz": 0.3 * np.sin(2.0 * right)}
    assert len(ranked(small, field)[0].channels) == 3


def test_the_strongest_reflector_is_always_looked_at(small):
    """Though by what shifts from visit to visit parts of the machine have more evidence than it."""
    left, right = small.context.drives.T
    found = ranked(small, {"smr.P2.x": np.sin(3.0 * left), "smr.P2.y": np.cos(2.0 * right) * left}, 0.4)
    assert (("smr.P2.x", "smr.P2.y", "smr.P2.z"), "place") in [
        (tuple(name for name, _ in alternative.channels), alternative.coordinate) for alternative in found
    ]
