"""Makes one case: draws machine, campaign and faults, carries them out with and without each, writes both down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.emergent.campaign import Campaign, CarriedOut, Disturbances, Kept, carry_out, draw_campaign, timeline
from benchmarks.emergent.cases import Plan
from benchmarks.emergent.disturbances import PROFILES, drift, on_machine, reseated_m
from benchmarks.emergent.faults import ON_DRIVES, Fault, draw_fault, drive_parts, strut_parts
from benchmarks.emergent.machines import NOMINAL, draw_machine, machine_file
from benchmarks.emergent.readings import ANGLE_SD_RAD, RANGE_SD_M, STATION_M, draw_station, recording_files
from benchmarks.emergent.sizes import Sizes
from benchmarks.emergent.statics import hang
from benchmarks.emergent.strut_model import Machine
from benchmarks.independent.pack import write_case

Array = NDArray[np.float64]

RAW, VISIBLE = (3.3, 7.0), 1.0  # sigma: wanted, and at least
THINNED, ROUNDS = 7, 3  # an odd step: targets come from either side in turn
STRESS_ROUNDS = 3


def make_case(plan: Plan, cases: Path, every: int = 1) -> str:
    """Make a case below `cases`, of each so many-th visit; its name. The same bytes for the same plan."""
    rng = np.random.default_rng(plan.seed)
    machine, station = draw_machine(rng), draw_station(rng)
    campaign = draw_campaign(NOMINAL, plan.style, rng).thinned(every)
    faults: list[Fault] = []
    for cause in plan.causes:
        taken = [a for fault in faults if fault.on == ON_DRIVES for a in fault.at]
        faults.append(draw_fault(cause, rng, not_at=taken if len(taken) == 1 else ()))
    if len(faults) > 1:
        faults = [replace(fault, at=fault.at[:1]) for fault in faults]
        faults[1] = _elsewhere(faults[0], faults[1])
    for fault in faults:
        if fault.cause == "clearance":
            machine = _relieved(machine, campaign, fault.at[0])
    wanted = [float(np.exp(rng.uniform(*np.log(RAW)))) for _ in faults]
    faults = [_to_size(fault, machine, campaign, size) for fault, size in zip(faults, wanted, strict=True)]

    levels = PROFILES[plan.profile]
    visits, reflectors, _ = campaign.of_reading
    t_s, exchanges = timeline(campaign)
    sides = np.array([visit.directions for visit in campaign.visits])[visits]
    always = on_machine(levels, t_s, sides, campaign.drives_m[visits], rng)
    kept: Kept = {}
    made = _run(machine, campaign, faults, (), always, kept)
    sizes = _sizes(machine, campaign)
    facts = [_fact(fault, sizes, _change(machine, campaign, faults, fault, always, kept)) for fault in faults]
    turns, shifts = drift(levels, t_s, rng)
    places = made.places_m + reseated_m(levels, exchanges, reflectors, rng)
    clean = station.sees(places, turns, shifts)
    files = recording_files(plan.name, campaign, clean, made.motor_n, levels, machine_file(), rng)
    on_platform = reflectors < 3
    entry = {
        "kind": plan.kind, "campaign": plan.style, "disturbances": plan.profile,
        "sigma_m": float(np.mean(sizes.sigma_m[on_platform])), "effects": facts,
    }  # fmt: skip
    write_case(cases / plan.name, files, entry, {"clean_m": clean, "platform": on_platform})
    return plan.name


def _run(
    machine: Machine, campaign: Campaign, faults: Sequence[Fault], good: Sequence[Fault], always: Disturbances,
    kept: Kept | None = None,
) -> CarriedOut:  # fmt: skip
    return carry_out(machine, campaign, drive_parts(faults, good), strut_parts(faults, good), always, kept)


def _change(
    machine: Machine, campaign: Campaign, faults: Sequence[Fault], fault: Fault, always: Disturbances, kept: Kept
) -> Array:
    """Change (r, 3) of the places by a fault. What a drive does at every reading alike is its zero."""
    made, good = (_run(machine, campaign, faults, repaired, always, kept) for repaired in ((), (fault,)))
    if fault.on == ON_DRIVES:
        zero = np.mean(made.off_m - good.off_m, axis=0)
        good = _run(machine, campaign, faults, (fault,), replace(always, travel_m=always.travel_m + zero), kept)
    return made.places_m - good.places_m


def _sizes(machine: Machine, campaign: Campaign) -> Sizes:
    return Sizes(machine, campaign, ANGLE_SD_RAD, RANGE_SD_M, STATION_M)


def _fact(fault: Fault, sizes: Sizes, change_m: Array) -> dict[str, Any]:
    """What the table of truths says of a fault; sizes are those of the group that moves most, and of the platform."""
    raw, visible = sizes.raw(change_m), sizes.visible(change_m)
    return {
        "effect": fault.effect, "cause": fault.cause, "places": fault.places,
        "raw_sigma": round(max(raw), 4), "visible_sigma": round(max(visible), 4),
        "raw_platform_sigma": round(raw[0], 4), "visible_platform_sigma": round(visible[0], 4),
        "part": {name: value for name, value in fault.with_.items() if np.isfinite(value)},
    }  # fmt: skip


def _to_size(fault: Fault, machine: Machine, campaign: Campaign, wanted: float) -> Fault:
    """The fault so large that a part of the campaign shows about the wanted raw size, and VISIBLE at least."""
    few = campaign.thinned(THINNED)
    visits, _, _ = few.of_reading
    calm = Disturbances(np.zeros((len(visits), 2)), np.zeros((len(visits), 4)))
    sizes, kept = _sizes(machine, few), Kept()
    for _ in range(ROUNDS):
        change = _change(machine, few, [fault], fault, calm, kept)
        raw, visible = max(sizes.raw(change)), max(sizes.visible(change))
        factor = max(wanted / max(raw, 1e-3), VISIBLE / max(visible, 1e-3))
        if abs(np.log(factor)) < 0.1:
            break
        fault = fault.sized(float(np.clip(factor, 0.15, 6.0)))
    return fault


def _relieved(machine: Machine, campaign: Campaign, strut: int) -> Machine:
    """The machine so assembled that a strut is now pulled and now pressed: four struts may strain one another."""
    for _ in range(STRESS_ROUNDS):
        _, tension = hang(machine, campaign.drives_m, campaign.payload)
        step = np.zeros_like(machine.length_m)
        step[strut] = 1e-6
        other = hang(replace(machine, length_m=machine.length_m + step), campaign.drives_m, campaign.payload)[1]
        slope = float(np.median(other[:, strut] - tension[:, strut])) / 1e-6
        machine = replace(
            machine, length_m=machine.length_m - step / 1e-6 * float(np.median(tension[:, strut])) / slope
        )
    return machine


def _elsewhere(first: Fault, second: Fault) -> Fault:
    """The second at another drive than the first."""
    if ON_DRIVES == first.on == second.on and first.at == second.at:
        return replace(second, at=(1 - first.at[0],))
    return second
