"""One drive alone: what was planted into an integrated drive is found, of the right size; noise names nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.axis.diagnose import diagnose_axis, diagnose_signals
from calibration.axis.noise import NoiseShape, cosines, from_cosines
from calibration.axis.signals import Signals
from calibration.recording.axis_header import AxisFile
from calibration.recording.axis_recording import AxisRecording
from mock_devices.axis import DriveFlaws, record_drives

STIFF = 2e7
DRIVES = {  # flaws, names that the recording cannot tell apart, size
    "none": (DriveFlaws(rigid=True, noise_rad=2e-5), {"none"}, None),
    "delay": (DriveFlaws(rigid=True, delay_s=5e-4), {"delay"}, 5e-4),
    "late before": (DriveFlaws(rigid=True, delay_s=-5e-4), {"delay"}, -5e-4),
    "viscous": (DriveFlaws(viscous_nms=8000.0, torque_side=""), {"delay", "viscous"}, 4e-4),
    "coulomb": (DriveFlaws(coulomb_nm=1500.0, torque_side=""), {"coulomb", "backlash"}, 7.5e-5),
    "compliance": (
        DriveFlaws(stiffness_nm_per_rad=1e6, weight_nm=300.0, coulomb_nm=20.0, torque_side="load"),
        {"compliance"},
        1e-6,
    ),
    "inertia": (DriveFlaws(stiffness_nm_per_rad=1e6, torque_side=""), {"inertia"}, 4e-5),
    "ripple": (DriveFlaws(rigid=True, ripple_rad=1e-5, ripple_period_rad=0.02), {"ripple"}, 1e-5),
}
NULLS = 2


def recording(seen):
    units = {"torque_unit": "Nm", "torque_side": seen.torque_side} if seen.torque_side else {}
    file = AxisFile(format=1, name="mock", kind="rotary", time_unit="s", position_unit="rad", simulated=True, **units)
    return AxisRecording(file, seen.time_s, seen.motor, seen.second, seen.command, seen.torque)


@pytest.fixture(scope="module")
def seen():
    """Every drive moved for five seconds, integrated at once."""
    colours = np.random.default_rng(3).uniform(-2.0, 1.0, NULLS)
    quiet = [DriveFlaws(rigid=True, noise_rad=1e-5, noise_s=float(10.0**c), torque_side="load") for c in colours]
    flaws = [flaw for flaw, _, _ in DRIVES.values()]
    out = record_drives([*flaws, *quiet], seed=3, duration_s=5.0, sampling_s=0.005)
    return dict(zip(DRIVES, out, strict=False)) | {f"quiet {i}": r for i, r in enumerate(out[len(flaws) :])}


@pytest.mark.parametrize("name", DRIVES)
def test_what_is_planted_is_named_with_its_size(seen, name):
    _, names, size = DRIVES[name]
    found = diagnose_axis(recording(seen[name]))
    assert found.verdict in names
    assert found.simulated
    assert sum(found.ranking.values()) == pytest.approx(1.0)
    if size is None:
        assert (found.effects, found.gap.shrink) == ((), 0.0)
        return
    main = found.effects[0]
    assert main.effect == found.verdict
    assert main.size.value == pytest.approx(size, abs=3.0 * main.size.u + 0.05 * abs(size))
    assert main.size.u < 0.2 * abs(size)
    low, high = found.gap.shrink_interval
    assert 0.3 < low <= found.gap.shrink <= high
    assert found.model.shrink(Signals.of(recording(seen[name])))[2] == pytest.approx(found.gap.shrink, abs=0.1)
    if name == "viscous":
        assert {found.verdict, *found.equivalent} >= names
    if name == "delay":  # the torque of a load without friction leaves no room for a wind-up by it
        assert found.equivalent == ()
    if name == "ripple":
        assert main.others[0].value == pytest.approx(0.02, abs=4.0 * main.others[0].u)
        assert found.following_delay.value == pytest.approx(-1e-4, abs=2e-5)  # feed-forward leads by one step


@pytest.mark.parametrize("number", range(NULLS))
def test_coloured_noise_names_nothing(seen, number):
    assert diagnose_axis(recording(seen[f"quiet {number}"])).verdict == "none"


def test_what_is_left_in_blocks_of_random_order_names_nothing(seen):
    found = diagnose_axis(recording(seen["coulomb"]))
    blocks = np.array_split(found.remaining, 25)
    order = np.random.default_rng(1).permutation(25)
    shuffled = Signals.of(recording(seen["coulomb"])).with_gap(np.concatenate([blocks[i] for i in order]))
    assert diagnose_signals(shuffled, "shuffled").verdict == "none"


def test_a_law_holds_for_another_recording_of_the_drive(seen):
    """The delay of one recording takes off the gap of another, of which it knows nothing."""
    model = diagnose_axis(recording(seen["delay"])).model
    (other,) = record_drives([DRIVES["delay"][0]], seed=4, duration_s=2.0, sampling_s=0.005)
    before, after, shrink = model.shrink(Signals.of(recording(other)))
    assert before > 5e-5
    assert after < 1e-5
    assert shrink == pytest.approx(1.0 - after / before)


def test_the_noise_is_found_from_its_cosines():
    shape = NoiseShape.of(1500)
    truth = -2.0 * np.log(np.arange(1, 1501))
    coefficients = np.random.default_rng(2).standard_normal(1500) * np.exp(0.5 * truth)
    found = np.log(shape.power(shape.fit(coefficients**2)))
    assert np.sqrt(np.mean((found - truth)[100:] ** 2)) < 0.15
    np.testing.assert_allclose(cosines(from_cosines(coefficients)), coefficients, atol=1e-12)


def test_noise_that_falls_faster_than_a_random_walk_is_unlikely_before_data():
    shape = NoiseShape.of(1024)
    octave = np.arange(11.0)
    white, walk, motion = (shape.log_prior(slope * octave) for slope in (0.0, -np.log(4.0), -4.0))
    assert white > -6.0
    assert walk > -6.0
    assert motion < -80.0


def test_the_fitted_noise_is_the_likeliest():
    """Against any small change of a knot, by the likelihood and the prior as they are written down."""
    shape = NoiseShape.of(400)
    squares = (np.random.default_rng(3).standard_normal(400) * np.arange(1, 401) ** -1.5) ** 2

    def log_posterior(knots):
        power = shape.power(knots)
        return -0.5 * float(np.sum(np.log(power) + squares / power)) + shape.log_prior(knots)

    found = shape.fit(squares)
    around = [found + 0.05 * sign * step for step in np.eye(len(found)) for sign in (1.0, -1.0)]
    assert all(log_posterior(other) < log_posterior(found) for other in around)


def test_units_of_a_linear_axis(seen):
    """The same numbers in metres: the same delay, which without a torque is none but a wind-up, and no lever of a
    weight."""
    turned = recording(seen["delay"])
    file = AxisFile(format=1, name="mock", kind="linear", time_unit="s", position_unit="m")
    found = diagnose_axis(replace(turned, file=file, torque=None))
    assert found.unit == "m"
    assert {found.verdict, *found.equivalent} == {"delay", "viscous"}
    assert "weight" in found.not_tested
    assert "compliance" in found.not_tested
