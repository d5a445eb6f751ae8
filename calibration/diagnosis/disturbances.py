"""The ordinary disturbances that a recording declares for its rig: columns with the declared standard deviations.

Levels are those of docs/reference/definitions.md; a disturbance that is not declared has no column.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.observed_model import ObservedModel, whitened_shift
from calibration.effects.basis_functions import fourier_basis, principal_columns, random_walk_basis
from calibration.machine.description import PARTS
from calibration.recording.header import DRIFT_LEVER_M, HOUR_S, AccuracyEntry, DisturbanceLevels
from calibration.reduction.part_temperatures import PartSensor

STRUT_WEIGHT_SHARE = 0.05  # of the moving mass: standard deviation of a strut's own weight at its platform joint
# What of a disturbance is finer than its columns looks like something else, so a long campaign has more of them.
WALK_TERMS_PER_HOUR, LEAST_WALK_TERMS, MOST_WALK_TERMS = 10.0, 24, 96
LEAST_PAUSE_H, MOST_PAUSES = 1.0, 24  # between two readings, over which a walk is one step: the longest ones
SHORTEST_WAVE_S = 1500.0
WAVE_SPACING, LEAST_WAVE_PAIRS, MOST_WAVE_COLUMNS = 0.9, 8, 80  # spacing of frequencies in periods over the campaign
MOST_PAIRS = 200  # of which the most varying columns are taken: enough for three days
LEAST_U_K = 0.02  # of a part's temperature by its sensor: with less, what parts differ in by themselves is more


def disturbance_columns(
    observed: ObservedModel,
    whiten: Array,
    levels: DisturbanceLevels,
    accuracy: AccuracyEntry,
    nest_limit_m: float,
    sensors: Mapping[str, PartSensor],
) -> tuple[Array, tuple[str, ...]]:
    """Columns (n, 3, k), whitened by (n, 3, 3), each times its standard deviation, and their names."""
    named = _Columns(observed, whiten)
    _add_weights(named)
    _add_station(named, levels, accuracy, nest_limit_m)
    _add_machine(named, levels)
    _add_sensors(named, sensors)
    return named.stacked()


def machine_disturbance_columns(
    observed: ObservedModel, whiten: Array, levels: DisturbanceLevels, sensors: Mapping[str, PartSensor]
) -> tuple[Array, tuple[str, ...]]:
    """The same without those of a station: columns (n, w, k), whitened by (n, w, 3).

    What depends on a time or a side that the readings do not say has none.
    """
    named = _Columns(observed, whiten)
    _add_weights(named)
    depends_on = {"temperature_k": "t_s", "reversal_m": "direction"}
    none = {level: 0.0 for level, field in depends_on.items() if field in observed.context.not_said}
    _add_machine(named, levels.model_copy(update=none))
    _add_sensors(named, sensors)
    return named.stacked()


class _Columns:
    """Columns of an observed model, one after the other, with their names."""

    def __init__(self, observed: ObservedModel, whiten: Array) -> None:
        self.observed, self.channels = observed, Channels(observed)
        self._whiten = whiten
        self._columns: list[tuple[str, Array]] = []

    def add(self, channel: str, shapes: Array, label: str) -> None:
        """Shapes (n, k) that act through a channel."""
        response = whitened_shift(self._whiten, self.observed.frame, self.channels.shift_m(channel))
        for k in range(shapes.shape[1]):
            self._columns.append((f"{label}.{channel}.{k}", response * shapes[:, k : k + 1]))

    def add_places(self, shift_m: Array, groups: Array, label: str) -> None:
        """One shift (n, 3) in the machine's frame for each group (n, k) of readings."""
        shift = whitened_shift(self._whiten, self.observed.frame, shift_m)
        for k in np.flatnonzero(np.any(groups & np.any(shift_m != 0.0, axis=1)[:, None], axis=0)):
            self._columns.append((f"{label}.{k}", shift * groups[:, k : k + 1]))

    def stacked(self) -> tuple[Array, tuple[str, ...]]:
        """All columns (n, w, k) and their names."""
        return np.stack([column for _, column in self._columns], axis=2), tuple(name for name, _ in self._columns)


def _add_weights(named: _Columns) -> None:
    """A strut's own weight counts as geometry: calibration absorbs it, and it is never a cause."""
    machine, count = named.observed.machine, len(named.observed.context)
    for strut in machine.strut_names:
        named.add(f"weight.{strut}", np.full((count, 1), STRUT_WEIGHT_SHARE * machine.moving_mass_kg), "inside")


