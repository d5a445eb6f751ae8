"""Which other effects could be taken for the true one, by the plant's own code, with the geometry fitted again.

For each design a library holds the noise-free changes of every effect at all its places and variants, with some
draws of its further parameters and once more with the true effect's (onset, time constant, period). All readings are
whitened and what frame, reflectors and geometry absorb (`VisibleScale`) is taken out of the library and of the true
change alike. An effect's distance is the RMS, in sigma over the coordinates in the plane of all reflectors' readings,
of what the best combination of at most three of its library's changes leaves, chosen greedily. A combination can
do more than one effect of one form, which makes distances small; a library holds some draws of a curve or a period
only, which makes them large. Nothing of this looks at a diagnosis.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.withheld.designs import Drawn
from benchmarks.withheld.making import Case
from mock_devices.effects import CATALOGUE, SPECS, EffectChoice, EffectError, draw
from mock_devices.effects.base import names_of
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.recordings.effect_size import SizeScale

Array = NDArray[np.float64]
SampledColumn = tuple[EffectChoice, Array]

DRAWS = 2
MOST_COLUMNS = 3
MOST_STEPS, WANTED_RAW = 3, 3.0
KINDS = ("effect", "platform_only", "removed", "outside")  # of one effect, to be distinguished from others
REFINED = {"platform_only": 0.8, "removed": 1.0, "outside": 0.8}  # up to which distance parameters are fitted
NEAR_ENOUGH, REFINING = 0.25, 40
SHARED = ("onset_s", "tau_s", "period_m", "wavelength_m", "tilt_per_m")


class Mimics:
    """The library of one design, on one reference machine; effects: those that it holds."""

    def __init__(
        self, drawn: Drawn, *, draws: int = DRAWS, final: bool | None = None, effects: Collection[str] = CATALOGUE
    ) -> None:
        self.drawn = drawn
        self._visible = drawn.visible
        self._sizes: SizeScale = drawn.visible.sizes
        line = drawn.timeline
        on_floor = np.array([smr.on == "floor" for smr in line.machine.smrs])
        self._rows = np.flatnonzero(~on_floor[line.smr])
        on_platform = np.array([smr.on == "platform" for smr in line.machine.smrs])
        self._platform = np.flatnonzero(on_platform[line.smr])
        place = self._sizes.bench.points_m([])[self._platform]
        angle_sd_rad = self._sizes.bench.settings.instrument.angle_sd_rad
        self._sigma_m = angle_sd_rad * np.linalg.norm(place, axis=1)[:, None]
        rng = np.random.default_rng([drawn.seed, 5])
        self._library: dict[str, list[SampledColumn]] = {
            name: self._changes(name, rng, draws, final) for name in effects
        }

    def distances(
        self, fact: dict[str, Any], change_m: Array, names: Collection[str] = (), *, refine: float = 0.0
    ) -> dict[str, float]:
        """RMS in sigma by name of what the other effects leave of a true change (r, 3) in the machine's axes.

        names: of these only. Those not above `refine` have their further parameters fitted as well.
        """
        residual = self._residual_after_fit(change_m)
        out = {}
        for name in names or self._library:
            if name != fact["effect"]:
                columns = [*self._library[name], *self._alike(name, fact)]
                near, chosen = self._nearest(residual, columns)
                if NEAR_ENOUGH < near <= refine and SPECS[name].others:
                    near = self._refine(residual, [columns[k] for k in chosen], near)
                out[name] = near
        return out

    def _nearest(self, residual: Array, columns: Sequence[SampledColumn]) -> tuple[float, list[int]]:
        """What a greedy choice of at most three columns leaves, and the choice."""
        remainder, chosen = residual, list[int]()
        if not columns:
            return self._rms(residual), chosen
        matrix = np.stack([column / np.linalg.norm(column) for _, column in columns], axis=1)
        for _ in range(min(MOST_COLUMNS, matrix.shape[1])):
            best = int(np.argmax(np.abs(matrix.T @ remainder)))
            if best in chosen:
                break
            chosen.append(best)
            part = matrix[:, chosen]
            remainder = residual - part @ np.linalg.lstsq(part, residual, rcond=None)[0]
        return self._rms(remainder), chosen

    def _refine(self, residual: Array, chosen: Sequence[SampledColumn], near: float) -> float:
        """The same with the further parameters of the first column fitted too, within their ranges."""
        first, others = chosen[0][0], SPECS[chosen[0][0].name].others
        start = dict(first.parameters)
        low, high = (np.array([getattr(p, end) for p in others]) for end in ("low", "high"))
        at = (np.array([start.get(p.name, p.typical) for p in others]) - low) / (high - low)

        def leaves(x: Array) -> float:
            values = low + np.clip(x, 0.0, 1.0) * (high - low)
            names = (p.name for p in others)
            choice = replace(first, parameters=tuple(zip(names, values.tolist(), strict=True)))
            column = self._column(choice)
            return near if column is None else self._nearest(residual, [*chosen, (choice, column)])[0]

        steps = np.vstack([at, at + np.diag(np.where(at > 0.5, -0.2, 0.2))])
        options = {"maxfev": REFINING, "initial_simplex": steps}
        return min(near, float(minimize(leaves, at, method="Nelder-Mead", options=options).fun))

    def _residual_after_fit(self, change_m: Array) -> Array:
        """What a refit leaves of a change, whitened, of all coordinates."""
        rows = (change_m * self._visible._weight).ravel()
        q = self._visible._q
        padded = np.concatenate([rows, np.zeros(q.shape[1])])
        return np.asarray((padded - q @ (q.T @ padded))[: len(rows)])

    def _rms(self, residual: Array) -> float:
        samples = np.sqrt(self.drawn.timeline.samples)[:, None]
        single = residual.reshape(-1, 3) / samples
        return float(np.sqrt(np.mean(single[self._rows, :2] ** 2)))

    def _changes(self, name: str, rng: np.random.Generator, draws: int, final: bool | None) -> list[SampledColumn]:
        spec, machine = SPECS[name], self.drawn.timeline.machine
        variants = [v for v in spec.variants if final is not False or v != spec.final]
        out = []
        for place in names_of(machine, spec.place):
            for variant in variants:
                for _ in range(draws if spec.others else 1):
                    choice = draw(name, machine, rng, final=None, duration_s=self.drawn.duration_s)
                    choice = replace(choice, place="" if place == "rig" else place, variant=variant)
                    column = self._column(choice)
                    if column is not None:
                        out.append((choice, column))
        return out

    def _alike(self, name: str, fact: dict[str, Any]) -> list[SampledColumn]:
        """The effect's changes with the true one's further parameters, where both have them; setting in at once."""
        spec, machine = SPECS[name], self.drawn.timeline.machine
        shared = {p.name: p.low for p in spec.others if p.name == "onset_s"} | {
            p.name: min(max(fact["parameters"][p.name], p.low), p.high)
            for p in spec.others
            if p.name in SHARED and p.name in fact["parameters"]
        }
        if not shared:
            return []
        places = list(names_of(machine, spec.place))
        if fact["place"] in places:
            places = [fact["place"]]
        choices = [
            EffectChoice(name, spec.size.middle, place, variant, tuple(shared.items()), fact["seed"])
            for place in places
            for variant in spec.variants
        ]
        candidates = [(choice, self._column(choice)) for choice in choices]
        return [(choice, column) for choice, column in candidates if column is not None]

    def _column(self, choice: EffectChoice) -> Array | None:
        """A change of some three sigma, so that what is not linear in its size is about as it would be."""
        try:
            for _ in range(MOST_STEPS):
                change = self._sizes.change_m(choice)
                raw = float(np.sqrt(np.mean((change[self._platform, :2] / self._sigma_m) ** 2)))
                if not raw > 0.0 or WANTED_RAW / 2.0 <= raw <= WANTED_RAW * 2.0:
                    break
                choice = replace(choice, size=choice.size * WANTED_RAW / raw)
        except (EffectError, NoEquilibrium):
            return None
        residual = self._residual_after_fit(change)
        return residual if raw > 0.0 and np.linalg.norm(residual) > 0.0 else None


@dataclass
class MimicLibraries:
    """One library a design, made when it is first asked for; draws: of each variant's further parameters.

    effects: those that it holds.
    """

    draws: int = DRAWS
    effects: Collection[str] = CATALOGUE
    _by_design: dict[str, Mimics] = field(default_factory=dict)

    def to_json(self, case: Case) -> dict[str, Any]:
        """The truth of a case; where it has a single effect, with the distances of all others from it."""
        if case.slot.kind not in KINDS:
            return case.truth
        library = self._by_design.get(case.drawn.name)
        if library is None:
            library = self._by_design[case.drawn.name] = Mimics(case.drawn, draws=self.draws, effects=self.effects)
        refine = REFINED.get(case.slot.kind, 0.0)
        distances = library.distances(case.truth["effects"][0], case.change_m, refine=refine)
        return {**case.truth, "mimics_sigma": distances}
