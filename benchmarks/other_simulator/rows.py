"""A campaign carried out: everything that is known of its readings before the station has seen anything."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import HOUR_S
from benchmarks.other_simulator.journey import CALIBRATION, Journey, Reading
from benchmarks.other_simulator.machine import ON_FLOOR, ON_PLATFORM, Indices, Machine
from benchmarks.other_simulator.plan import Payload, draw_payloads, draw_visits

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

HOURS = (1.9, 4.4)
GAIN_PER_S = (25, 60)  # of the drives' position loops: following error is velocity over this
FOLLOWING_SD_M = 2.5e-7


@dataclass(frozen=True)
class Rows:
    """The r readings of a campaign of d drives, in order; `Reading` says what columns of these names are."""

    style: str
    payloads: list[Payload]
    reseats_s: list[float]
    phase: NDArray[np.str_]
    smr: Indices
    visit: Indices
    pose_number: Indices
    run: Indices
    nest_check: Indices
    t_s: Array
    dwell_s: Array
    pose: Array  # (r, 6)
    commanded_m: Array  # (r, d)
    following_error_m: Array  # (r, d)
    velocity_m_per_s: Array  # (r, d)
    speed_m_per_s: Array
    side: Array  # (r, d)
    payload: Indices
    payload_kg: Array  # true
    payload_centre_m: Array  # (r, 3), true
    stated_payload_kg: Array
    way_m: Array  # (r, d)
    approach_m: Array  # (r, d)
    moving: Mask
    face: Indices
    carriers: Indices  # what carries the reflector that is read

    def __len__(self) -> int:
        return len(self.t_s)

    @cached_property
    def drives_m(self) -> Array:
        """Coordinates (r, d) that the drives read."""
        return self.commanded_m - self.following_error_m

    @cached_property
    def hours(self) -> Array:
        """Time since the first reading (r,)."""
        return (self.t_s - self.t_s[0]) / HOUR_S

    @cached_property
    def elapsed(self) -> Array:
        """Time from 0 at the first reading to 1 at the last (r,)."""
        return self.hours / self.hours[-1]

    @cached_property
    def centred(self) -> Array:
        """Commanded coordinates (r, d) from -1 to 1 over what the campaign goes through."""
        low, high = self.commanded_m.min(0), self.commanded_m.max(0)
        return np.asarray((self.commanded_m - (low + high) / 2) / ((high - low) / 2))

    @cached_property
    def raised(self) -> Array:
        """The same (r, d) from 0 to 1."""
        low, high = self.commanded_m.min(0), self.commanded_m.max(0)
        return np.asarray((self.commanded_m - low) / (high - low))

    @cached_property
    def calibration(self) -> Mask:
        """Readings that are not of nests."""
        return np.asarray(self.phase == CALIBRATION)

    @cached_property
    def on_platform(self) -> Mask:
        """Readings of the platform's reflectors."""
        return np.asarray(self.carriers == ON_PLATFORM)

    @cached_property
    def off_floor(self) -> Mask:
        """Readings of reflectors of the machine."""
        return np.asarray(self.carriers != ON_FLOOR)

    def warmth_of_motion(self, drive: int, tau_min: float) -> Array:
        """What follows a drive's speed with a time constant (r,); 1 at its largest."""
        out, warmth = np.zeros(len(self)), 0.0
        for k in range(1, len(self)):
            passed_s = max(self.t_s[k] - self.t_s[k - 1], 1e-3)
            share = passed_s / (tau_min * 60)
            speed = max(self.way_m[k, drive] - self.way_m[k - 1, drive], 0) / passed_s
            warmth = warmth * np.exp(-share) + speed * (1 - np.exp(-share))
            out[k] = warmth
        return out / max(out.max(), 1e-9)


def draw_campaign(machine: Machine, style: str, following_share: float, rng: np.random.Generator) -> Rows:
    """A campaign of some hours; following_share: of the following error that velocity leaves to the position loop."""
    hours = rng.uniform(*HOURS)
    payloads = draw_payloads(machine, style, rng)
    visits = draw_visits(machine, style, rng)
    journey = Journey(machine, style, payloads, hours, rng)
    journey.carry_out(visits)
    readings = journey.readings

    def column(name: str) -> NDArray[Any]:
        return np.array([getattr(reading, name) for reading in readings])

    velocity = column("velocity_m_per_s")
    gain = rng.uniform(*GAIN_PER_S)
    following = following_share * velocity / gain + rng.normal(size=velocity.shape) * FOLLOWING_SD_M
    payload, smr = column("payload"), column("smr")
    masses, centres = _draw_true_payloads(machine, payloads, rng)
    plain = [name for name in Reading.__dataclass_fields__ if name not in ("drives_m", "t_s", "dwell_s")]
    return Rows(
        style=style,
        payloads=payloads,
        reseats_s=journey.reseats_s,
        **{name: column(name) for name in plain},
        t_s=column("t_s").round(3),
        dwell_s=column("dwell_s").round(3),
        commanded_m=column("drives_m"),
        following_error_m=np.round(following, 9),
        payload_kg=masses[payload],
        payload_centre_m=centres[payload],
        stated_payload_kg=np.array([one.mass_kg for one in payloads])[payload],
        carriers=machine.carriers[smr],
    )


def _draw_true_payloads(machine: Machine, payloads: list[Payload], rng: np.random.Generator) -> tuple[Array, Array]:
    """Masses (p,) and centres (p, 3) about what is stated; no payload is none."""
    masses = np.array([one.mass_kg + rng.normal() * one.u_mass_kg for one in payloads])
    free = [1, 1, 0] if machine.planar else [1, 1, 1]
    centres = np.array([np.array(one.centre_m) + rng.normal(size=3) * one.u_centre_m * free for one in payloads])
    masses[0], centres[0] = 0.0, 0.0
    return masses, centres
