"""The twin: the fitted model of a machine with the effects that a diagnosis found, to be simulated again.

It holds the campaign's own moments, by which the effects' forms are defined; what lies outside of them is held at
their limits. Geometry, mounting and effects are those of one solution, found together. It is data, not code: effects
are named, and their forms built anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.diagnosis.evidence import Readout
from calibration.diagnosis.linear_model import Baseline
from calibration.diagnosis.search import Cause
from calibration.diagnosis.twin import plain_data as twin_data
from calibration.diagnosis.twin.joint_fit import Joint, Solution, fit_before
from calibration.diagnosis.twin.twin_model import Added, Asked, Campaign, Fit, Told, places_m, visits_of
from calibration.effects.api import Acts, Setting
from calibration.effects.catalogue import Catalogue, load_catalogue
from calibration.effects.context import Moments, beside, held, remembered
from calibration.machine.description import Machine, parse_machine
from calibration.model.visits import Visits

# Readings of the campaign for each that is asked for at once: means that forms take of all rows stay the campaign's.
FOR_EACH = 40
MOST_TRIED = 50  # readings of the campaign on which a twin is tried when it is read


@dataclass(frozen=True)
class Twin:
    """The fitted machine and the effects that were added, over the campaign that found them."""

    campaign: Campaign
    fit: Fit
    added: tuple[Added, ...]
    catalogue: Catalogue

    @classmethod
    def of(cls, readout: Readout, causes: Sequence[Cause], setting: Setting) -> Twin:
        """The twin of a diagnosed recording."""
        return cls.by(Joint(readout, causes).solution, readout, causes, setting)

    @classmethod
    def by(cls, solution: Solution, readout: Readout, causes: Sequence[Cause], setting: Setting) -> Twin:
        """The twin of a solution."""
        baseline, added = readout.baseline, []
        for cause in causes:
            place = cause.effect.places(baseline.machine).index(cause.place)
            asked, onsets = Asked(setting.periods), Asked(setting.onsets)
            form = cause.best.form
            cause.effect.acts(replace(setting, periods=asked, onsets=onsets), place, form.curve)
            added.append(Added(cause.effect.name, place, form.columns, form.curve, (), asked.answers, onsets.answers))
        catalogue = Catalogue(tuple(cause.effect for cause in causes))
        bare = cls(_campaign(baseline), fit_before(baseline), tuple(added), catalogue)
        return bare.fitted(solution)

    def fitted(self, solution: Solution) -> Twin:
        """The same machine and effects by another solution."""
        added = tuple(
            replace(a, coefficients=tuple(c.tolist())) for a, c in zip(self.added, solution.coefficients, strict=True)
        )
        return replace(self, fit=solution.fit, added=added)

    @property
    def machine(self) -> Machine:
        """The nominal machine."""
        return self.campaign.machine

    @property
    def frame(self) -> Frame:
        """From the machine's frame to the station's."""
        return self.fit.frame

    def places_m(self, moments: Moments, rows: NDArray[np.intp] | None = None) -> Array:
        """Places (n, smrs, 3) of all reflectors in the machine's frame, at rows (n,) of the moments or at all of them.

        Moments that are not asked for are the past of those that are.
        """
        asked = np.arange(len(moments)) if rows is None else rows
        smrs = len(self.machine.smrs)
        flat = self.readings_m(moments, np.repeat(asked, smrs), np.tile(np.arange(smrs), len(asked)))
        return flat.reshape(len(asked), smrs, 3)

    def readings_m(self, moments: Moments, rows: NDArray[np.intp], smr: NDArray[np.intp]) -> Array:
        """Places (n, 3) of reflectors smr (n,) in the machine's frame at rows (n,) of the moments."""
        different, row = np.unique(rows, return_inverse=True)
        visits = visits_of(self.machine, moments).take(different)
        with np.errstate(all="ignore"):
            poses = self.campaign.poses(self.fit, visits)
            out = places_m(self.machine, poses, self.fit.mounted_m, smr, row)
            if self.added:
                before = replace(visits, target_m=poses.equilibrium.coordinates())
                out += self._shift_m(moments, before, rows, smr, row)
        if not np.all(np.isfinite(out)):
            raise InputError("twin: a place is not a finite number; make it again with diagnose --add")
        return out

    def _shift_m(
        self, moments: Moments, visits: Visits, rows: NDArray[np.intp], smr: NDArray[np.intp], row: NDArray[np.intp]
    ) -> Array:
        """What the effects add to the places (n, 3)."""
        own = held(self.campaign.moments, moments)
        poses = self.campaign.model.predict(self.campaign.at.values, visits)
        if not np.all(poses.equilibrium.converged):
            poses = self.campaign.poses(self.campaign.at, visits)
        channels, setting = self.campaign.linear_at(poses, own, smr, row)
        memory = remembered(own, moments)
        out = np.zeros((len(rows), 3))
        at_once = max(1, len(self.campaign.moments) // FOR_EACH)
        for first in range(0, len(rows), at_once):
            part = np.arange(first, min(first + at_once, len(rows)))
            together = self._together(setting, part, beside(self.campaign.memory, own, memory, rows[part]))
            for added in self.added:
                for act, coefficient in zip(self._acts(together, added), added.coefficients, strict=True):
                    for channel, shape in act:
                        out[part] += coefficient * channels.shift_m(channel)[part] * shape[-len(part) :, None]
        return out

    def _together(self, asked: Setting, part: NDArray[np.intp], moments: Moments) -> Setting:
        """The setting of the campaign's readings, then of some that are asked for, held within the campaign's."""
        known = self.campaign.setting

        def both(name: str) -> Array:
            first, then = getattr(known, name), getattr(asked, name)[part]
            return np.concatenate([first, np.clip(then, first.min(axis=0), first.max(axis=0))])

        return replace(
            known,
            moments=moments,
            tension_n=both("tension_n"),
            answer_n_per_m=both("answer_n_per_m"),
            pull_n=both("pull_n"),
            moment_nm=both("moment_nm"),
            sight_m=both("sight_m"),
        )

    def _acts(self, setting: Setting, added: Added) -> list[Acts]:
        effect = next(e for e in self.catalogue.effects if e.name == added.effect)
        told = replace(setting, periods=Told(added.periods_m), onsets=Told(added.onsets_s))
        acts = effect.acts(told, added.place, added.curve)
        return [acts[c] for c in added.columns]

    def to_data(self) -> dict[str, Any]:
        """Plain data for a JSON file."""
        return twin_data.to_data(self.campaign, self.fit, self.added)

    @classmethod
    def from_data(cls, machine_text: str, data: Mapping[str, Any], catalogue: Catalogue | None = None) -> Twin:
        """The twin of what `to_data` gave. InputError in one line where it is not fit."""
        machine = parse_machine(machine_text, "twin")
        catalogue = catalogue or load_catalogue()
        campaign, fit, added = twin_data.from_data(machine, data, catalogue)
        twin = cls(campaign, fit, added, catalogue)
        twin._try()
        return twin

    def _try(self) -> None:
        """Use everything once: what is not fit shows here, not while the twin is served."""
        try:
            rows = np.unique(np.linspace(0, len(self.campaign.smr) - 1, MOST_TRIED).astype(np.intp))
            self.readings_m(self.campaign.moments, rows, self.campaign.smr[rows])
        except InputError:
            raise
        except Exception as error:  # an effect of one's own may raise anything
            line = " ".join(str(error).split())
            raise InputError(
                f"twin: {type(error).__name__}: {line}; make it again with diagnose --add and the same effects"
            ) from error


def _campaign(baseline: Baseline) -> Campaign:
    return Campaign(
        baseline.machine, baseline.moments, baseline.smr, baseline.visit, baseline.poses.equilibrium.coordinates(),
        fit_before(baseline),
    )  # fmt: skip
