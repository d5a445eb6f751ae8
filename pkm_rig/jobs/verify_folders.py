"""Whether a control's correction helps: two campaigns of the same visits, without and with it."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.recording.recording import Recording
from calibration.reduction.figures import figure_axes, visit_figures
from calibration.reduction.reduction import CALIBRATION, Reduction, reduce
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.acceptance import decide

FIRST_POSES = 3
SAME_TARGET = 1e-6  # m or rad
GREW = 1.0  # ratio of the errors at the first poses above which the correction makes things worse
DOUBLED = (1.6, 2.5)  # about twice: what a correction of the wrong sign does


def pose_errors(reduction: Reduction) -> dict[int, float]:
    """Pose number to its RMS position error (m) over the visits of the calibration."""
    rows = np.flatnonzero(reduction.rows(CALIBRATION))
    position = reduction.errors(np.isin(np.arange(len(reduction.info.phase)), rows))[0]
    square = np.sum(position[:, figure_axes(reduction.recording.machine)[0]] ** 2, axis=1)
    pose = reduction.info.pose[rows]
    return {int(p): float(np.sqrt(np.mean(square[pose == p]))) for p in np.unique(pose)}


def largest_error_poses(recording: Recording) -> tuple[int, ...]:
    """The poses of a campaign without correction that will be corrected most: where its errors are largest.

    Of those that are visited without payload.
    """
    reduction = reduce(recording)
    errors = pose_errors(reduction)
    unloaded = set(reduction.info.pose[reduction.rows(CALIBRATION, 0)].tolist())
    return tuple(sorted((p for p in errors if p in unloaded), key=lambda p: -errors[p])[:FIRST_POSES])


def verify_folders(before: Recording, after: Recording) -> dict[str, Any]:
    """The verdict on a correction by two campaigns of the same rig and visits (docs/reference/json.md).

    Raises CampaignRefused ("sign or unit") as soon as the errors have grown at the three poses where they were largest;
    the second campaign may then hold no more than these.
    """
    _require_same_rig(before, after)
    without = reduce(before)
    stands = _station_stands(before, after)
    visited = after["pose"][np.asarray(after["phase"]) == CALIBRATION]
    if not stands and len(set(visited.tolist())) <= FIRST_POSES:
        raise InputError(
            f"{after.file.campaign}: the station was moved, and so few poses give no frame; measure all of them"
        )
    having = reduce(after, without if stands else None)
    _require_same_targets(without, having)
    first = _first_poses(without, having)
    if first["after_m"] > GREW * first["before_m"]:
        ratio = first["after_m"] / first["before_m"]
        hint = "about twice: the sign" if DOUBLED[0] <= ratio <= DOUBLED[1] else "not twice: the unit, or another axis"
        raise CampaignRefused(
            f"sign or unit: at poses {', '.join(map(str, first['poses']))} the error grew from "
            f"{first['before_m'] * 1e6:.1f} to {first['after_m'] * 1e6:.1f} um, {ratio:.2g} times ({hint}); switch the "
            "correction off"
        )
    payloads = [_payload(without, having, n) for n in _common_payloads(without, having)]
    return {
        "before_campaign": before.file.campaign,
        "after_campaign": after.file.campaign,
        "simulated": before.file.simulated or after.file.simulated,
        "first_poses": first,
        "payloads": payloads,
        "accepted": all(entry["accepted"] for entry in payloads),
        "frame": "one frame for both: the station stands where it stood"
        if stands
        else "a frame each, fitted to commanded poses without payload: the station was moved",
    }


def _payload(without: Reduction, having: Reduction, payload: int) -> dict[str, Any]:
    before, after = (visit_figures(part, CALIBRATION, payload) for part in (without, having))
    if before is None or after is None:
        raise InputError(f"payload {payload} was not measured without and with the correction; measure both")
    decision = decide(before, after)
    return {
        "payload": payload,
        "payload_kg": without.recording.file.payloads[payload].mass_kg,
        "before": before.as_dict(),
        "after": after.as_dict(),
        "rule": decision.rule.replace("the tables stay", "the correction stays").replace(
            "the former tables come back", "switch it off"
        ),
        "accepted": decision.verdict == "accepted",
    }


def _common_payloads(without: Reduction, having: Reduction) -> list[int]:
    """Payloads of both, and those of one alone named as an error: a correction is decided for what was measured."""
    numbers = [set(part.info.payload[part.rows(CALIBRATION)].tolist()) for part in (without, having)]
    common = sorted(numbers[0] & numbers[1])
    if not common:
        raise InputError("verify: the two campaigns have no payload in common; measure the same visits")
    return [int(n) for n in common]


def _first_poses(without: Reduction, having: Reduction) -> dict[str, Any]:
    before, after = pose_errors(without), pose_errors(having)
    common = sorted(set(before) & set(after), key=lambda p: -before[p])[:FIRST_POSES]
    if not common:
        raise InputError("verify: the two campaigns have no pose in common; measure the same visits")
    rms = [float(np.sqrt(np.mean([part[p] ** 2 for p in common]))) for part in (before, after)]
    return {"poses": common, "before_m": rms[0], "after_m": rms[1]}


def _require_same_rig(before: Recording, after: Recording) -> None:
    if before.machine.text != after.machine.text:
        raise InputError("verify: the two campaigns are of different machine files; measure both with one")
    masses = [[p.mass_kg for p in recording.file.payloads] for recording in (before, after)]
    if masses[0] != masses[1]:
        raise InputError("verify: the two campaigns list different payloads; measure both with one rig file")
    if before.file.campaign == after.file.campaign:
        raise InputError(
            f"verify: {before.file.campaign} twice; give the campaign without, then that with the correction"
        )
    if before.file.simulated != after.file.simulated:
        raise InputError("verify: one of the two campaigns is simulated; compare like with like")


def _require_same_targets(without: Reduction, having: Reduction) -> None:
    targets = []
    for part in (without, having):
        rows = part.rows(CALIBRATION)
        pose = part.info.pose[rows].tolist()
        targets.append(dict(zip(pose, part.observations.visits.target_m[rows], strict=True)))
    for pose in set(targets[0]) & set(targets[1]):
        if np.max(np.abs(targets[0][pose] - targets[1][pose])) > SAME_TARGET:
            raise InputError(f"verify: pose {pose} is another one in the second campaign; measure the same visits")


def _station_stands(before: Recording, after: Recording) -> bool:
    """Whether floor nests are where they were, as the station sees them, and its settings of one set-up."""
    last, first = _nests(before, last=True), _nests(after, last=False)
    common = set(last) & set(first)
    moved = max((float(np.linalg.norm(last[n] - first[n])) for n in common), default=np.inf)
    one_setup = len(set(before["station"].tolist())) == len(set(after["station"].tolist())) == 1
    return one_setup and moved <= before.file.nest_limit_m


def _nests(recording: Recording, *, last: bool) -> dict[str, Array]:
    """Mean positions of the floor nests in the last or first check, as the station sees them."""
    rows = np.asarray(recording["phase"]) == "nests"
    if not np.any(rows):
        return {}
    checks = recording["nest_check"][rows]
    rows &= recording["nest_check"] == (checks.max() if last else checks.min())
    names = np.asarray(recording["smr"]).astype(str)
    return {name: recording.positions_m[rows & (names == name)].mean(axis=0) for name in set(names[rows].tolist())}
