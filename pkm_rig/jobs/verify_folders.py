"""Whether a control's correction helps: two campaigns of the same visits, without and with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.instruments.station_geometry import across_line_of_sight
from calibration.recording.header import SessionEntry
from calibration.recording.recording import Recording
from calibration.reduction.figures import COVERAGE_FACTOR, figure_axes, noise_floor, visit_figures
from calibration.reduction.reduction import CALIBRATION, Reduction, reduce
from pkm_rig.errors import CorrectionGrows
from pkm_rig.jobs.acceptance import decide

AFTER = "verification_after"
APART_S = 60.0  # between the two campaigns, as joined: how long it was is not used
FIRST_POSES = 3
SAME_TARGET = 1e-6  # m or rad
DOUBLED = (1.5, 3.0)  # about twice: what a correction of the wrong sign does


@dataclass(frozen=True)
class Measured:
    """One of the two campaigns as it was reduced, and the phase that its visits have there."""

    reduction: Reduction
    phase: str = CALIBRATION

    def rows(self, payload: int | None = None) -> NDArray[np.bool_]:
        """Its visits."""
        return self.reduction.rows(self.phase, payload)


def pose_errors(measured: Measured, payload: int) -> dict[int, float]:
    """Pose number to its RMS position error (m) over a campaign's visits with a payload."""
    reduction, rows = measured.reduction, np.flatnonzero(measured.rows(payload))
    position = reduction.errors(np.isin(np.arange(len(reduction.info.phase)), rows))[0]
    square = np.sum(position[:, figure_axes(reduction.recording.machine)[0]] ** 2, axis=1)
    pose = reduction.info.pose[rows]
    return {int(p): float(np.sqrt(np.mean(square[pose == p]))) for p in np.unique(pose)}


def largest_error_poses(recording: Recording) -> tuple[int, ...]:
    """The poses of a campaign without correction that will be corrected most: where its errors are largest.

    Of those that are visited without payload.
    """
    errors = pose_errors(Measured(reduce(recording)), 0)
    return tuple(sorted(errors, key=lambda p: -errors[p])[:FIRST_POSES])


def verify_folders(before: Recording, after: Recording) -> dict[str, Any]:
    """The verdict on a correction by two campaigns of the same rig and visits (docs/reference/json.md).

    Raises CorrectionGrows ("sign or unit") as soon as the errors have grown at the three poses where they were largest;
    the second campaign may then hold no more than these.
    """
    first = require_smaller_errors(before, after)
    few = len(_poses(after)) <= FIRST_POSES
    without, having = _in_one_frame(before, after) if few else (Measured(reduce(before)), Measured(reduce(after)))
    payloads = [_payload(without, having, n) for n in _payloads(without, having, common=few)]
    return {
        "before_campaign": before.file.campaign,
        "after_campaign": after.file.campaign,
        "simulated": before.file.simulated or after.file.simulated,
        "first_poses": first,
        "payloads": payloads,
        "accepted": all(entry["accepted"] for entry in payloads),
        "frame": "one frame for both: so few poses give none"
        if few
        else "a frame each, fitted to commanded poses without payload",
    }


def require_smaller_errors(before: Recording, after: Recording) -> dict[str, Any]:
    """The errors at the three poses where they were largest: poses, before_m, after_m. The second campaign may hold no
    more than these poses.

    Raises CorrectionGrows where they have grown by more than their U (k = 2, scatter of single visits), and InputError
    where the two campaigns cannot be compared.
    """
    _require_same_rig(before, after)
    if _station_stands(before, after):
        without, having = _in_one_frame(before, after)
    elif len(_poses(after)) > FIRST_POSES:
        without, having = Measured(reduce(before)), Measured(reduce(after))
    else:
        raise InputError(
            f"{after.file.campaign}: the station was moved, and so few poses give no frame; measure all of them, "
            "without --first where the control moves the machine"
        )
    _require_same_targets(without, having)
    return _require_smaller(without, having, largest_error_poses(before))


def _poses(recording: Recording) -> set[float]:
    return set(recording["pose"][np.asarray(recording["phase"]) == CALIBRATION].tolist())


def _in_one_frame(before: Recording, after: Recording) -> tuple[Measured, Measured]:
    """Both campaigns of a station that stands where it stood, reduced as one recording with a break between them,
    across which the floor nests tell how it has drifted. What has warmed up meanwhile shows as an error."""
    both = reduce(_joined(before, after))
    return Measured(both), Measured(both, AFTER)


