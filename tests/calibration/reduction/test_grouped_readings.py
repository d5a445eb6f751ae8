"""Readings of a visit during which the drives have moved, against the plant's own mechanics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.frame import station_frame
from calibration.reduction.grouped_readings import group_by_visit
from tests.pkm_rig.plant_recording import plant_of, record

SEED = 4
WANDER_M = 20e-6  # ten times what a rig lets pass


@pytest.fixture(scope="module")
def recording():
    return record(SEED, calibration_poses=6, nest_every_visits=3)


def _poses(recording):
    return np.flatnonzero(np.asarray(recording["phase"]) != "nests")


def _true_places(plant, recording, rows, drives_m):
    """Where the plant has the reflectors (r, 3) with these drives, in the station's frame."""
    places = [
        plant.truth.smr_positions(tuple(drives), int(payload), t)[str(name)]
        for drives, payload, t, name in zip(
            drives_m, recording["payload"][rows], recording["t_rig_s"][rows], recording["smr"][rows], strict=True
        )
    ]
    entry = recording.file.station
    return station_frame(entry.position_m, entry.heading_rad).to_station(np.array(places))


def test_positions_are_those_at_the_mean_of_the_drives(recording):
    plant, _ = plant_of(SEED)
    rows = _poses(recording)
    stood = recording.drives("actual_m")[rows]
    wander = np.random.default_rng(1).uniform(-WANDER_M, WANDER_M, stood.shape)
    columns = dict(recording.columns)
    position = recording.positions_m.copy()
    position[rows] += _true_places(plant, recording, rows, stood + wander) - _true_places(plant, recording, rows, stood)
    for a, name in enumerate(recording.file.drives):
        columns[f"{name}_actual_m"] = columns[f"{name}_actual_m"].copy()
        columns[f"{name}_actual_m"][rows] = stood[:, a] + wander[:, a]
    wandered = replace(recording, columns=columns)

    grouped = group_by_visit(wandered, rows, position, recording.covariances_m2).observations

    mean = np.array([(stood + wander)[grouped.visit == v].mean(axis=0) for v in range(len(grouped.visits))])
    assert grouped.visits.drives == pytest.approx(mean, abs=1e-12)
    shift = _true_places(plant, recording, rows, mean[grouped.visit]) - _true_places(plant, recording, rows, stood)
    off = np.linalg.norm(grouped.position_m - (recording.positions_m[rows] + shift), axis=1)
    uncorrected = np.linalg.norm(position[rows] - (recording.positions_m[rows] + shift), axis=1)
    # The plant is off its nominal geometry by parts in a thousand, and its station's heading by as much.
    assert uncorrected.max() > 10e-6
    assert off.max() < 0.01 * WANDER_M


def test_drives_that_stand_change_nothing(recording):
    rows = _poses(recording)
    grouped = group_by_visit(recording, rows, recording.positions_m, recording.covariances_m2)
    assert np.array_equal(grouped.observations.position_m, recording.positions_m[rows])
    assert np.array_equal(grouped.observations.visits.drives, recording.drives("actual_m")[grouped.heads])
