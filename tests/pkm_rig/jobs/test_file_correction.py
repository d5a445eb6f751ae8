"""Files for controls of machines whose drives must agree: internal force goes where the format holds what does it."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.compensation.decomposition import corrections_at
from calibration.compensation.formats.catalogue import table_format
from calibration.compensation.formats.control import Order, axis_names
from calibration.compensation.free_part import find_free_part
from calibration.machine.inverse import nominal_drives
from pkm_rig.jobs.control_files import Choice, IdentifiedLoad, write_control_files
from pkm_rig.jobs.file_correction import FileCorrection
from tests.calibration.compensation.test_free_part import rig_with_known_stiffness
from tests.pkm_rig.spatial_recording import plant_of, record, true_forces_n

PAYLOAD, SEED = 1, 2


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """A delta of four struts whose stiffness is known within 0.5 %: its plant, and a recording."""
    rig = rig_with_known_stiffness("delta8", tmp_path_factory.mktemp("known"), 0.005)
    return plant_of(rig, SEED)[0], record(rig, SEED, poses=20)


@pytest.fixture(scope="module")
def made(known):
    """By format: the smallest correction, and with the free part."""
    recording = known[1]
    identified = IdentifiedLoad.of(recording, PAYLOAD)
    machine, error, box = identified.machine, identified.error(), identified.box
    free = find_free_part(identified.calibration.fit, identified.calibration.report, identified.load, box)

    def both(name):
        form = table_format(name)
        control = form.control(None)
        axes = axis_names(form, control, None, machine)

        def build(correction):
            return form.build(Order(correction, control, axes, ()))

        smallest = FileCorrection.of(machine, error, box, build, None)
        return smallest, smallest.or_with(machine, error, build, free)

    return {name: both(name) for name in ("csv", "siemens-cec", "linuxcnc-comp")}


def test_the_plants_own_struts_are_strained_less_by_the_tables(known, made):
    (plant, recording), name = known, "siemens-cec"
    target_m = made[name][0].correction.check.target_m[:15]
    nominal = nominal_drives(recording.machine, target_m)
    forces_n = [
        np.sqrt(np.mean(true_forces_n(plant, nominal + corrections_at(each.made.tables, nominal), PAYLOAD) ** 2))
        for each in made[name]
    ]
    assert forces_n[1] < 0.4 * forces_n[0]
    left_m = [each.remaining.position_m.after for each in made[name]]
    assert left_m[1] < 1.05 * left_m[0]


@pytest.mark.parametrize("name", ["linuxcnc-comp", "csv"])
def test_a_format_that_does_not_hold_it_takes_the_smallest_correction(made, name):
    """One would leave more of the tool's error, the other's tables would be too steep."""
    smallest, written = made[name]
    assert written is smallest
    assert written.free is None


def test_forces_are_told_before_a_file_is_written(known, tmp_path):
    said: list[str] = []
    result = write_control_files(known[1], PAYLOAD, tmp_path, Choice("siemens-cec"), said.append)
    forces = result["strut_force_rms_n"]
    assert forces["after"] < 0.4 * forces["before"]
    line = f"predicted strut forces: {forces['before']:.0f} N RMS; corrected {forces['after']:.0f} N"
    assert f"{line} (internal force taken away)" in said
