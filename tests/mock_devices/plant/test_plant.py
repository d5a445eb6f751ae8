"""The plant: readings' noise, the station's frame, payloads, the wall around the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.plant.optics import Polar, StationView, direction_between, hz_difference, rotation
from mock_devices.settings import InstrumentProfile, MockSettings


def cartesian(polar):
    horizontal = polar.distance_m * math.sin(polar.v_rad)
    return np.array(
        [
            horizontal * math.sin(polar.hz_rad),
            horizontal * math.cos(polar.hz_rad),
            polar.distance_m * math.cos(polar.v_rad),
        ]
    )


def draws(standing, count, smr=0):
    noise = [standing.plant.reading_noise(smr, 0.0) for _ in range(count)]
    return np.array([(n.hz_rad, n.v_rad, n.distance_m) for n in noise])


def test_noise_has_the_stated_standard_deviations_and_no_mean(standing):
    noise = draws(standing, 3000)
    sd = np.array([2.4e-6, 2.4e-6, 1.0e-4])
    assert noise.std(axis=0) == pytest.approx(sd, rel=0.06)
    assert np.abs(noise.mean(axis=0) / sd).max() < 0.08
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 0.08


def test_noise_depends_on_smr_pose_pass_and_reading_only(make_plant):
    first, second = make_plant(seed=9), make_plant(seed=9)
    a = draws(first, 2)
    draws(second, 5, smr=4)  # other reflectors do not count
    second.plant.put_on(2)  # nor does the payload
    assert draws(second, 2) == pytest.approx(a)
    first.drives[0].put(1.2)
    assert draws(first, 1) != pytest.approx(a[:1])
    first.drives[0].put(first.drives[1].position_m)
    again = draws(first, 2)  # the second visit to the first pose
    assert again != pytest.approx(a)
    for position_m in (1.2, second.drives[1].position_m):
        second.drives[0].put(position_m)
    assert draws(second, 2) == pytest.approx(again)


def test_a_visit_without_a_reading_does_not_shift_later_ones(make_plant):
    passing, direct = make_plant(seed=9), make_plant(seed=9)
    for position_m in (1.3, 1.2):
        passing.drives[0].put(position_m)
    direct.drives[0].put(1.2)
    assert draws(passing, 1) == pytest.approx(draws(direct, 1))


def test_another_seed_gives_other_noise(make_plant):
    assert draws(make_plant(seed=1), 1) != pytest.approx(draws(make_plant(seed=2), 1))


def test_a_drift_free_station_sees_what_the_truth_tells(make_plant):
    still = InstrumentProfile(drift_about_vertical_rad=0.0, drift_of_level_rad=0.0, drift_m=0.0)
    standing = make_plant(seed=4, instrument=still)
    places = standing.plant.truth.smr_positions(
        [d.position_m for d in standing.drives], 0, 500.0, in_station_frame=True
    )
    for sighting in standing.plant.sightings(500.0):
        assert cartesian(sighting.polar) == pytest.approx(places[sighting.name], abs=1e-12)
    turn, shift = standing.plant.truth.station_from_machine
    machine = standing.plant.truth.smr_positions([d.position_m for d in standing.drives], 0, 500.0)
    assert turn @ machine["P1"] + shift == pytest.approx(places["P1"], abs=1e-14)


def test_the_station_stands_near_its_nominal_place_and_looks_along_minus_z():
    for seed in range(20):
        view = _view(seed)
        origin = -view.rotation.T @ view.translation_m
        assert np.abs(origin - [0.0, 0.3, 3.2]).max() <= 0.0101
        assert view.rotation @ view.rotation.T == pytest.approx(np.eye(3), abs=1e-15)
        assert np.linalg.det(view.rotation) == pytest.approx(1.0)
        ahead = view.polar((0.0, 0.3, 0.0), 0.0)
        assert abs(hz_difference(ahead.hz_rad, 0.0)) < 0.010
        assert view.rotation[2] == pytest.approx([0.0, 1.0, 0.0], abs=25e-6)


def test_heading_turns_the_zero_direction_clockwise():
    straight, turned = _view(1), _view(1, station_heading_rad=0.3)
    point = (0.2, 0.1, 0.1)
    difference = hz_difference(turned.polar(point, 0.0).hz_rad, straight.polar(point, 0.0).hz_rad)
    assert difference == pytest.approx(-0.3, abs=1e-4)


def test_drift_is_some_microradians_over_hours_and_zero_at_the_start():
    moved = []
    for seed in range(20):
        view = _view(seed)
        start, later = (view.polar((0.0, 0.3, 0.0), t_s) for t_s in (0.0, 7200.0))
        assert cartesian(start) == pytest.approx(view.drift_free((0.0, 0.3, 0.0)), abs=1e-12)
        moved.append(1e6 * np.linalg.norm(cartesian(later) - cartesian(start)))
    assert 3.0 < np.median(moved) < 30.0
    assert max(moved) < 60.0


def test_rotation_vectors_and_angles_between_directions():
    assert rotation(np.array([0.0, 0.0, np.pi / 2])) @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0])
    assert direction_between(Polar(6.283, 1.57, 1.0), 0.0, 1.57) == pytest.approx(0.000185, abs=1e-6)
    assert hz_difference(0.1, 6.2) == pytest.approx(0.1 - 6.2 + 2 * np.pi)


def test_payloads_can_be_exchanged_and_unknown_ones_not(plant):
    tool_before = plant.truth.tool_pose((1.118, 1.118), plant.payload)
    plant.put_on(2)
    assert plant.truth.tool_pose((1.118, 1.118), plant.payload)[1] < tool_before[1] - 10e-6
    with pytest.raises(ValueError, match="no payload 3"):
        plant.put_on(3)
    with pytest.raises(ValueError, match="no payload 7"):
        MockSettings(initial_payload=7)


def test_the_truth_lists_parameters_and_takes_stated_temperatures(plant):
    assert plant.truth.parameters()["left_upper.length_m"] == pytest.approx(1.5, abs=1e-4)
    cold, warm = (dict.fromkeys(("struts", "columns", "base", "platform"), t) for t in (20.0, 25.0))
    poses = [plant.truth.tool_pose((1.118, 1.118), 0, temperatures_c=t) for t in (cold, warm)]
    assert abs(poses[0][1] - poses[1][1]) > 5e-6


def test_the_drives_must_be_as_many_as_the_sliders(plant, standing):
    with pytest.raises(ValueError, match="2 drives"):
        plant.attach(standing.drives[:1])


def _view(seed, **settings):
    return StationView(MockSettings(seed=seed, **settings))
