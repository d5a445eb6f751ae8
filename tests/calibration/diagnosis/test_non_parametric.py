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


def block_in_dry_friction(position_m: list[float], reach_m: float) -> np.ndarray:
    """How far a block lies behind what pushes it to and fro between two stops."""
    lies, behind = position_m[0], []
    for now in position_m:
        if now - lies > reach_m:
            lies = now - reach_m
        elif lies - now > reach_m:
            lies = now + reach_m
        behind.append(now - lies)
    return np.array(behind)


def left_by(linear: LinearModel, what: str) -> np.ndarray:
    """What depends on the ways of the left drive, or on how warm its parts are."""
    context, left = linear.context, linear.machine.drive_names.index("left")
    at_arrival = context.history.drives[:, left]
    way = np.abs(np.diff(at_arrival, prepend=at_arrival[:1]))
    if what == "dragged":
        return block_in_dry_friction(at_arrival.tolist(), 0.15 * float(np.ptp(at_arrival)))[context.arrival]
    if what == "dying away":
        since_s = context.t_s[:, None] - context.history.arrived_s[None, :]
        return np.where(since_s >= 0.0, np.exp(-np.maximum(since_s, 0.0) / 150.0), 0.0) @ np.diff(
            at_arrival, prepend=at_arrival[:1]
        )
    if what == "approach":
        return context.direction[:, left] * np.exp(-way / 0.2)[context.arrival]
    (sensor, *_) = (name for name, values in context.temperatures_c.items() if np.ptp(values) > 0.3)
    return np.asarray(context.temperatures_c[sensor] - np.mean(context.temperatures_c[sensor]))


@pytest.mark.parametrize(
    ("what", "coordinate"),
    [
        ("dragged", "former motions"), ("dying away", "former motions"), ("approach", "length of the approach"),
        ("warm", "temperature"),
    ],
)  # fmt: skip
def test_what_a_drive_remembers_of_its_way_or_follows_is_told_from_where_it_stands(small, what, coordinate):
    found = ranked(small, {"travel.left": left_by(small, what)})[0]
    assert ([name for name, _ in found.channels], found.coordinate) == (["travel.left"], coordinate)
