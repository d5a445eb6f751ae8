"""Contexts put together: the campaign's readings and those that are asked of it later, or of its twin.

What a campaign's columns are does not change with what else is asked: whatever is new is clipped to its range.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.effects.context import ARRAYS, NOT_CLIPPED, ArrivalHistory, ReadingContext


def clip_to_campaign(campaign: ReadingContext, context: ReadingContext) -> ReadingContext:
    """Another context clipped to the range that the campaign covers; its time counts from the campaign's start."""
    offset_s = campaign.start_s - context.start_s
    shifted = replace(context, t_s=context.t_s + offset_s)

    def clip(name: str) -> Array:
        campaign_values = getattr(campaign, name)
        return np.clip(getattr(shifted, name), campaign_values.min(axis=0), campaign_values.max(axis=0))

    clipped: dict[str, Any] = {name: clip(name) for name in ARRAYS if name not in NOT_CLIPPED}
    air = campaign.temperatures_c["air"]
    temperatures = {
        name: np.clip(context.temperatures_c.get(name, np.full(len(context), air.mean())), t.min(), t.max())
        for name, t in campaign.temperatures_c.items()
    }
    history = ArrivalHistory(context.history.arrived_s + offset_s, context.history.drives)
    return replace(
        context,
        history=history,
        start_s=campaign.start_s,
        temperatures_c=temperatures,
        known_tables=campaign.known_tables,
        **clipped,
    )


def append_context(campaign: ReadingContext, later: ReadingContext) -> ReadingContext:
    """The campaign's readings followed by later ones, whose history includes the campaign's arrivals."""
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(campaign, name), getattr(later, name)]) for name in ARRAYS if name != "arrival"
    }
    return replace(
        campaign,
        history=_concatenate(campaign.history, later.history),
        arrival=np.concatenate([campaign.arrival, later.arrival + len(campaign.history.arrived_s)]),
        temperatures_c={n: np.concatenate([t, later.temperatures_c[n]]) for n, t in campaign.temperatures_c.items()},
        **arrays,
    )


def _concatenate(first: ArrivalHistory, second: ArrivalHistory) -> ArrivalHistory:
    return ArrivalHistory(
        np.concatenate([first.arrived_s, second.arrived_s]), np.concatenate([first.drives, second.drives])
    )


class CachedContext:
    """A context whose history-dependent quantities are computed once."""

    def __init__(self, context: ReadingContext) -> None:
        self.context = context
        self._motion_heat: dict[tuple[int, float], Array] = {}
        self._thermal_lag_k: dict[tuple[str, float], Array] = {}

    def motion_heat(self, drive: int, tau_s: float) -> Array:
        """As `ReadingContext.motion_heat`."""
        key = (drive, tau_s)
        if key not in self._motion_heat:
            self._motion_heat[key] = self.context.motion_heat(drive, tau_s)
        return self._motion_heat[key]

    def thermal_lag_k(self, sensor: str, tau_s: float) -> Array:
        """As `ReadingContext.thermal_lag_k`."""
        key = (sensor, tau_s)
        if key not in self._thermal_lag_k:
            self._thermal_lag_k[key] = self.context.thermal_lag_k(sensor, tau_s)
        return self._thermal_lag_k[key]


def cached_context(clipped: ReadingContext, context: ReadingContext) -> CachedContext:
    """The cache of a context in its own time, but with temperatures and air of its clipped version."""
    return CachedContext(
        replace(context, temperatures_c=clipped.temperatures_c, air_refractivity=clipped.air_refractivity)
    )


