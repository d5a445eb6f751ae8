"""Calibrated geometry in the controls' own kinematics, written from their published formulas, puts the tool right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.base.rotation import rotation_matrix
from calibration.compensation.correction import Correction
from calibration.compensation.kinematics.catalogue import KINEMATICS, require_kind
from calibration.compensation.kinematics.fit import tool_poses
from calibration.compensation.remaining_error import RemainingError
from calibration.machine.description import load_machine, shipped_machine, shipped_machines
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.control_files import require_enough_removed
from tests.calibration.compensation.control_kinematics import GenHexKins, KlipperDelta, LinearDeltaKins, rpy_of
from tests.calibration.compensation.drawn_machine import DrawnMachine


def drawn_machine(name, *, loads, mass_kg=0.0):
    """A drawn machine, its correction and its tool error; without loads it is rigid."""
    drawn = DrawnMachine.of(name, 3)
    drawn = replace(drawn, model=replace(drawn.model, with_loads=loads))
    load = drawn.load(mass_kg)

    def error(drives, target):
        return drawn.tool_error(drives, target, load)

    return drawn, Correction.sampled(drawn.machine, error), error


def control_drives(form, files, machine, target):
    """Drive coordinates (n, d) in m that the control computes for platform poses (n, 6)."""
    pose = tool_poses(machine, target)
    position = pose[:, :3] * 1e3
    if form == "genhexkins":
        control = GenHexKins(files["genhexkins.hal"], files["joints.ini"])
        turns = [rpy_of(r) for r in rotation_matrix(pose[:, 3:])]
        rows = [control.drives(p, turn) for p, turn in zip(position, turns, strict=True)]
    elif form == "lineardeltakins":
        control = LinearDeltaKins(files["lineardeltakins.hal"], files["joints.ini"])
        rows = [control.drives(p) for p in position]
    else:
        control = KlipperDelta(files["printer-delta.cfg"])
        rows = [control.drives(p) for p in position]
    return np.array(rows) * 1e-3


def test_genhexkins_leads_a_rigid_hexapod_to_a_nanometre():
    drawn, correction, error = drawn_machine("stewart6", loads=False)
    files = KINEMATICS["genhexkins"].build(correction, ()).files
    target = drawn.targets(60, 9)
    left = error(control_drives("genhexkins", files, drawn.machine, target), target)
    assert np.max(np.abs(left[:, :3])) < 1e-9
    assert np.max(np.abs(left[:, 3:])) < 2e-9


def test_genhexkins_forward_gives_back_the_pose():
    drawn, correction, _ = drawn_machine("stewart6", loads=False)
    files = KINEMATICS["genhexkins"].build(correction, ()).files
    control = GenHexKins(files["genhexkins.hal"], files["joints.ini"])
    position, rpy = np.array([30.0, -40.0, 1100.0]), np.array([0.05, -0.08, 0.1])
    found = control.forward(control.joints(position, rpy), position + 5.0, rpy + 0.01)
    assert found == pytest.approx(np.concatenate([position, rpy]), abs=1e-8)
    assert drawn.machine.name == "stewart6"


@pytest.mark.parametrize("mass_kg", [0.0, 300.0])
def test_genhexkins_recovers_nine_tenths_of_an_elastic_hexapods_correction(mass_kg):
    drawn, correction, error = drawn_machine("stewart6", loads=True, mass_kg=mass_kg)
    made = KINEMATICS["genhexkins"].build(correction, ())
    target = drawn.targets(60, 9)
    control = control_drives("genhexkins", made.files, drawn.machine, target)
    assert control == pytest.approx(made.kinematics.drives(tool_poses(drawn.machine, target)), abs=1e-10)
    nominal = error(made.kinematics.formula(made.kinematics.nominal, tool_poses(drawn.machine, target)), target)
    left = error(control, target)
    for columns in (slice(0, 3), slice(3, 6)):
        assert np.sqrt(np.mean(left[:, columns] ** 2)) < 0.1 * np.sqrt(np.mean(nominal[:, columns] ** 2))


@pytest.mark.parametrize(("form", "most"), [("klipper-delta", 0.35), ("lineardeltakins", 0.8)])
def test_a_delta_gets_what_its_controls_parameters_can_carry(form, most):
    drawn, correction, error = drawn_machine("delta6", loads=True)
    made = KINEMATICS[form].build(correction, ())
    target = drawn.targets(60, 9)
    control = control_drives(form, made.files, drawn.machine, target)
    assert control == pytest.approx(made.kinematics.drives(tool_poses(drawn.machine, target)), abs=1e-9)
    nominal = error(made.kinematics.formula(made.kinematics.nominal, tool_poses(drawn.machine, target)), target)
    assert np.sqrt(np.mean(error(control, target)[:, :3] ** 2)) < most * np.sqrt(np.mean(nominal[:, :3] ** 2))


@pytest.mark.parametrize("form", ["klipper-delta", "lineardeltakins"])
def test_a_delta_whose_errors_are_those_parameters_is_led_to_nanometres(form):
    machine = load_machine(shipped_machine("delta6"))
    build = KINEMATICS[form].build
    blank = Correction.sampled(machine, DrawnMachine.of("delta6", 1).tool_error_free())
    kinematics = build(blank, ()).kinematics
    shift = 1e-4 * np.cos(np.arange(kinematics.nominal.size))
    shift[-3:] *= 0.2
    wanted = kinematics.nominal + shift

    def sampled(part):
        pose = tool_poses(machine, part.target_m)
        return replace(part, correction=kinematics.formula(wanted, pose) - part.drives)

    made = build(replace(blank, fitted=sampled(blank.fitted), check=sampled(blank.check)), ())
    target = blank.check.target_m[:40]
    exact = kinematics.formula(wanted, tool_poses(machine, target))
    assert control_drives(form, made.files, machine, target) == pytest.approx(exact, abs=3e-9)


def test_every_other_machine_is_refused_with_the_reason():
    fits = {"genhexkins": ["stewart6"], "lineardeltakins": ["delta6"], "klipper-delta": ["delta6"]}
    for name, form in KINEMATICS.items():
        for machine in map(load_machine, map(shipped_machine, shipped_machines())):
            if machine.name in fits[name]:
                require_kind(form, machine)
            else:
                with pytest.raises(InputError, match=f"format {name}: {machine.name} is none for it: .+ has"):
                    require_kind(form, machine)


def test_parameters_that_remove_too_little_of_the_tools_error_are_refused_unless_accepted():
    drawn, correction, error = drawn_machine("delta6", loads=True)
    kinematics = KINEMATICS["lineardeltakins"].build(correction, ()).kinematics
    check = correction.check
    left = RemainingError.of(drawn.machine, error, check, kinematics.drives(tool_poses(drawn.machine, check.target_m)))
    with pytest.raises(CampaignRefused, match=r"position error .+ give --accept-loss"):
        require_enough_removed("lineardeltakins", drawn.machine, 0, left, accept=False)
    require_enough_removed("lineardeltakins", drawn.machine, 0, left, accept=True)


def test_the_files_say_which_control_has_read_them():
    _, correction, _ = drawn_machine("delta6", loads=False)
    for name, trial in (("lineardeltakins", "Read by LinuxCNC 2.9"), ("klipper-delta", "has read a file of ours yet")):
        for text in KINEMATICS[name].build(correction, ("a note",)).files.values():
            assert trial in text
            assert text.startswith("# a note")
