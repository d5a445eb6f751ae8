"""Obstacles to a campaign on a connected rig, found before anything moves."""

from __future__ import annotations

from itertools import product

import numpy as np

from calibration.base.errors import InputError
from calibration.base.frame import station_frame
from calibration.base.rotation import rotation_matrix, skew
from calibration.instruments import station_geometry
from calibration.machine.description import Machine
from calibration.machine.inverse import platform_poses
from calibration.reduction.figures import figure_axes
from calibration.reduction.report_frame import ReportFrame
from pkm_rig.rig.capabilities import uses_tables
from pkm_rig.rig.config import RigFile
from pkm_rig.rig.drive_tables import doubt, read_states
from pkm_rig.rig.expected_error import LEAST_RATIO, ExpectedError, expected_error
from pkm_rig.rig.rig import Rig
from pkm_rig.store.store import Store


def check_rig(rig: Rig) -> list[str]:
    """Obstacles to a campaign, one line each; empty if there are none."""
    problems = []
    u_m = in_plane_u_m(rig.file, rig.machine)
    limit_m = rig.file.limits.in_plane_u_m
    if u_m > limit_m:
        where = "nearer to the normal of the machine's plane" if rig.machine.planar else "nearer to the machine"
        problems.append(
            f"station: predicted in-plane uncertainty {u_m * 1e6:.1f} um misses the goal of {limit_m * 1e6:.1f} um; "
            f"place it {where} or average more readings"
        )
    problems += undecidable(rig.file, rig.machine)
    if rig.moved_by_control:
        return problems
    for drive, (low, high) in zip(rig.drives.drives, rig.machine.travel, strict=True):
        if drive.limits_m[0] > low or drive.limits_m[1] < high:
            problems.append(
                f"drive {drive.name}: its software limits are narrower than travel_m of the machine file; adjust one"
            )
    if (why := doubt(read_states(rig), [bank.drive.name for bank in rig.banks])) is not None:
        problems.append(f"{why}; any command that moves the drives switches compensation off, or use `pkm-rig tables`")
    return problems


def require_same_kind(rig: Rig, store: Store, campaign: str) -> None:
    """Raise InputError if a campaign of real devices would go on with simulated ones, or the other way round.

    Version 0.1 did not say it of its campaigns: there the name of the mock's station does.
    """
    simulated = store.header(campaign).simulated
    settings = store.events(campaign, "settings")
    if settings and not simulated:
        simulated = ((settings[0].data.get("station") or {}).get("name") or "").startswith("MOCK")
    devices = rig.simulated_devices
    if bool(devices) != simulated:
        what = f"{', '.join(devices)} are simulated" if devices else "none of these devices is simulated"
        raise InputError(
            f"campaign {campaign}: measured with {'simulated' if simulated else 'real'} devices, and {what}; "
            "go on with the rig that it was begun on"
        )


def require_back_end(rig: Rig) -> None:
    """Raise InputError if the drives of a connected rig are to be compensated by tables and store none."""
    if uses_tables(rig.file, rig.machine) and not rig.banks:
        raise InputError(f"rig {rig.file.rig}: its drives store no compensation tables; measure and identify only")


def in_plane_u_m(rig_file: RigFile, machine: Machine) -> float:
    """Predicted standard uncertainty of a measured tool position, worst corner of the workspace, in m.

    One visit, all platform reflectors, the coordinates that are not free held by the machine; full covariances.
    """
    return max(position for position, _ in measured_pose_u(rig_file, machine))


def undecidable(rig_file: RigFile, machine: Machine) -> list[str]:
    """Why no verification could decide with this set-up, one line each; empty if one could.

    The predicted noise floor of what is commanded, against the error that the machine's tolerances let one expect.
    """
    before, floor = expected_error(machine), predicted_floor(rig_file, machine)
    pairs = [("position", before.position_m, floor.position_m, "um")]
    if np.any(machine.commanded > 2):
        pairs.append(("rotation", before.rotation_rad, floor.rotation_rad, "urad"))
    return [
        f"station: the predicted noise floor of the {what}, {noise * 1e6:.1f} {unit}, is more than half of the "
        f"{error * 1e6:.1f} {unit} that the tolerances of {machine.name} let one expect: no verification could decide; "
        "use a station with a better range, place it nearer, or average more readings"
        for what, error, noise, unit in pairs
        if error < LEAST_RATIO * noise
    ]


def predicted_floor(rig_file: RigFile, machine: Machine) -> ExpectedError:
    """Predicted noise of one visit: RMS over the corners of the workspace, station's random part only."""
    pairs = np.array(measured_pose_u(rig_file, machine))
    position, rotation = np.sqrt(np.mean(pairs**2, axis=0))
    return ExpectedError(float(position), float(rotation))


def measured_pose_u(rig_file: RigFile, machine: Machine) -> list[tuple[float, float]]:
    """Predicted standard uncertainties of the tool position (m) and rotation (rad) of one visit, in the corners.

    Over the free coordinates that the figures of a verdict are of.
    """
    smrs = tuple(i for i, s in enumerate(machine.smrs) if s.on == "platform")
    mounting = np.array([machine.smrs[i].position_m for i in smrs])
    entry = rig_file.station
    frame = station_frame(entry.position_m, entry.heading_rad, machine.gravity_m_per_s2)
    report = ReportFrame(machine, frame, smrs, mounting)
    corners = platform_poses(machine, np.array(list(product(*machine.commanded_limits))))
    points = report.points(corners)
    jac = report.jacobian(corners)[..., machine.dof]
    stated = rig_file.station.accuracy.to_station_accuracy()
    moves, turns = figure_axes(machine)
    out = []
    for i, corner in enumerate(corners):
        cov = station_geometry.point_covariances(*station_geometry.points_to_polar(points[i]), stated)
        cov /= rig_file.campaign.readings_per_smr
        information = sum(jac[i, k].T @ np.linalg.inv(cov[k]) @ jac[i, k] for k in range(len(smrs)))
        pose_cov = np.zeros((6, 6))
        pose_cov[np.ix_(machine.dof, machine.dof)] = np.linalg.inv(information)
        lever = rotation_matrix(corner[None, 3:])[0] @ machine.tool_point_m
        to_tool = np.eye(6)
        to_tool[:3, 3:] = -skew(lever[None])[0]
        tool_cov = to_tool @ pose_cov @ to_tool.T
        parts = (tool_cov[np.ix_(axes, axes)] for axes in (moves, turns + 3))
        position, rotation = (float(np.sqrt(np.trace(part))) for part in parts)
        out.append((position, rotation))
    return out
