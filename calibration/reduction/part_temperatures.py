"""What temperatures the parts had, from sensors that scatter, round, and at times read something else.

A part is too heavy to be another from one visit to the next and back again. What its sensor says to the contrary is
the sensor's own, and would move the model by some 10 um for each kelvin and metre: it is taken out before anything
else is computed (docs/decisions/0071-what-a-temperature-sensor-says.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.local_level import local_level
from calibration.base.rounded_values import NORMAL, rounding_step
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.recording.recording import Recording

LEAST_VISITS = 4  # with fewer nothing tells which of the values are wrong
LEAST_STEPS, LARGEST_STEP_K = 1, 1.0  # of a grid to which a sensor rounds: a campaign may see few steps of it
NEIGHBOURS = 9  # visits before and after, by whose medians a value is judged: half of them may be wrong as well
FAR_K, FAR_SIGMAS = 1.0, 8.0  # beyond both a sensor reads something else than its part's temperature
MOST_FAR = 0.1  # of a campaign's visits, or one: more are no exceptions
WORTH_SAYING_K = 0.05
MOST_NAMED = 5  # visits in a remark


@dataclass(frozen=True)
class PartSensor:
    """What is known of a sensor. scatter_k: standard deviation of one value, its rounding included. u_k: standard
    uncertainty of the part's temperature by all of them. elsewhere (k,): visits at which it read something else, in
    order of time; farthest_k: by how much at most."""

    scatter_k: float
    u_k: float
    elsewhere: NDArray[np.intp]
    farthest_k: float


def most_likely_temperatures(recording: Recording) -> tuple[Recording, dict[str, PartSensor]]:
    """The recording with the temperatures that its parts most likely had, and what is known of their sensors.

    One temperature for each visit: what is read during one is taken together.
    """
    t_s = recording["t_rig_s"]
    order = np.argsort(t_s, kind="stable")
    visit = recording["visit"][order]
    begins = np.diff(visit, prepend=np.nan) != 0.0
    of_visit = np.cumsum(begins) - 1
    count = np.bincount(of_visit)
    of_visit_s, number = np.bincount(of_visit, t_s[order]) / count, visit[begins].astype(np.intp)
    of_row = of_visit[np.argsort(order)]
    columns, sensors = dict(recording.columns), dict[str, PartSensor]()
    for name, values_c in recording.temperatures_c().items():
        mean_c = np.bincount(of_visit, values_c[order]) / count
        if len(mean_c) >= LEAST_VISITS and np.ptp(values_c) > 0.0:
            course_c, sensors[name] = _most_likely(of_visit_s, mean_c, values_c, number)
            columns[f"{name}_temperature_c"] = course_c[of_row]
    return replace(recording, columns=columns), sensors


def most_likely_temperatures_of_folder(measured: MeasuredMachine) -> tuple[MeasuredMachine, dict[str, PartSensor]]:
    """The same of a measurement folder, if it says when its visits were."""
    temperatures, sensors = dict(measured.visits.temperatures_c), dict[str, PartSensor]()
    if "t_rig_s" not in measured.conditions or len(measured.visits) < LEAST_VISITS:
        return measured, sensors
    order = np.argsort(measured.conditions["t_rig_s"], kind="stable")
    t_s, number = measured.conditions["t_rig_s"][order], measured.number[order].astype(np.intp)
    for name in measured.sensors:
        values_c = temperatures[name][order]
        if np.ptp(values_c) > 0.0:
            course_c, sensors[name] = _most_likely(t_s, values_c, values_c, number)
            temperatures[name] = course_c[np.argsort(order)]
    return replace(measured, visits=replace(measured.visits, temperatures_c=temperatures)), sensors


def remarks_on_sensors(sensors: Mapping[str, PartSensor]) -> tuple[str, ...]:
    """A line on each sensor that read something else, and on each that scatters so much that it matters."""
    out = []
    for name, sensor in sensors.items():
        if count := len(sensor.elsewhere):
            named = ", ".join(map(str, sensor.elsewhere[:MOST_NAMED].tolist())) + ", ..." * (count > MOST_NAMED)
            out.append(
                f"temperature sensor '{name}' is up to {sensor.farthest_k:.3g} K off what it read before and after at "
                f"{count} visit{'s' * (count > 1)} ({named}): not used there; check the sensor and its cable"
            )
        if sensor.scatter_k > WORTH_SAYING_K:
            out.append(
                f"temperature sensor '{name}' scatters by {sensor.scatter_k:.2g} K: the course that all its values "
                f"say together was used, known to {sensor.u_k:.2g} K (standard uncertainty)"
            )
    return tuple(out)


def _most_likely(t_s: Array, mean_c: Array, values_c: Array, number: NDArray[np.intp]) -> tuple[Array, PartSensor]:
    """Temperatures (v,) at the times of visits (v,), from the means of what was read there; number (v,): of visits."""
    off_k = _off_neighbours_k(mean_c)
    far = np.abs(off_k) > max(FAR_K, FAR_SIGMAS * NORMAL * float(np.median(np.abs(off_k))))
    if far.sum() > max(1.0, MOST_FAR * len(far)):
        far[:] = False
    step_k = rounding_step(values_c, LEAST_STEPS)
    rounding_k = step_k / np.sqrt(12.0) if step_k <= LARGEST_STEP_K else 0.0
    found = local_level(t_s[~far], mean_c[~far], rounding_k)
    u_k = float(np.sqrt(np.mean(found.deviation**2)))
    if found.noise <= rounding_k:  # nothing but rounding, which is the same from visit to visit
        u_k = max(u_k, rounding_k)
    sensor = PartSensor(found.noise, u_k, number[far], float(np.max(np.abs(off_k[far]), initial=0.0)))
    return np.interp(t_s, t_s[~far], found.level), sensor


def _off_neighbours_k(mean_c: Array) -> Array:
    """How far values (v,) are off the medians of those before and of those after, whichever is nearer; of a check's few
    visits off the median of all, since a part warms little during one."""
    if len(mean_c) <= 2 * NEIGHBOURS:
        return mean_c - float(np.median(mean_c))
    medians = np.median(sliding_window_view(mean_c, NEIGHBOURS), axis=1)  # of those that begin at each
    off = np.full((2, len(mean_c)), np.inf)
    off[0, NEIGHBOURS:] = mean_c[NEIGHBOURS:] - medians[:-1]
    off[1, :-NEIGHBOURS] = mean_c[:-NEIGHBOURS] - medians[1:]
    return np.where(np.abs(off[0]) < np.abs(off[1]), off[0], off[1])
