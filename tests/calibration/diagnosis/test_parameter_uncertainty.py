"""The uncertainty of an effect's parameters, of any unit and scale: against scans of the likelihood and repetitions."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.diagnosis.channels import Channels
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.effect_inputs import inputs_of_readings
from calibration.diagnosis.findings.parameter_uncertainty import mean_square_about, parameter_uncertainty
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.ranking import rank_effects
from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter
from calibration.effects.catalogue import Catalogue, load_catalogue
from tests.calibration.diagnosis.campaigns import Arrivals, simulated

DECAY_PER_M = 3.7  # not a value of the grids below
LOW, HIGH = 0.3, 40.0  # 1/m
START_M = 0.6
FILE = '''
"""A slide that gives way after a stop, less and less with its distance from the lower end of its travel."""
import numpy as np
from calibration.effects.base import Effect, Forms, Parameter

def end_wear(s, drive):
    f, q = Forms(), s.moments.drives[:, drive]
    for rate in np.geomspace(RANGE, COUNT):
        shape = s.moments.direction[:, drive] * np.exp(-rate / SCALE * (q - 0.6))
        f.form(f.add((f"travel.{s.drive(drive)}", shape)), decay=rate)
    return f

EFFECTS = (
    Effect(
        "end_wear", "drive", Parameter("wear_m", 1e-6, 1e-3, "m", "at the lower end"), "the whole travel", (),
        end_wear, (Parameter("decay", LIMITS, "UNIT", "rate of decay"),),
    ),
)
'''


def catalogue(folder, *, unit: str = "1/m", scale: float = 1.0, count: int = 25) -> Catalogue:
    """The effect alone; its parameter in a unit that is `scale` times smaller than 1/m."""
    low, high = LOW * scale, HIGH * scale
    text = FILE.replace("RANGE", f"{low}, {high}").replace("LIMITS", f"{low}, {high}").replace("COUNT", str(count))
    path = folder / "end_wear.py"
    path.write_text(text.replace("SCALE", str(scale)).replace("UNIT", unit), encoding="utf-8")
    return load_catalogue([path], without=load_catalogue().names)


def worn(wear_m: float):
    def travel_m(a: Arrivals) -> np.ndarray:
        return wear_m * a.sides * np.exp(-DECAY_PER_M * (a.drives - START_M)) * np.array([1.0, 0.0])

    return travel_m


def decay_of(recording, effects: Catalogue):
    diagnosis = diagnose(recording, effects)
    assert diagnosis.verdict == "end_wear"
    (decay,) = diagnosis.effects[0].others
    return decay


def scanned(recording, reported: float) -> float:
    """Root mean square distance from the reported value under the likelihood of a continuous rate, by regressions.

    Geometry and all else that calibration fits are dense columns with unit priors; the size has a wide prior.
    """
    linear = linearise_recording(recording)
    a = linear.columns.reshape(-1, linear.columns.shape[2])
    y = linear.residual.ravel()
    response = linear.whiten_shift(Channels(linear).shift_m("travel.left"))
    side, q = linear.context.direction[:, 0], linear.context.drives[:, 0]
    # What the columns and their priors leave of readings and shapes, which is the same at every rate.
    of_readings = np.linalg.qr(np.vstack([a, np.eye(a.shape[1])]))[0]

    def left(values: np.ndarray) -> np.ndarray:
        padded = np.append(values, np.zeros(a.shape[1]))
        return padded - of_readings @ (of_readings.T @ padded)

    rates, y_left = np.geomspace(LOW, HIGH, 400), left(y)
    logs = []
    for rate in rates:
        column = left((response * (side * np.exp(-rate * (q - START_M)))[:, None]).ravel() * 1e-3)
        logs.append(-0.5 * float(y_left @ y_left - (column @ y_left) ** 2 / (column @ column + 1.0)))
    weight = np.exp(np.array(logs) - max(logs))  # the grid is uniform in the logarithm, as the effect's is
    return float(np.sqrt(np.sum(weight * (rates - reported) ** 2) / np.sum(weight)))


@pytest.mark.parametrize("wear_m", [3e-5, 8e-5])
def test_it_is_the_spread_of_the_likelihood(tmp_path, wear_m):
    recording = simulated("planar4", 60, worn(wear_m))
    decay = decay_of(recording, catalogue(tmp_path, count=60))
    assert decay.u == pytest.approx(scanned(recording, decay.value), rel=0.12)


def test_it_covers_the_truth_in_repetitions_as_often_as_it_says(tmp_path):
    effects = catalogue(tmp_path)
    decays = [decay_of(simulated("planar4", 40, worn(6e-5), seed=seed), effects) for seed in range(1, 9)]
    off = np.array([(decay.value - DECAY_PER_M) / decay.u for decay in decays])
    assert 0.3 < np.sqrt(np.mean(off**2)) < 1.7
    assert np.abs(off).max() < 3.5


def test_it_has_the_unit_and_scale_of_its_parameter(tmp_path):
    recording = simulated("planar4", 40, worn(6e-5))
    plain = decay_of(recording, catalogue(tmp_path))
    small = decay_of(recording, catalogue(tmp_path, unit="1/Mm", scale=1e6))
    assert (plain.unit, small.unit) == ("1/m", "1/Mm")
    assert small.value == pytest.approx(1e6 * plain.value)
    assert small.u == pytest.approx(1e6 * plain.u, rel=1e-6)


def test_a_coarse_grid_is_not_known_better_than_its_steps(tmp_path):
    """A strong effect: the readings choose one value of the grid, and the truth is anywhere in its cell."""
    recording = simulated("planar4", 60, worn(3e-4))
    coarse = decay_of(recording, catalogue(tmp_path, count=6))
    values = np.geomspace(LOW, HIGH, 6)
    k = int(np.argmin(np.abs(values - coarse.value)))
    cell = 0.5 * (values[k + 1] - values[k - 1])
    assert 0.8 * cell / np.sqrt(12.0) < coarse.u < 1.5 * cell
    assert abs(coarse.value - DECAY_PER_M) < cell


@pytest.mark.parametrize(("amplitude_m", "largest_u_m"), [(1.5e-5, 2e-4), (1e-4, 4e-5)])
def test_a_period_is_known_the_better_the_stronger_its_wave_is(amplitude_m, largest_u_m):
    """It is on no grid: the campaign's periodogram has found it."""
    true_m = 0.012

    def wave(a: Arrivals) -> np.ndarray:
        return amplitude_m * np.sin(2.0 * np.pi * a.drives / true_m) * np.array([1.0, 0.0])

    known = load_catalogue()
    alone = known.without([name for name in known.names if name != "screw_periodic_error"])
    (period,) = diagnose(simulated("planar4", 80, wave), alone).effects[0].others
    assert period.unit == "m"
    assert period.u < largest_u_m
    assert abs(period.value - true_m) < 3.0 * period.u


