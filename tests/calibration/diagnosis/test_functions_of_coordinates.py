"""The arbitrary functions of one coordinate that describe where a gap lies, and effects that no catalogue has."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis.channels import STATED, Channels
from calibration.diagnosis.effect_inputs import inputs_of_readings
from calibration.diagnosis.findings.variance_shares import _coordinates
from calibration.diagnosis.linear_model import LinearModel
from calibration.diagnosis.non_parametric import _alternatives, _channel_groups

DRIVES = ("left", "right")
PERIOD_M = 0.011
PERIODOGRAMS = [SimpleNamespace(strongest_periods=lambda *_: [(PERIOD_M, 0.3), (0.017, 0.1)])] * 2
DEPENDS = {
    "drives": {(kind, drive) for kind in ("drive", "period") for drive in DRIVES},
    "direction": {(kind, f"{what}{drive}") for kind, what in (
        ("direction", ""), ("dwell", "rest after approach of "), ("speed", "speed of ")
    ) for drive in DRIVES},
    "payload_kg": {("load", "payload")},
    "speed_m_per_s": {("speed", "approach"), *(("speed", f"speed of {drive}") for drive in DRIVES)},
    "dwell_s": {("dwell", "rest"), *(("dwell", f"rest after approach of {drive}") for drive in DRIVES)},
    "t_s": {("time", "rig")},
}  # fmt: skip


@pytest.fixture(scope="module")
def drawn(small) -> LinearModel:
    """The readings with every coordinate of their context drawn on its own, so that none stands for another."""
    rng, n = np.random.default_rng(11), len(small.visit)
    context = replace(
        small.context,
        drives=rng.uniform(0.4, 1.6, (n, 2)),
        direction=rng.choice([-1.0, 1.0], (n, 2)),
        payload_kg=rng.choice([0.0, 100.0, 300.0], n),
        speed_m_per_s=rng.choice([0.1, 0.25], n),
        dwell_s=rng.uniform(0.5, 16.0, n),
        t_s=small.context.start_s + rng.uniform(0.0, 4000.0, n),
    )
    return replace(small, context=context)


def shapes_of(linear: LinearModel) -> dict[tuple[str, str], np.ndarray]:
    return {(kind, name): shapes for kind, name, shapes in _coordinates(linear, PERIODOGRAMS)}


def changed(before: dict, after: dict) -> set[tuple[str, str]]:
    assert before.keys() == after.keys()
    return {key for key in before if not np.array_equal(before[key], after[key])}


@pytest.mark.parametrize("field", DEPENDS)
def test_a_function_of_a_coordinate_is_one_of_nothing_else(drawn, field):
    """Readings that exchange the values of one field keep the functions of all others."""
    values = getattr(drawn.context, field)
    other = replace(drawn, context=replace(drawn.context, **{field: values[::-1].copy()}))
    assert changed(shapes_of(drawn), shapes_of(other)) == DEPENDS[field]


def test_a_temperature_is_that_of_one_sensor(drawn):
    for sensor, celsius in drawn.context.temperatures_c.items():
        warm = {**drawn.context.temperatures_c, sensor: celsius[::-1].copy()}
        other = replace(drawn, context=replace(drawn.context, temperatures_c=warm))
        assert changed(shapes_of(drawn), shapes_of(other)) == {("temperature", sensor)}


@pytest.mark.parametrize(("axis", "name"), [(0, "x"), (1, "y")])
def test_a_region_is_a_place_in_the_plane(drawn, axis, name):
    """Both coordinates count; the readings of every visit, the first one's too, have its own target."""
    target = drawn.poses.visits.target_m.copy()
    target[0, axis] = 0.5 * target[:, axis].min() + 0.5 * target[:, axis].max()
    other = replace(drawn, poses=replace(drawn.poses, visits=replace(drawn.poses.visits, target_m=target)))
    before, after = shapes_of(drawn), shapes_of(other)
    assert changed(before, after) == {("pose", name), ("region", "tool")}
    moved = np.any(before["pose", name] != after["pose", name], axis=1)
    assert set(np.unique(drawn.visit[moved])) <= {-1, 0}
    assert np.all(moved[drawn.visit == 0])
    place = target[np.maximum(drawn.visit, 0), axis]
    wave = np.cos(np.pi * (place - place.min()) / np.ptp(place))
    region = after["region", "tool"]
    assert region @ np.linalg.lstsq(region, wave, rcond=None)[0] == pytest.approx(wave, abs=1e-9)


def test_a_period_is_a_wave_and_its_first_harmonic(drawn):
    for a, drive in enumerate(DRIVES):
        phase = 2.0 * np.pi * drawn.context.drives[:, a] / PERIOD_M
        waves = np.stack([np.sin(phase), np.cos(phase), np.sin(2.0 * phase), np.cos(2.0 * phase)], axis=1)
        shapes = shapes_of(drawn)["period", drive]
        assert shapes.shape == waves.shape
        assert shapes @ np.linalg.lstsq(shapes, waves, rcond=None)[0] == pytest.approx(waves, abs=1e-9)


@pytest.fixture(scope="module")
def alternatives(drawn) -> tuple[Channels, list[tuple[str, ...]], dict[tuple[str, str], np.ndarray]]:
    """Channels, the groups of them that are tried together, and all shapes by first channel and coordinate."""
    channels = Channels(drawn)
    inputs = inputs_of_readings(drawn, channels, lambda *_: [], lambda *_: [])
    groups = list(_channel_groups(inputs, channels))
    found: Iterable = _alternatives(inputs, channels, groups)
    return channels, groups, {("+".join(group), coordinate): shapes for group, coordinate, shapes in found}


def test_an_unknown_effect_is_looked_for_at_every_channel(alternatives):
    """All reflectors of the platform are tried one by one and together; a strut's own weight and stated values are not:
    the drives, struts and the platform that they move are."""
    channels, groups, _ = alternatives
    tried = {name for group in groups for name in group}
    assert tried == {name for name in channels.names if name.split(".")[0] not in ("weight", *STATED)}
    reflectors = tuple(name for name in channels.names if name.startswith("smr."))
    assert reflectors in groups


def test_what_is_looked_for_at_a_drive_or_its_struts_depends_on_that_drive(drawn, alternatives):
    _, _, shapes = alternatives
    machine = drawn.machine
    for coordinate in ("place", "direction and place"):
        by_drive = [shapes[f"travel.{drive}", coordinate] for drive in DRIVES]
        assert not np.array_equal(*by_drive)
        for strut, drive in zip(machine.strut_names, machine.strut_drive.tolist(), strict=True):
            assert np.array_equal(shapes[f"length.{strut}", coordinate], by_drive[drive])
        for drive, expected in zip(DRIVES, by_drive, strict=True):
            assert np.array_equal(shapes[f"sideways.{drive}.x", coordinate], expected)
