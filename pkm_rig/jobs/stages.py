"""The stages of the main job on their own: check, identify, compensate, and a stored campaign's outcome."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from rich.table import Table

from calibration.base.errors import InputError
from calibration.identification.calibration import Calibration, identify_recording, pose_u
from calibration.identification.estimators import Estimator
from calibration.identification.observability import HELD
from calibration.identification.prediction import monte_carlo, predict_poses, predict_tool
from calibration.recording.recording import Recording
from calibration.reduction.figures import figures
from calibration.reduction.reduction import CALIBRATION
from pkm_rig.jobs.calibrate import Outcome, Written, identified_summary, judge, last_attempt
from pkm_rig.jobs.diagnose import attempt
from pkm_rig.report.terminal import results
from pkm_rig.rig.fitness import check_rig, in_plane_u_m
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.store import Store

HELD_OUT_EVERY = 5
MOST_DRAWS = 200_000
MC_SEED = 1


def check(rig: Rig) -> dict[str, Any]:
    """Identities, units, interlocks and what is not fit."""
    state = rig.supervisor.state()
    identity = rig.station.identity
    return {
        "station": None if identity is None else {"name": identity.name, "serial": identity.serial},
        "drives": {
            drive.name: {
                "node_id": drive.node_id,
                "serial": None if drive.identity is None else drive.identity.serial,
                "metres_per_increment": drive.metres_per_increment,
                "limits_m": list(drive.limits_m),
                "heartbeat": drive.heartbeat().value,
            }
            for drive in rig.drives.drives
        },
        "interlocks": dict(state.interlocks),
        "payload": state.payload,
        "temperatures_c": dict(state.temperatures_c),
        "in_plane_u_m": in_plane_u_m(rig.file, rig.machine),
        "problems": check_rig(rig),
    }


def print_check(found: dict[str, Any]) -> None:
    """The same for people."""
    results.print(f"station: {found['station']}")
    for name, drive in found["drives"].items():
        results.print(
            f"drive {name}: node {drive['node_id']}, serial {drive['serial']}, "
            f"{drive['metres_per_increment'] * 1e9:g} nm an increment, heartbeat {drive['heartbeat']}"
        )
    for name, good in found["interlocks"].items():
        results.print(f"interlock {name}: {'good' if good else 'OPEN'}")
    results.print(f"payload: {found['payload']}")
    results.print(f"predicted in-plane uncertainty of a visit: {found['in_plane_u_m'] * 1e6:.1f} um")
    results.print("fit for a campaign" if not found["problems"] else "not fit")


def identify(recording: Recording, estimator: str, *, robust: bool = False, draws: int = 0) -> dict[str, Any]:
    """Identification with held-out error and posterior bound (docs/json.md); draws: of a Monte Carlo check."""
    if estimator not in get_args(Estimator):
        raise InputError(f"estimator '{estimator}' is unknown; use {', '.join(get_args(Estimator))}")
    chosen: Estimator = estimator  # type: ignore[assignment]
    if draws != 0 and not 2 <= draws <= MOST_DRAWS:
        raise InputError(f"monte carlo: {draws} draws; choose 0 (none) or 2 to {MOST_DRAWS}")
    identified = identify_recording(recording, chosen, baselines=False, robust=robust)
    held_out, bound = held_out_error(identified, chosen, robust=robust)
    return {
        "calibration": recording.file.campaign,
        **identified_summary(identified),
        "held_out": held_out,
        "bound": bound,
        **({"monte_carlo": cross_check(identified, draws)} if draws else {}),
    }


def cross_check(identified: Calibration, draws: int) -> dict[str, float]:
    """RMS standard uncertainty of the tool over the visited poses, linear and by Monte Carlo through the estimator."""
    fit = identified.fit
    stood = np.column_stack([fit.visits.target_m, fit.visits.payload_kg])
    visits = fit.visits.take(np.unique(stood, axis=0, return_index=True)[1])
    out: dict[str, float] = {"draws": draws}
    for name, found in (("linear", predict_tool(fit, visits)), ("drawn", monte_carlo(fit, visits, MC_SEED, draws))):
        out[f"{name}_u_position_m"] = float(np.sqrt(np.mean(np.sum(found.u[:, :3] ** 2, axis=1))))
        out[f"{name}_u_orientation_rad"] = float(np.sqrt(np.mean(np.sum(found.u[:, 3:] ** 2, axis=1))))
    return out


def held_out_error(
    identified: Calibration, estimator: Estimator, *, robust: bool = False
) -> tuple[dict[str, float], dict[str, float]]:
    """Every fifth pose left out of a refit: its measured error (noise included) and the refit's own bound."""
    reduction = identified.reduction
    held = (reduction.info.pose % HELD_OUT_EVERY == 0) & reduction.rows(CALIBRATION)
    if not np.any(held):
        raise InputError("held-out poses: no reading of them passed the gate; check which reflector is which")
    refit = identify_recording(_without_held_out(reduction.recording), estimator, baselines=False, robust=robust)
    visits = reduction.observations.visits.take(held)
    report = reduction.report
    predicted = predict_poses(refit.fit, report, visits)
    position, rotation = report.tool_error(reduction.poses.coordinates[held], predicted)
    found = figures(reduction.recording.machine, position, rotation, 0.0, 0.0)
    u_position, u_rotation = pose_u(replace(refit, reduction=reduction), visits)
    return (
        {"position_rms_m": found.position_rms_m, "orientation_rms_rad": found.orientation_rms_rad},
        {
            "position_rms_m": float(np.sqrt(np.mean(u_position**2))),
            "orientation_rms_rad": float(np.sqrt(np.mean(u_rotation**2))),
        },
    )


