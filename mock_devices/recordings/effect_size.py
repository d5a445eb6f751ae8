"""How large an effect is on a campaign: raw and visible size (docs/reference/mock-effects.md), from the plant alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mock_devices.effects.base import Array, EffectChoice
from mock_devices.effects.catalogue import EffectError, make
from mock_devices.plant.affected_machine import site_of
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.recordings.maker import SimulatedCampaign

_MOST_STEPS = 12
_CLOSE = 0.005


class SizeScale:
    """Raw sizes on one bench: the noise-free readings without effects are computed once."""

    def __init__(self, bench: SimulatedCampaign) -> None:
        self.bench = bench
        self._without = bench.points_m([])
        line = bench.timeline
        on_platform = np.array([smr.on == "platform" for smr in bench.nominal.smrs])
        self._rows = np.flatnonzero(on_platform[line.smr])
        distance = np.linalg.norm(self._without, axis=1)
        self._sigma_m = bench.settings.instrument.angle_sd_rad * distance

    def change_m(self, *choices: EffectChoice) -> Array:
        """The noise-free change of all readings (r, 3) by some effects together, in the machine's axes."""
        site = site_of(self.bench.nominal, self.bench.settings, start_s=self.bench.start_s)
        effects = [make(choice, site, self.bench.settings.seed) for choice in choices]
        moved = self.bench.points_m(effects) - self._without
        return np.asarray(moved @ self.bench.view.rotation)

    def raw_size(self, *choices: EffectChoice) -> float:
        """RMS over the platform reflectors' coordinates in the plane of motion, in units of their sigma.

        Sigma is the stated deviation of one reading across the line of sight. The coordinate along it, which a planar
        machine does not move in, is left out.
        """
        change = self.change_m(*choices)[self._rows, :2] / self._sigma_m[self._rows, None]
        return float(np.sqrt(np.mean(change**2)))

    def scaled(self, choice: EffectChoice, wanted: float) -> EffectChoice:
        """The choice with the size that has the wanted raw size; raises EffectError where none within reach has."""
        return self.scaled_together((choice,), wanted)[0]

    def scaled_together(self, choices: Sequence[EffectChoice], wanted: float) -> tuple[EffectChoice, ...]:
        """The choices, all larger or smaller by one factor, with the wanted raw size together; raises EffectError."""
        factor, low, high = 1.0, 0.0, np.inf
        for _ in range(_MOST_STEPS * 3):
            scaled = _times(choices, factor)
            raw = self._raw_or_too_much(scaled)
            if abs(raw - wanted) <= _CLOSE * wanted:
                return scaled
            low, high = (factor, high) if raw < wanted else (low, factor)
            guess = factor * wanted / raw if raw > 0.0 else 4.0 * factor
            guess = min(max(guess, 0.1 * factor), 10.0 * factor)
            inside = low < guess < high
            factor = guess if inside else (0.5 * (low + high) if np.isfinite(high) else 2.0 * factor)
            if not 1.0e-6 <= factor <= 1.0e6:
                break
        raise EffectError(f"effect {choices[0].name}: no size gives {wanted:g} sigma on this campaign")

    def _raw_or_too_much(self, choices: Sequence[EffectChoice]) -> float:
        try:
            return self.raw_size(*choices)
        except NoEquilibrium:
            return math.inf


def _times(choices: Sequence[EffectChoice], factor: float) -> tuple[EffectChoice, ...]:
    return tuple(replace(choice, size=choice.size * factor) for choice in choices)
