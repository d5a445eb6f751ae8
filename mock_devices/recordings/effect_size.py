"""How large an effect is on a campaign: raw and visible size (docs/reference/mock-effects.md), from the plant alone."""

from __future__ import annotations

import math
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

    def change_m(self, choice: EffectChoice) -> Array:
        """The noise-free change of all readings (r, 3) in the machine's axes."""
        site = site_of(self.bench.nominal, self.bench.settings, start_s=self.bench.start_s)
        effect = make(choice, site, self.bench.settings.seed)
        moved = self.bench.points_m([effect]) - self._without
        return np.asarray(moved @ self.bench.view.rotation)

    def raw_size(self, choice: EffectChoice) -> float:
        """RMS over the platform reflectors' coordinates in the plane of motion, in units of their sigma.

        Sigma is the stated deviation of one reading across the line of sight. The coordinate along it, which a planar
        machine does not move in, is left out.
        """
        change = self.change_m(choice)[self._rows, :2] / self._sigma_m[self._rows, None]
        return float(np.sqrt(np.mean(change**2)))

    def _raw_or_too_much(self, choice: EffectChoice) -> float:
        try:
            return self.raw_size(choice)
        except NoEquilibrium:
            return math.inf

    def scaled(self, choice: EffectChoice, wanted: float) -> EffectChoice:
        """The choice with the size that has the wanted raw size; raises EffectError where none within reach has."""
        size, low, high = choice.size, 0.0, np.inf
        for _ in range(_MOST_STEPS * 3):
            raw = self._raw_or_too_much(replace(choice, size=size))
            if abs(raw - wanted) <= _CLOSE * wanted:
                return replace(choice, size=size)
            low, high = (size, high) if raw < wanted else (low, size)
            guess = size * wanted / raw if raw > 0.0 else 4.0 * size
            guess = min(max(guess, 0.1 * size), 10.0 * size)
            inside = low < guess < high
            size = guess if inside else (0.5 * (low + high) if np.isfinite(high) else 2.0 * size)
            if size > 1.0e6 * choice.size or size < 1.0e-6 * choice.size:
                break
        raise EffectError(f"effect {choice.name}: no size gives {wanted:g} sigma on this campaign")