def _joined(before: Recording, after: Recording) -> Recording:
    """The second campaign behind the first, its visits as a phase of their own, a nest check left out between them."""
    after = after.rows("nests", CALIBRATION)
    columns = {n: [before[n], after[n]] for n in before.columns if n in after.columns}
    for name, apart in (("sequence", 1.0), ("visit", 1.0), ("nest_check", 2.0)):
        columns[name][1] = after[name] + (before[name].max() + apart)
    if "replaces_visit" in columns:
        replaced = after["replaces_visit"]
        columns["replaces_visit"][1] = np.where(replaced < 0.0, replaced, replaced + (before["visit"].max() + 1.0))
    shift_s = float(before["t_rig_s"].max() - after["t_rig_s"].min()) + APART_S
    columns["t_rig_s"][1] = after["t_rig_s"] + shift_s
    begin = SessionEntry(
        number=len(before.file.sessions) + 1,
        first_sequence=int(columns["sequence"][1].min()),
        begin_rig_s=float(columns["t_rig_s"][1].min()),
        end_rig_s=float(columns["t_rig_s"][1].max()),
        time="unknown",
    )
    file = before.file.model_copy(update={"sessions": (*before.file.sessions, begin)})
    phase = np.asarray(after["phase"])
    columns["phase"][1] = np.where(phase == CALIBRATION, AFTER, phase)
    return Recording(file, before.machine, {name: np.concatenate(parts) for name, parts in columns.items()})


def _require_smaller(without: Measured, having: Measured, largest: Sequence[int]) -> dict[str, Any]:
    first = _first_poses(without, having, largest)
    if first["after_m"] - first["before_m"] > first["u_growth_m"]:
        ratio = first["after_m"] / first["before_m"]
        hint = "about twice: the sign" if DOUBLED[0] <= ratio <= DOUBLED[1] else "not twice: the unit, or another axis"
        raise CorrectionGrows(
            f"sign or unit: at poses {', '.join(map(str, first['poses']))} the error grew from "
            f"{first['before_m'] * 1e6:.1f} to {first['after_m'] * 1e6:.1f} um, {ratio:.2g} times ({hint}); switch the "
            "correction off"
        )
    return first


def _payload(without: Measured, having: Measured, payload: int) -> dict[str, Any]:
    before, after = (visit_figures(part.reduction, part.phase, payload) for part in (without, having))
    if before is None or after is None:
        raise InputError(f"verify: payload {payload} was not measured without and with the correction; measure both")
    machine = without.reduction.recording.machine
    decision = decide(before, after, rotation=bool(np.any(machine.commanded > 2)))
    return {
        "payload": payload,
        "payload_kg": without.reduction.recording.file.payloads[payload].mass_kg,
        "before": before.as_dict(),
        "after": after.as_dict(),
        "rule": decision.rule.replace("the tables stay", "the correction stays").replace(
            "the former tables come back", "switch it off"
        ),
        "accepted": decision.verdict == "accepted",
    }


def _payloads(without: Measured, having: Measured, *, common: bool) -> list[int]:
    """Payloads of both campaigns, or of any; InputError if they have none in common."""
    numbers = [set(part.reduction.info.payload[part.rows()].tolist()) for part in (without, having)]
    both = numbers[0] & numbers[1]
    if not both:
        raise InputError("verify: the two campaigns have no payload in common; measure the same visits")
    return [int(n) for n in sorted(both if common else numbers[0] | numbers[1])]


def _first_poses(without: Measured, having: Measured, largest: Sequence[int]) -> dict[str, Any]:
    """The errors at the poses that were largest before, or of those of both campaigns if they are not all there."""
    payload = _payloads(without, having, common=True)[0]
    before, after = pose_errors(without, payload), pose_errors(having, payload)
    both = set(before) & set(after)
    common = list(largest) if both >= set(largest) else sorted(both, key=lambda p: -before[p])[:FIRST_POSES]
    if not common:
        raise InputError("verify: the two campaigns have no pose in common; measure the same visits")
    rms = [float(np.sqrt(np.mean([part[p] ** 2 for p in common]))) for part in (before, after)]
    floor = noise_floor(without.reduction)
    visits = [
        np.count_nonzero(np.isin(part.reduction.info.pose[part.rows(payload)], common)) for part in (without, having)
    ]
    u_m = 0.0 if floor is None else floor.position_rms_m * float(np.sqrt(sum(1.0 / n for n in visits)))
    return {"poses": common, "before_m": rms[0], "after_m": rms[1], "u_growth_m": COVERAGE_FACTOR * u_m}


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


def _require_same_targets(without: Measured, having: Measured) -> None:
    targets = []
    for part in (without, having):
        rows = part.rows()
        pose = part.reduction.info.pose[rows].tolist()
        targets.append(dict(zip(pose, part.reduction.observations.visits.target_m[rows], strict=True)))
    for pose in set(targets[0]) & set(targets[1]):
        if np.max(np.abs(targets[0][pose] - targets[1][pose])) > SAME_TARGET:
            raise InputError(f"verify: pose {pose} is another one in the second campaign; measure the same visits")


def _station_stands(before: Recording, after: Recording) -> bool:
    """Whether floor nests are where they were, as the station sees them, and its settings of one set-up."""
    last, first = _nests(before, last=True), _nests(after, last=False)
    common = set(last) & set(first)
    shifts = (across_line_of_sight(first[n] - last[n], last[n]) for n in common)  # as nest checks judge them
    moved = max((float(np.linalg.norm(shift)) for shift in shifts), default=np.inf)
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