@dataclass(frozen=True)
class CombinedContext(ReadingContext):
    """The campaign's readings followed by rows of another context.

    Each part keeps its own history; history-dependent quantities are clipped to the range that the campaign covers.
    """

    campaign: CachedContext
    other: CachedContext
    rows: NDArray[np.intp]

    @property
    def previous_drives(self) -> Array:
        """Drive coordinates (n, d) at the previous arrival."""
        campaign = self.campaign.context
        requested = self.other.context.previous_drives[self.rows]
        clipped = np.clip(requested, campaign.drives.min(axis=0), campaign.drives.max(axis=0))
        return np.concatenate([campaign.previous_drives, clipped])

    def motion_heat(self, drive: int, tau_s: float) -> Array:
        """Heat of a drive's own motion (n,)."""
        return self._concatenate_clipped(self.campaign.motion_heat(drive, tau_s), self.other.motion_heat(drive, tau_s))

    def way_m(self, drive: int) -> Array:
        """Distance (n,) that a drive has moved."""
        return self._concatenate_clipped(self.campaign.context.way_m(drive), self.other.context.way_m(drive))

    def dragged(self, drive: int, width_m: float) -> Array:
        """Where (n,) a part lies that a drive drags along."""
        campaign, other = self.campaign.context, self.other.context
        return self._concatenate_clipped(campaign.dragged(drive, width_m), other.dragged(drive, width_m))

    def worn_beyond(self, load: Array, share: float) -> Array:
        """What (n,) the visits so far have had of a load beyond that of a share of all; of the other readings as much
        as at the same time of the campaign, since not all of their visits are asked for."""
        campaign = self.campaign.context
        count, order = len(campaign), np.argsort(campaign.t_s, kind="stable")
        worn = campaign.worn_beyond(load[:count], share)
        later = np.interp(self.t_s[count:], campaign.t_s[order], worn[order])
        return np.concatenate([worn, later])

    def mean_temperature_c(self) -> Array:
        """Mean (n,) of all recorded temperatures."""
        mean_c = super().mean_temperature_c()
        of_campaign = mean_c[: len(self.campaign.context)]
        return np.clip(mean_c, of_campaign.min(), of_campaign.max())

    def thermal_lag_k(self, sensor: str, tau_s: float) -> Array:
        """Temperature of a part of time constant tau_s minus its sensor (n,)."""
        return self._concatenate_clipped(
            self.campaign.thermal_lag_k(sensor, tau_s), self.other.thermal_lag_k(sensor, tau_s)
        )

    def part_temperature_k(self, sensor: str, tau_s: float) -> Array:
        """Change (n,) since the campaign's start, of a part that follows a sensor with a time constant."""
        change = super().part_temperature_k(sensor, tau_s)
        of_campaign = change[: len(self.campaign.context)]
        return np.clip(change, of_campaign.min(), of_campaign.max())

    def refractivity_change(self, delay_s: float) -> Array:
        """Refractivity (n,) of the recorded air less that of delay_s before."""
        campaign, other = self.campaign.context, self.other.context
        return self._concatenate_clipped(campaign.refractivity_change(delay_s), other.refractivity_change(delay_s))

    def _concatenate_clipped(self, of_campaign: Array, of_other: Array) -> Array:
        return np.concatenate([of_campaign, np.clip(of_other[self.rows], of_campaign.min(), of_campaign.max())])


def combine_contexts(
    campaign: CachedContext, clipped: ReadingContext, other: CachedContext, rows: NDArray[np.intp]
) -> CombinedContext:
    """The campaign's readings followed by rows (m,) of another context; neither is part of the other's history.

    clipped: the other context as `clip_to_campaign` returns it; other: its cache, in its own time.
    """
    first = campaign.context
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(first, name), getattr(clipped, name)[rows]]) for name in ARRAYS
    }
    arrays["arrival"][len(first) :] += len(first.history.arrived_s)
    return CombinedContext(
        history=_concatenate(first.history, clipped.history),
        temperatures_c={
            n: np.concatenate([t, clipped.temperatures_c[n][rows]]) for n, t in first.temperatures_c.items()
        },
        start_s=first.start_s,
        breaks_s=first.breaks_s,
        known_tables=first.known_tables,
        missing=first.missing,
        campaign=campaign,
        other=other,
        rows=rows,
        **arrays,
    )
