"""Two measurement folders of one machine: what changed between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.comparison.compare import compare_measurements
from calibration.comparison.two_folders import linearise_folders, with_all_unknowns
from calibration.diagnosis.linear_folder import linearise_measurements
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.recording.measurement_header import PreviousFitEntry
from tests.calibration.diagnosis.measured import SD, Wanted, made

SCALE = 1e-4
POSES = Wanted("stewart6", ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"), visits=60)
DISTANCES = Wanted("delta6", (), pairs=160)


def longer(drives: np.ndarray, _: np.ndarray) -> np.ndarray:
    """The second drive counts another length."""
    return np.where(np.arange(drives.shape[1]) == 1, SCALE * drives, 0.0)


def shifted(drives: np.ndarray, _: np.ndarray) -> np.ndarray:
    """The first drive has another zero."""
    return np.where(np.arange(drives.shape[1]) == 0, 6e-5, 0.0)


def two(wanted: Wanted, shift=None) -> tuple[MeasuredMachine, MeasuredMachine]:
    """The same machine measured twice, its drives otherwise the second time."""
    before = made(wanted)
    after = made(wanted if shift is None else replace(wanted, shift=shift))
    rng = np.random.default_rng(8)
    return before, replace(
        after,
        file=after.file.model_copy(update={"name": "later"}),
        coordinates=after.coordinates + SD * rng.standard_normal(after.coordinates.shape),
        distance_m=after.distance_m + SD * rng.standard_normal(len(after.distance_m)),
    )


@pytest.mark.parametrize("wanted", [POSES, DISTANCES], ids=["poses", "distances"])
def test_another_scale_of_a_drive_is_named_with_its_size(wanted):
    found = compare_measurements(*two(wanted, longer))
    drive = "leg2" if wanted is POSES else "b"
    assert (found.verdict, found.place) == ("drive_scale", drive)
    (scale,) = found.changes[0].quantities
    assert abs(scale.value - SCALE) < 2.5 * scale.u
    assert scale.u < 0.1 * SCALE
    assert found.machine_changed
    assert found.workspace.rms_m > 1e-5
    assert found.readings == ((60, 60) if wanted is POSES else (160, 160))


def test_another_zero_of_a_leg_is_not_told_from_a_longer_strut():
    found = compare_measurements(*two(POSES, shifted))
    together = {(found.verdict, found.place), *found.equivalent}
    assert {("drive_offset", "leg1"), ("strut", "strut1")} <= together
    assert found.changes[0].quantities[0].value == pytest.approx(6e-5, rel=0.1)


@pytest.mark.parametrize("wanted", [POSES, DISTANCES], ids=["poses", "distances"])
def test_a_machine_that_did_not_change_has_no_change(wanted):
    found = compare_measurements(*two(wanted))
    assert found.verdict == "nothing"
    assert found.ranking["nothing"] > 0.9
    assert not found.machine_changed
    assert 0.0 < found.hidden_m < 1e-5


def anew(seed: int, also=lambda drives, sides: 0.0):
    """Drives that stand off anew at each visit."""
    rng = np.random.default_rng([seed, 2])
    return lambda drives, sides: 1e-5 * rng.standard_normal(drives.shape) + also(drives, sides)


def test_a_scale_is_named_on_a_machine_that_does_not_repeat():
    before, _ = two(replace(DISTANCES, shift=anew(1)))
    _, after = two(replace(DISTANCES, shift=anew(2, longer)))
    found = compare_measurements(before, after)
    assert (found.verdict, found.place) == ("drive_scale", "b")
    (scale,) = found.changes[0].quantities
    assert abs(scale.value - SCALE) < 2.5 * scale.u
    assert any("does not repeat better than" in remark for remark in found.remarks)


def test_what_a_former_fit_left_alone_is_open_when_two_folders_are_compared():
    measured = made(DISTANCES)
    former = PreviousFitEntry(parameters=6, unknowns=["strut_length"], misses_at_most_m=1e-3)
    linear = linearise_measurements(replace(measured, file=measured.file.model_copy(update={"former": former})))
    everything = with_all_unknowns(linear)
    assert set(everything.names) > set(linear.names)
    assert everything.columns.shape[2] == len(everything.names)
    assert not everything.left_unknowns
    name = next(name for name in linear.left_alone if name.startswith("axis_tilt.a."))
    k = everything.names.index(name)
    np.testing.assert_allclose(everything.columns[:, :, k], linear.left_alone[name] * everything.sigma[k])


def test_the_two_ends_of_a_distance_stay_open_to_one_another():
    pair = linearise_folders(*two(DISTANCES))
    before = pair.before
    ends = np.zeros(pair.residual.size)
    first = int(np.flatnonzero(before.rows.is_first)[0])
    ends[[first, before.rows.partner[first]]] = 1.0, -1.0
    assert np.linalg.norm(pair.apply(ends)) < 1e-3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"machine": "rrr3"}, "are of different machines, delta6 and rrr3"),
        ({"mass": 1.0}, "their machine.toml differ"),
        ({}, "the same readings twice"),
    ],
)
def test_what_cannot_be_compared_is_said_in_one_line(change, said):
    before = made(DISTANCES)
    after = made(Wanted("rrr3", (), ball_m=(0.1, 0.2, 0.0))) if "machine" in change else before
    if "mass" in change:
        file = before.machine.file
        platform = file.platform.model_copy(update={"moving_mass_kg": file.platform.moving_mass_kg + 1.0})
        after = replace(before, machine=replace(before.machine, file=file.model_copy(update={"platform": platform})))
    with pytest.raises(InputError, match=said) as raised:
        compare_measurements(before, after)
    assert "\n" not in str(raised.value)
