"""Obstacles to a campaign on a connected rig, found before anything moves."""

from __future__ import annotations

import numpy as np

from calibration.base.errors import InputError
from calibration.base.frame import station_frame
from calibration.instruments import station_geometry
from calibration.machine.description import Machine
from calibration.reduction.report_frame import ReportFrame
from pkm_rig.rig.config import RigFile
from pkm_rig.rig.drive_tables import doubt, read_states
from pkm_rig.rig.rig import Rig
from pkm_rig.store.store import Store


def check_rig(rig: Rig) -> list[str]:
    """Obstacles to a campaign, one line each; empty if there are none."""
    problems = []
    u_m = in_plane_u_m(rig.file, rig.machine)
    limit_m = rig.file.limits.in_plane_u_m
    if u_m > limit_m:
        problems.append(
            f"station: predicted in-plane uncertainty {u_m * 1e6:.1f} um misses the goal of {limit_m * 1e6:.1f} um; "
            "place it nearer to the normal of the machine's plane or average more readings"
        )
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


def require_table_banks(rig: Rig) -> None:
    """Raise InputError if the drives of a connected rig store no compensation tables."""
    if not rig.banks:
        raise InputError(f"rig {rig.file.rig}: its drives store no compensation tables; measure and identify only")


def in_plane_u_m(rig_file: RigFile, machine: Machine) -> float:
    """Predicted standard uncertainty of a measured tool position, worst corner of the workspace, in m.

    One visit, all platform reflectors, the plane held by the machine; full covariances.
    """
    smrs = tuple(i for i, s in enumerate(machine.smrs) if s.on == "platform")
    mounting = np.array([machine.smrs[i].position_m for i in smrs])
    frame = station_frame(rig_file.station.position_m, rig_file.station.heading_rad)
    report = ReportFrame(machine, frame, smrs, mounting)
    corners = np.zeros((4, 6))
    corners[:, :2] = [(x, y) for x in machine.workspace[0] for y in machine.workspace[1]]
    points = report.points(corners)
    jac = report.jacobian(corners)[..., machine.dof]
    stated = rig_file.station.accuracy.to_station_accuracy()
    worst = 0.0
    for i in range(len(corners)):
        cov = station_geometry.point_covariances(*station_geometry.points_to_polar(points[i]), stated)
        cov /= rig_file.campaign.readings_per_smr
        information = sum(jac[i, k].T @ np.linalg.inv(cov[k]) @ jac[i, k] for k in range(len(smrs)))
        pose_cov = np.linalg.inv(information)
        moves = machine.dof < 3
        worst = max(worst, float(np.sqrt(np.trace(pose_cov[np.ix_(moves, moves)]))))
    return worst
