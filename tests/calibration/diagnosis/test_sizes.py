"""The sizes that a diagnosis states, in the units of the catalogue, against departures that the test itself puts in."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.diagnosis.basis_set_evidence import BasisSetEvidence
from calibration.diagnosis.cause_size import absorbed_share, relative_u_of_form, size_of
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.ranking import Cause
from calibration.effects.api import BasisSet, Departure
from calibration.effects.catalogue import Catalogue, load_catalogue
from calibration.effects.thermal import _along_screw, _means_along_screw
from mock_devices.effects import EffectChoice
from tests.calibration.diagnosis.campaigns import STATED, Arrivals, changed, plant, recorded, simulated

LEFT = np.array([1.0, 0.0])


def reduced(q: np.ndarray) -> np.ndarray:
    """The left drive on [-1, 1] over the travel of the campaign."""
    return 2.0 * (q - q.min()) / np.ptp(q) - 1.0


def play(a: Arrivals) -> np.ndarray:
    return -0.5 * 4e-5 * a.sides * LEFT


def coupling(a: Arrivals) -> np.ndarray:
    return 8e-5 * (a.drives[:, 1:] - 1.0) * LEFT


def wave(a: Arrivals) -> np.ndarray:
    return 3e-5 * np.sin(2.0 * np.pi * a.drives / 0.012) * LEFT


def bow(a: Arrivals) -> np.ndarray:
    """Of RMS 30 um over the travel, without a straight part."""
    shape = np.cos(2.0 * np.pi * reduced(a.drives[:, 0]))
    return 3e-5 * ((shape - shape.mean()) / shape.std())[:, None] * LEFT


def creep(a: Arrivals) -> np.ndarray:
    late = np.exp(-a.dwell_s / 4.0) * a.speed_m_per_s / 0.5
    return -2e-4 * a.sides * late[:, None] * LEFT


def integral_action(a: Arrivals) -> np.ndarray:
    """What friction holds back until the controller's integral has grown: from every speed the same."""
    return -6e-5 * a.sides * np.exp(-a.dwell_s / 4.0)[:, None] * LEFT


@pytest.mark.parametrize(
    ("name", "departure", "size", "rel"),
    [
        ("backlash", play, 4e-5, 0.05),
        ("axis_coupling", coupling, 8e-5, 0.25),
        ("screw_periodic_error", wave, 3e-5, 0.08),
        ("screw_cumulative_error", bow, 3e-5, 0.25),
        ("servo_settling", creep, 2e-4, 0.25),
    ],
)
def test_the_size_is_in_its_own_unit(name, departure, size, rel):
    """The effect alone in the catalogue: what it is taken for is another test's matter."""
    catalogue = load_catalogue()
    alone = Catalogue(tuple(e for e in catalogue.effects if e.name == name))
    put_in = []

    def noted(arrivals: Arrivals) -> np.ndarray:
        put_in.append(departure(arrivals)[:, 0])
        return departure(arrivals)

    diagnosis = diagnose(simulated("planar4", 80, noted), alone)
    assert diagnosis.verdict == name
    first = diagnosis.effects[0]
    assert first.place == "left"
    assert abs(first.size.value) == pytest.approx(size, rel=rel, abs=3.0 * first.size.u)
    assert first.size.unit == next(e.size.unit for e in alone.effects)
    (at_channel,) = first.places[0].at_channels
    assert (at_channel.name, at_channel.unit) == ("travel.left", "m")
    # What is alike at all readings is the drive's zero, which the calibration takes.
    assert at_channel.value == pytest.approx(float(np.std(put_in[-1])), abs=2.0 * at_channel.u)
    assert at_channel.u < 0.5 * at_channel.value


def test_raw_and_visible_size_are_those_of_the_readings():
    """RMS of the true change of a reading's coordinate in units of the stated angle deviation times the distance."""
    true, without = (simulated("planar4", 80, d, noise=0.0) for d in (play, None))
    platform = np.char.startswith(np.asarray(true["smr"]), "P")
    change = (true.positions_m - without.positions_m)[platform][:, [0, 2]]  # the station looks along z: x and height
    sigma = STATED.angle_sd_rad * true["slope_distance_m"][platform][:, None]
    raw = float(np.sqrt(np.mean((change / sigma) ** 2)))
    effect = diagnose(simulated("planar4", 80, play)).effects[0]
    assert effect.raw_sigma == pytest.approx(raw, rel=0.1)
    assert 0.8 * raw < effect.visible_sigma < effect.raw_sigma  # play is no geometry


def test_what_the_calibration_absorbs_of_an_effect_is_known_less_well():
    """Of what is seen 11 %; of what is absorbed altogether 55 %, uncorrelated."""
    assert relative_u_of_form(absorbed_share(4.0, 4.0)) == pytest.approx(0.11)
    assert relative_u_of_form(absorbed_share(4.0, 1.0)) == pytest.approx(np.hypot(0.11, 0.55 * 0.75))
    assert (
        relative_u_of_form(absorbed_share(0.0, 0.0))
        == relative_u_of_form(absorbed_share(4.0, 0.0))
        == pytest.approx(np.hypot(0.11, 0.55))
    )


def share_by_visit(a: Arrivals) -> np.ndarray:
    share = np.random.default_rng(3).uniform(0.0, 1.0, len(a.sides))
    return -0.5 * 8e-5 * a.sides * share[:, None] * LEFT


