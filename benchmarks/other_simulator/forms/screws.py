"""Forms of effects along a drive's screw or scale: heat, errors over the travel, periodic errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import bump, draw_phase, load_share, normalised, warming_up, wave
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

GROWTH_M, PERIODIC_M = 1.5e-4, 6e-5
LEAD_M, PITCH_M = (0.004, 0.04), (8e-5, 2e-3)  # where it is not the stated one
INTERPOLATION_SHARE = 0.1  # of the signal's period, at most


@form(GROWTH_M)
def own_motion(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Warmed by its own motion, from somewhere before the travel."""
    warmth = scene.rows.warmth_of_motion(drive, rng.uniform(10, 40))
    return Contribution(drive_m=warmth * (scene.rows.raised[:, drive] + rng.uniform(0, 0.4)))


@form(GROWTH_M)
def motor_end(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Warmed at the motor's end."""
    reach = rng.uniform(0.3, 0.7)
    grown = 1 - np.exp(-(scene.rows.raised[:, drive] + 0.15) / reach)
    return Contribution(drive_m=grown * scene.rows.warmth_of_motion(drive, rng.uniform(15, 50)))


@form(GROWTH_M)
def ambient_faster_than_column(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It follows the air sooner than the column that its sensor is on."""
    ahead = normalised(scene.weather.lagging_air_c(rng.uniform(8, 25)) - scene.weather.part_c["drives"])
    return Contribution(drive_m=ahead * (scene.rows.raised[:, drive] + 0.2))


@form(GROWTH_M)
def warm_up_of_the_day(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It warms up as the day begins."""
    warmth = warming_up(scene.rows, rng.uniform(0.25, 1.0))
    return Contribution(drive_m=warmth * (scene.rows.raised[:, drive] + rng.uniform(0.1, 0.5)))


@form(GROWTH_M)
def fixed_both_ends_bulges(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It grows from the middle."""
    warmth = scene.rows.warmth_of_motion(drive, rng.uniform(10, 40))
    return Contribution(drive_m=warmth * (scene.rows.centred[:, drive] + rng.uniform(-0.2, 0.2)))


@form()
def bow(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A bow."""
    return Contribution(drive_m=scene.rows.centred[:, drive] ** 2)


@form()
def cubic(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Of third order, and some of second."""
    place = scene.rows.centred[:, drive]
    return Contribution(drive_m=place**3 - 0.6 * place + rng.uniform(-0.3, 0.3) * place**2)


@form()
def two_pieces(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Another lead from one place on."""
    return Contribution(drive_m=np.maximum(scene.rows.centred[:, drive] - rng.uniform(-0.4, 0.4), 0))


@form()
def worn_zone(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Worn in one zone."""
    middle, width = rng.uniform(-0.4, 0.4), rng.uniform(0.2, 0.35)
    return Contribution(drive_m=bump(scene.rows.centred[:, drive], middle, width))


@form()
def grinding_wave_and_lead(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A long wave and an error of lead."""
    place = scene.rows.centred[:, drive]
    long_wave = 0.7 * np.sin(np.pi * place * rng.uniform(0.8, 1.3) + draw_phase(rng))
    return Contribution(drive_m=long_wave + 0.4 * place)


@form(PERIODIC_M)
def once_a_turn(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A sine of each turn."""
    lead_m = draw_lead(scene, drive, rng)
    return Contribution(drive_m=wave(scene.rows.drives_m[:, drive], lead_m, draw_phase(rng)), period_m=lead_m)


@form(PERIODIC_M)
def turn_and_half_turn(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Of each turn and half turn."""
    lead_m = draw_lead(scene, drive, rng)
    turn = 2 * np.pi * scene.rows.drives_m[:, drive] / lead_m
    error = 0.8 * np.sin(turn + draw_phase(rng)) + 0.5 * np.sin(2 * turn + draw_phase(rng))
    return Contribution(drive_m=error, period_m=lead_m)


@form(PERIODIC_M)
def fades_along_travel(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A sine of each turn that fades along the travel."""
    lead_m = draw_lead(scene, drive, rng)
    error = wave(scene.rows.drives_m[:, drive], lead_m, draw_phase(rng)) * (0.3 + 0.7 * scene.rows.raised[:, drive])
    return Contribution(drive_m=error, period_m=lead_m)


@form(PERIODIC_M)
def tooth_mesh_sharp(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A peak at each tooth."""
    period_m = draw_lead(scene, drive, rng)
    peaks = np.exp(1.5 * np.cos(2 * np.pi * scene.rows.drives_m[:, drive] / period_m + draw_phase(rng)))
    return Contribution(drive_m=normalised(peaks - peaks.mean()), period_m=period_m)


@form(PERIODIC_M)
def grows_with_load(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A sine of each turn that grows with the load."""
    lead_m = draw_lead(scene, drive, rng)
    strength = 0.4 + 0.6 * np.abs(load_share(scene, drive))
    error = wave(scene.rows.drives_m[:, drive], lead_m, draw_phase(rng)) * strength
    return Contribution(drive_m=error, period_m=lead_m)


@form()
def offset_of_signals(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Once a period."""
    pitch_m = draw_pitch(scene, drive, rng)
    return of_pitch(wave(scene.rows.drives_m[:, drive], pitch_m, draw_phase(rng)), pitch_m)


@form()
def amplitude_mismatch(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Twice a period."""
    pitch_m = draw_pitch(scene, drive, rng)
    return of_pitch(np.sin(4 * np.pi * scene.rows.drives_m[:, drive] / pitch_m + draw_phase(rng)), pitch_m)


@form()
def gap_varies_along_scale(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Once a period, with the reading head's distance."""
    pitch_m = draw_pitch(scene, drive, rng)
    error = wave(scene.rows.drives_m[:, drive], pitch_m, draw_phase(rng))
    return of_pitch(error * (0.4 + 0.6 * scene.rows.raised[:, drive]), pitch_m)


@form()
def triangular_signals(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Of odd orders."""
    pitch_m = draw_pitch(scene, drive, rng)
    phase = 2 * np.pi * scene.rows.drives_m[:, drive] / pitch_m + draw_phase(rng)
    return of_pitch(0.75 * np.sin(phase) + 0.5 * np.sin(3 * phase + 1) + 0.2 * np.sin(5 * phase), pitch_m)


@form()
def offset_and_phase(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Once and twice a period."""
    pitch_m = draw_pitch(scene, drive, rng)
    phase = 2 * np.pi * scene.rows.drives_m[:, drive] / pitch_m
    error = 0.7 * np.sin(phase + draw_phase(rng)) + 0.7 * np.sin(2 * phase + draw_phase(rng))
    return of_pitch(error, pitch_m)


def draw_lead(scene: Scene, drive: int, rng: Generator) -> float:
    """The stated lead more often than not, else another period (a gear, a belt)."""
    stated = scene.machine.description["drives"][drive]
    if "lead_m" in stated and rng.random() < 0.8:
        return float(stated["lead_m"])
    return float(np.round(np.exp(rng.uniform(np.log(LEAD_M[0]), np.log(LEAD_M[1]))), 5))


def draw_pitch(scene: Scene, drive: int, rng: Generator) -> float:
    """The stated pitch more often than not."""
    stated = scene.machine.description["drives"][drive]
    if "scale_pitch_m" in stated and rng.random() < 0.85:
        return float(stated["scale_pitch_m"])
    return float(np.round(np.exp(rng.uniform(np.log(PITCH_M[0]), np.log(PITCH_M[1]))), 6))


def of_pitch(error: Array, pitch_m: float) -> Contribution:
    """An error (r,) of a signal's period, no larger than interpolation can be off."""
    return Contribution(drive_m=error, period_m=pitch_m, largest=INTERPOLATION_SHARE * pitch_m)


FORMS: dict[str, tuple[Form, ...]] = {
    "screw_thermal_growth": (
        own_motion, motor_end, ambient_faster_than_column, warm_up_of_the_day, fixed_both_ends_bulges,
    ),
    "screw_cumulative_error": (bow, cubic, two_pieces, worn_zone, grinding_wave_and_lead),
    "screw_periodic_error": (
        once_a_turn, turn_and_half_turn, fades_along_travel, tooth_mesh_sharp, grows_with_load,
    ),
    "encoder_interpolation": (
        offset_of_signals, amplitude_mismatch, gap_varies_along_scale, triangular_signals, offset_and_phase,
    ),
}  # fmt: skip
