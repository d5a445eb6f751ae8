"""The plant in space: its equilibrium against its own energy and against the other model, its errors, its branches."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.identification.pose_selection import workspace_poses
from calibration.machine import equilibrium as other
from calibration.machine.description import load_machine, shipped_machine, shipped_machines
from calibration.machine.inverse import drives_for
from mock_devices.machine_file import MachineFileError
from mock_devices.plant.spatial_draw import draw_spatial_machine
from mock_devices.plant.spatial_equilibrium import pose_of
from mock_devices.plant.spatial_machine import (
    Load,
    TrueSpatialMachine,
    closed_drive,
    middle_pose,
)
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.settings import MockSettings
from mock_devices.spatial_file import read_spatial_machine

MACHINES = shipped_machines()
PAYLOAD_KG, WARM = 60.0, {"struts": 22.0, "columns": 21.0, "base": 23.0, "platform": 24.0}


def nominal(name):
    """The file's machine without errors, with a payload as number 1."""
    file = read_spatial_machine(shipped_machine(name))
    centre = np.array([0.03, 0.02, 0.0 if file.planar else 0.1])
    loads = (Load(0.0, np.zeros(3)), Load(PAYLOAD_KG, centre))
    return TrueSpatialMachine(file, np.ones(len(file.drives)), loads)


@pytest.mark.parametrize("name", MACHINES)
def test_poses_and_forces_are_those_of_the_other_model(name):
    """Two codes, two parametrisations of rotations: what they share is the machine file."""
    plant, machine = nominal(name), load_machine(shipped_machine(name))
    drives, _ = drives_for(machine, machine.nominal, workspace_poses(machine, 4, 3))
    at = other.make_conditions(
        machine,
        len(drives),
        {sensor: np.full(len(drives), WARM[sensor]) for sensor in machine.sensors.values()},
        PAYLOAD_KG,
        tuple(plant.payloads[1].centre_m),
    )
    rest = other.solve(machine, machine.nominal, drives, at)
    assert rest.converged.all()
    for row, expected, force in zip(drives, rest.coordinates(), rest.force_n, strict=True):
        pose = plant.pose(row, 1, WARM)
        assert pose.vector() == pytest.approx(expected, abs=1e-13)
        assert plant.rod_forces_n(row, 1, pose, WARM) == pytest.approx(force[: len(plant.file.rods)], abs=1e-5)


@pytest.mark.parametrize("name", ["gough8", "prs3", "rrr4"])
def test_at_rest_no_small_motion_lowers_the_energy(name):
    true = draw_spatial_machine(read_spatial_machine(shipped_machine(name)), MockSettings(seed=4))
    drives = [closed_drive(true.file, a, middle_pose(true.file)) for a in range(len(true.file.drives))]
    pose, assembly = true.pose(drives, 2, WARM), true.assembly(drives, 2, WARM)
    at_rest = assembly.energy_j(pose)
    for coordinate in true.file.free:
        for side in (-1.0, 1.0):
            motion = np.zeros(6)
            motion[coordinate] = side * 1e-5
            assert assembly.energy_j(pose.moved(motion)) > at_rest + 1e-6


@pytest.mark.parametrize("name", MACHINES)
def test_a_drive_closes_its_first_strut(name):
    file = read_spatial_machine(shipped_machine(name))
    pose = middle_pose(file)
    plant = TrueSpatialMachine(file, np.ones(len(file.drives)), (Load(0.0, np.zeros(3)),))
    drives = [closed_drive(file, a, pose) for a in range(len(file.drives))]
    reference = dict.fromkeys(WARM, file.reference_temperature_c)
    assembly = plant.assembly(drives, 0, reference)
    assert np.abs(assembly.rods(pose)[1]).max() < 1.0  # N: 10 nm at the files' stiffness
    assert all(low < q < high for q, (low, high) in zip(drives, (d.travel for d in file.drives), strict=True))


def test_a_crank_beyond_its_reach_is_told():
    file = read_spatial_machine(shipped_machine("rrr3"))
    with pytest.raises(NoEquilibrium, match="link does not reach"):
        closed_drive(file, 0, pose_of(np.array([0.0, -1.0, 0.0, 0.0, 0.0, 0.0])))


def test_the_other_assembly_branch_is_told():
    plant = nominal("rrr3")
    drives = [closed_drive(plant.file, a, middle_pose(plant.file)) for a in range(3)]
    twisted = pose_of(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.6]))
    reference = dict.fromkeys(WARM, 20.0)
    with pytest.raises(NoEquilibrium):
        plant.pose([d + 1.4 for d in drives], 0, reference, twisted)


def test_errors_fill_the_tolerances_and_never_leave_them():
    file = read_spatial_machine(shipped_machine("prs3"))
    machines = [draw_spatial_machine(file, MockSettings(seed=seed)).file for seed in range(60)]
    width = file.tolerances
    length = [t.length_m - n.length_m for m in machines for t, n in zip(m.rods, file.rods, strict=True)]
    joint = [
        e for m in machines for t, n in zip(m.rods, file.rods, strict=True)
        for e in (t.platform_joint_m - n.platform_joint_m)
    ]  # fmt: skip
    tilt = [
        float(np.linalg.norm(np.cross(t.axis, n.axis))) / np.sqrt(2.0)
        for m in machines
        for t, n in zip(m.drives, file.drives, strict=True)
    ]
    hinge = [
        float((t.point_m - n.point_m) @ n.normal) for m in machines for t, n in zip(m.planes, file.planes, strict=True)
    ]
    for errors, half_width in (
        (length, width["strut_length_m"]),
        (joint, width["platform_joint_m"]),
        (tilt, width["axis_tilt_rad"]),
        (hinge, width["guide_position_m"]),
    ):
        share = np.abs(np.array(errors)) / half_width
        assert share.max() <= 1.0 + 1e-9
        assert share.max() > 0.9


def test_a_planar_machine_has_no_errors_out_of_its_plane():
    file = read_spatial_machine(shipped_machine("rrr4"))
    true = draw_spatial_machine(file, MockSettings(seed=7)).file
    assert all(rod.platform_joint_m[2] == rod.base_joint_m[2] == 0.0 for rod in true.rods)
    assert all(tuple(drive.axis) == (0.0, 0.0, 1.0) and drive.pivot_m[2] == 0.0 for drive in true.drives)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('kind = "crank"', 'kind = "chain"', "a chain is not known"),
        ("travel_rad = [-0.8, 0.8]", "travel_rad = [0.8, -0.8]", "its travel is not a range"),
        ("format = 1", "format = 2", "format 2"),
        ("[workspace]", "[workspace]\nx_mm = [1, 2]", "x_mm"),
        ('on = "floor"', 'on = "roof"', "there is no roof"),
        ('drive = "a"', 'drive = "z"', "'z'"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, old, new, message):
    path = tmp_path / "machine.toml"
    path.write_text(shipped_machine("rrr3").read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(MachineFileError, match=message) as error:
        read_spatial_machine(path)
    assert "\n" not in str(error.value)


def test_the_nests_are_as_far_apart_as_their_certificate_says():
    file, settings = read_spatial_machine(shipped_machine("delta8")), MockSettings(seed=4)

    def apart_m(machine):
        first, second = [smr.position_m for smr in machine.smrs if smr.on == "floor"][:2]
        return float(np.linalg.norm(second - first))

    error_m = apart_m(draw_spatial_machine(file, settings).file) - apart_m(file)
    assert 0.0 < abs(error_m) < 5.0 * settings.certificate_sd_m