def test_play_of_which_each_visit_takes_up_another_share_is_play():
    diagnosis = diagnose(simulated("planar4", 80, share_by_visit))
    assert diagnosis.verdict == "backlash"
    assert diagnosis.effects[0].differs_with == ("visit",)
    assert diagnosis.effects[0].place == "left"


def test_a_basis_set_may_say_how_its_coefficients_add_up_to_the_size():
    """The size 2 a - b of coefficients a, b and its uncertainty; a flexible third column has no part in it."""
    effect = load_catalogue().effect("backlash")
    basis_set = BasisSet((0, 1, 2), (1.0, 1.0, 0.3), size=(2.0, -1.0))
    covariance = 1e-12 * np.array([[4.0, 1.0, 2.0], [1.0, 9.0, 3.0], [2.0, 3.0, 25.0]])
    best = BasisSetEvidence(basis_set, 50.0, 1e-5, np.array([3e-5, 1e-5, 7e-5]), covariance)
    value, u = size_of(Cause(effect, 50.0, {"left": 1.0}, "left", best, ()))
    assert value == pytest.approx(5e-5)
    assert u == pytest.approx(1e-6 * np.sqrt(4.0 * 4.0 + 9.0 - 2.0 * 2.0 * 1.0))


def test_departures_as_large_as_the_form_are_no_part_of_the_size():
    """Play that varies wholly with the load is as wide as its form says, however far it departs."""
    departures = (Departure(0, "payload", 0), Departure(0, "time", 0))
    basis_set = BasisSet((0,), (1.0, 1.0, 1.0), departures=departures)
    best = BasisSetEvidence(basis_set, 50.0, 1e-5, np.array([3e-5, 2e-5, -1e-5]), 1e-12 * np.diag([4.0, 9.0, 16.0]))
    value, u = size_of(Cause(load_catalogue().effect("backlash"), 50.0, {"left": 1.0}, "left", best, ()))
    assert value == pytest.approx(3e-5)
    assert u == pytest.approx(2e-6)


@pytest.mark.parametrize(
    ("warm", "mean"), [(lambda u: u**2, 1.0 / 3.0), (lambda u: u**3 - u, 0.0), (lambda u: u**4, 0.2)]
)
def test_a_screw_that_is_warm_anywhere_is_as_warm_as_it_is_on_the_whole(warm, mean):
    """The integral over the travel of the warmth at each place."""
    u = np.linspace(-1.0, 1.0, 50)
    coefficients = np.linalg.lstsq(_along_screw(u), warm(u), rcond=None)[0]
    assert np.array(_means_along_screw()) @ coefficients == pytest.approx(mean, abs=2e-3)


def test_a_norm_of_channels_is_that_of_each_channel_s_mean_square():
    """Two channels with coefficients of RMS 3 and 4: together 5, however many columns each has."""
    effect = load_catalogue().effect("tracker_drift")
    contributions = tuple(
        ((channel, np.ones(4)),) for channel in ("station.rx", "station.rx", "station.y", "station.y")
    )
    best = BasisSetEvidence(BasisSet((0, 1, 2, 3), (1.0,) * 4), 50.0, 1.0, np.array([3.0, -3.0, 4.0, 4.0]), np.eye(4))
    value, u = size_of(Cause(effect, 50.0, {"": 1.0}, "", best, contributions))
    assert value == pytest.approx(5.0)
    assert u == pytest.approx(1.0 / np.sqrt(2.0))


def test_settling_against_friction_is_named_among_all_effects_from_whatever_speed():
    recording = simulated("planar4", 90, integral_action)
    visit = recording.columns["visit"].astype(int)
    speed = np.random.default_rng(3).choice([0.02, 0.05, 0.3, 0.5], 90)[visit]
    found = diagnose(changed(recording, speed_m_per_s=speed))
    assert found.verdict == "servo_settling"
    (place,) = found.effects[0].places
    assert place.place == "left"
    assert abs(place.size.value - 6e-5) < 2.0 * place.size.u


def test_play_that_a_load_closes_is_play_without_any_formula_of_it():
    """A width that falls with the payload."""
    recording = recorded(plant(120, EffectChoice("backlash", 8e-5, "left", "load_width")))
    diagnosis = diagnose(recording)
    assert (diagnosis.verdict, diagnosis.effects[0].place) == ("backlash", "left")
    assert diagnosis.effects[0].differs_with == ()  # the load is in its own functions, not a departure from a form


def test_the_size_of_a_loose_reflector_is_how_far_apart_it_has_lain():
    """Along the direction in which it is loose: by up to 0.2 mm, at each visit elsewhere."""
    recording = simulated("planar4", 60, lambda a: np.zeros((len(a.drives), 2)))
    visit, of_it = recording["visit"].astype(int), np.asarray(recording["smr"], dtype=str) == "P1"
    lies = np.random.default_rng(3).uniform(-1e-4, 1e-4, visit.max() + 1)[visit] * (of_it & (visit >= 0))
    position_m = recording.positions_m + lies[:, None] * [0.6, 0.0, 0.8]
    found = diagnose(changed(recording, **{f"{axis}_m": position_m[:, k] for k, axis in enumerate("xyz")}))
    assert (found.verdict, found.effects[0].place) == ("smr_reseat", "P1")
    size = found.effects[0].size
    assert size.value == pytest.approx(float(np.ptp(lies)), rel=0.3)
    assert abs(size.value - np.ptp(lies)) < 2.0 * size.u