def _without_held_out(recording: Recording) -> Recording:
    """The recording without the calibration readings of every fifth pose."""
    calibration = np.asarray(recording["phase"]) == CALIBRATION
    drop = calibration & (recording["pose"].astype(int) % HELD_OUT_EVERY == 0)
    if np.all(drop[calibration]):
        raise InputError(f"recording {recording.file.campaign}: too few poses to hold any out; measure more")
    return replace(recording, columns={n: c[~drop] for n, c in recording.columns.items()})


def print_identified(found: dict[str, Any]) -> None:
    """Parameters and figures for people."""
    table = Table(box=None, pad_edge=False)
    for column in ("parameter", "deviation", "U (k = 2)", "unit", ""):
        table.add_column(column, justify="right" if column in ("deviation", "U (k = 2)") else "left")
    for name, p in found["parameters"].items():
        factor, unit = {"m": (1e6, "um"), "rad": (1e6, "urad")}.get(p["unit"], (1.0, ""))
        note = "held by its tolerance" if p["left"] > HELD else ""
        table.add_row(name, f"{p['value'] * factor:.3g}", f"{2 * p['u'] * factor:.2g}", unit, note)
    results.print(table)
    held, bound = found["held_out"], found["bound"]
    results.print(
        f"held-out poses: {held['position_rms_m'] * 1e6:.1f} um, {held['orientation_rms_rad'] * 1e6:.1f} urad "
        f"(measurement noise included; bound of the model alone {bound['position_rms_m'] * 1e6:.1f} um, "
        f"{bound['orientation_rms_rad'] * 1e6:.1f} urad)"
    )
    left_out, chi2 = sum(found["dropped"].values()), found["chi2_per_dof"]
    results.print(f"{found['estimator']}: chi-square per degree of freedom {chi2:.2f}, {left_out} readings left out")
    results.print(f"{found['rank']} of {len(found['parameters'])} directions decided by the data; left open:")
    for sentence in found["aliased"]:
        results.print(f"- {sentence}", soft_wrap=True, markup=False)
    for remark in found["remarks"]:
        results.print(f"note: {remark}", soft_wrap=True, markup=False)
    if "monte_carlo" in found:
        check = found["monte_carlo"]
        results.print(
            f"uncertainty of the tool: {check['linear_u_position_m'] * 1e6:.2f} um linear, "
            f"{check['drawn_u_position_m'] * 1e6:.2f} um by {check['draws']} Monte Carlo draws"
        )


def compensate(recording: Recording, payload: int, out: Path) -> dict[str, Any]:
    """Compute the tables for a payload at the campaign's last temperatures and save one CSV a drive."""
    if not 0 <= payload < len(recording.file.payloads):
        raise InputError(f"payload {payload}: the recording lists 0 to {len(recording.file.payloads) - 1}")
    identified = identify_recording(recording, baselines=False)
    temperatures = {n: float(t[-1]) for n, t in recording.temperatures_c().items()}
    table = identified.table(payload, temperatures)
    folder = out / recording.file.campaign / f"tables-payload-{payload}"
    folder.mkdir(parents=True, exist_ok=True)
    count = table.correction_m.shape[1]
    axes = [table.start_m[a] + table.step_m[a] * np.arange(count) for a in range(2)]
    largest = {}
    for a, drive in enumerate(recording.file.drives):
        with (folder / f"{drive}.csv").open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow([f"{name}_commanded_m" for name in recording.file.drives] + [f"{drive}_correction_m"])
            for i, first in enumerate(axes[0]):
                for j, second in enumerate(axes[1]):
                    row = (first, second, table.correction_m[a, i, j])
                    writer.writerow([repr(float(v)) for v in row])
        largest[drive] = float(np.max(np.abs(table.correction_m[a])))
    return {
        "campaign": recording.file.campaign,
        "payload_kg": table.load.payload_kg,
        "temperatures_c": temperatures,
        "largest_correction_m": largest,
        "folder": str(folder),
    }


def stored_outcome(store: Store, campaign: str) -> Outcome:
    """Rebuild the outcome of a verified campaign from the store."""
    recording = last_attempt(store, campaign)
    activated = store.events(campaign, "activated")
    verdicts = store.events(campaign, "accepted") + store.events(campaign, "refused")
    if not activated or not verdicts:
        raise InputError(f"campaign {campaign} was not verified; run `pkm-rig verify` first")
    identified = identify_recording(recording)
    written = tuple(
        Written(
            identified.table(event.data["payload"], event.data["temperatures_c"]),
            event.data["payload"],
            event.data["tables"],
        )
        for event in activated[-len({e.data["payload"] for e in activated}) :]
    )
    former = verdicts[-1].data.get("restored") or "the former tables"
    return judge(campaign, identified, recording, written, attempt(recording), former)