@pytest.mark.parametrize(
    ("weights", "true_m", "largest_u_m"),
    [((0.0, 1.0), 0.0137, 2.0e-5), ((-1.0, 1.0), 1.2e-3, 2.0e-7)],
    ids=["the other", "the difference"],
)
def test_a_period_over_another_drive_s_coordinate_is_found_with_its_uncertainty(weights, true_m, largest_u_m):
    """Of what errs along the first drive only, by an amount that is not a share of any travel."""

    def wave(a: Arrivals) -> np.ndarray:
        turn = 2.0 * np.pi * (a.drives @ np.array(weights)) / true_m
        return 4.0e-5 * np.sin(turn)[:, None] * np.array([1.0, 0.0])

    diagnosis = diagnose(simulated("planar4", 160, wave))
    assert diagnosis.verdict == "axis_coupling"
    (found,) = diagnosis.effects
    (period,) = found.others
    assert (found.place, period.unit) == ("left", "m")
    assert 0.0 < period.u < largest_u_m
    assert abs(period.value - true_m) < 3.0 * period.u


def test_a_mean_square_over_cells_is_that_of_samples():
    rng = np.random.default_rng(3)
    values, posterior = np.array([1.0, 2.0, 4.0, 8.0]), np.array([0.1, 0.5, 0.3, 0.1])
    edges = np.array([0.5, 1.5, 3.0, 6.0, 10.0])
    cell = rng.choice(4, 200_000, p=posterior)
    x = rng.uniform(edges[cell], edges[cell + 1])
    parameter = EffectParameter("any", 0.0, 20.0, "s", "of it")
    assert mean_square_about(2.0, values, posterior, parameter) == pytest.approx(np.mean((x - 2.0) ** 2), rel=0.02)
    single = mean_square_about(5.0, np.array([5.0]), np.ones(1), parameter)
    assert single == pytest.approx(np.mean((rng.uniform(0.0, 20.0, 200_000) - 5.0) ** 2), rel=0.02)


def test_values_count_by_the_weights_of_their_basis_sets(small, likelihood):
    """The same columns with 1 s and 3 s, nine times as likely beforehand as not: cells 0 to 2 s and 2 to 4 s."""

    def forms(inputs: EffectInputs, place: int) -> BasisSets:
        out = BasisSets()
        columns = out.add((f"travel.{inputs.drive(place)}", inputs.context.direction[:, place]))
        out.add_set(columns, weight=0.9, delay_s=1.0)
        out.add_set(columns, weight=0.1, delay_s=3.0)
        return out

    delay = EffectParameter("delay_s", 0.0, 10.0, "s", "")
    effect = Effect("slow", "drive", EffectParameter("lag_m", 1e-6, 1e-3, "m", ""), "", (), forms, (delay,))
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    (cause,) = rank_effects(likelihood, inputs, [effect])
    assert cause.best.basis_set.parameters == {"delay_s": 1.0}
    expected = np.sqrt(0.9 * 1.0 / 3.0 + 0.1 * (2.0**2 + 1.0 / 3.0))
    assert parameter_uncertainty(cause, delay, likelihood, inputs) == pytest.approx(expected)