def _add_station(named: _Columns, levels: DisturbanceLevels, accuracy: AccuracyEntry, nest_limit_m: float) -> None:
    """The station's frame walks and is another after a break; reflectors are put back."""
    observed, channels, context = named.observed, named.channels, named.observed.context
    walk = drift_walk(context.elapsed_s)
    steps = (context.t_s[:, None] >= np.array(context.breaks_s)).astype(np.float64)
    for name in channels.station_channels():
        axis = name.rsplit(".", 1)[1]
        named.add(name, walk * drift_per_sqrt_h(axis, levels, accuracy), "drift")
        named.add(name, steps * (nest_limit_m / DRIFT_LEVER_M if axis.startswith("r") else nest_limit_m), "break")
    if levels.reseat_m > 0.0:
        numbers = np.unique(context.exchanges)[1:]
        after_exchange = (context.exchanges[:, None] == numbers).astype(np.float64) * levels.reseat_m
        for i in sorted(set(observed.smr[observed.on_platform].tolist())):
            for name in channels.reflector_channels(i, channels.axes_of_motion):
                named.add(name, after_exchange, "reseat")
        _add_other_seats(named, levels.reseat_m)


def _add_other_seats(named: _Columns, reseat_m: float) -> None:
    """Reflectors on sliders may be put back at an exchange too, and those on the platform of a planar machine also lie
    elsewhere across its plane.

    How far is not estimated: where reflectors stay, these would say that those that are put back do.
    """
    observed, context = named.observed, named.observed.context
    exchanges = context.exchanges[:, None] == np.unique(context.exchanges)[1:]
    in_plane = named.channels.axes_of_motion
    for i, smr in enumerate(observed.machine.smrs):
        for axis in range(3):
            if smr.on != "floor" and (smr.on != "platform" or axis not in in_plane):
                shift_m = np.zeros((len(context), 3))
                shift_m[observed.smr == i, axis] = reseat_m
                named.add_places(shift_m, exchanges, f"seat.{smr.name}.{'xyz'[axis]}")


def _add_machine(named: _Columns, levels: DisturbanceLevels) -> None:
    """Half the loop of each drive at reversal, slow waves of temperature."""
    machine, context = named.observed.machine, named.observed.context
    if levels.reversal_m > 0.0:
        for a, drive in enumerate(machine.drive_names):
            named.add(f"travel.{drive}", context.direction[:, a : a + 1] * levels.reversal_m, "reversal")
    if levels.temperature_k > 0.0:
        waves = temperature_waves(context.elapsed_s) * levels.temperature_k
        for i, strut in enumerate(machine.strut_names):
            grown = machine.expansion_per_k["struts"] * machine.nominal.length_m[i]
            named.add(f"length.{strut}", waves * grown, "temperature")
        for a, drive in enumerate(machine.drive_names):
            grown = machine.expansion_per_k["drives"] * context.drives[:, a : a + 1]
            named.add(f"travel.{drive}", waves * grown, "temperature")


def _add_sensors(named: _Columns, sensors: Mapping[str, PartSensor]) -> None:
    """What sensors that scatter or round leave uncertain of whole parts, in waves like those of temperature."""
    machine = named.observed.machine
    for part in PARTS:
        sensor = sensors.get(machine.sensors[part])
        if sensor is not None and sensor.u_k > LEAST_U_K:
            waves = temperature_waves(named.observed.context.elapsed_s) * sensor.u_k
            named.add(f"growth.{part}", waves * machine.expansion_per_k[part], "sensor")


def drift_walk(elapsed_s: Array) -> Array:
    """Columns (n, k) of a random walk of unit variance after an hour, at the times (n,) of a campaign.

    What it does from one reading to the next does not depend on what it did before, so that a pause is one step of it,
    and the columns are for the time in which something is read.
    """
    hours = elapsed_s / HOUR_S
    in_order = np.sort(hours)
    waited = np.diff(in_order)
    longest = np.argsort(-waited, kind="stable")[:MOST_PAUSES]
    pauses = longest[waited[longest] > LEAST_PAUSE_H]
    after = (hours[:, None] >= in_order[pauses + 1]).astype(np.float64)
    at_work = hours - after @ waited[pauses]
    terms = np.clip(np.ceil(WALK_TERMS_PER_HOUR * np.ptp(at_work)), LEAST_WALK_TERMS, MOST_WALK_TERMS)
    return np.column_stack([random_walk_basis(at_work, int(terms)), after * np.sqrt(waited[pauses])])


def temperature_waves(elapsed_s: Array) -> Array:
    """The same of waves of unit RMS in all, between which no other wave is missed while something is read."""
    pairs = np.ceil(np.ptp(elapsed_s) / SHORTEST_WAVE_S / WAVE_SPACING) + 1.0
    waves = fourier_basis(elapsed_s, SHORTEST_WAVE_S, int(np.clip(pairs, LEAST_WAVE_PAIRS, MOST_PAIRS)))
    return principal_columns(waves, MOST_WAVE_COLUMNS)


def drift_per_sqrt_h(axis: str, levels: DisturbanceLevels, accuracy: AccuracyEntry) -> float:
    """Drift of the station's frame about or along an axis ('rx' ... 'z') after an hour, declared and stated."""
    declared_m = levels.drift_m / np.sqrt(2.0)
    if not axis.startswith("r"):
        return float(np.hypot(accuracy.drift_m_per_sqrt_h, declared_m))
    stated_rad = accuracy.drift_rad_per_sqrt_h if axis == "rz" else accuracy.drift_of_level_rad_per_sqrt_h
    return float(np.hypot(stated_rad, declared_m / DRIFT_LEVER_M))
