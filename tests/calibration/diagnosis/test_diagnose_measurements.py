"""The diagnosis of measurement folders: machines with planted errors, and a printer's few heights."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.diagnosis.diagnose import diagnose_measurements
from calibration.diagnosis.result import Diagnosis
from calibration.recording.delta_printer import machine_with_measurements
from calibration.recording.klipper import parse_printer
from tests.calibration.delta_reference import TRUE, Rows, from_json, printer_cfg
from tests.calibration.diagnosis.measured import SD, Wanted, forces, made, payloads, play, wave

REAL = sorted((Path(__file__).parents[4] / "shared" / "real-data").glob("*.json"))
LOBES = {"geometry.axis_tilt", "geometry.strut_length", "geometry.drive_scale", "instrument.bed.bowl"}


def printer(delta, rows) -> Diagnosis:
    return diagnose_measurements(
        machine_with_measurements(parse_printer(printer_cfg(delta, rows), "printer.cfg"), "own", "made for a test")
    )


@pytest.mark.parametrize(
    "wanted",
    [
        Wanted("delta6", (), pairs=240, shift=play, sides=True),
        Wanted("stewart6", ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"), shift=play, sides=True, visits=80),
        Wanted("rrr3", (), ball_m=(0.1, 0.2, 0.0), shift=play, sides=True),
    ],
    ids=["distances", "poses", "ball"],
)
def test_backlash_is_named_at_its_drive_with_its_size(wanted):
    found = diagnose_measurements(made(wanted))
    assert found.verdict == "backlash"
    assert found.effects[0].place == ("leg2" if wanted.machine == "stewart6" else "b")
    size = found.effects[0].size
    assert abs(size.value - 6e-5) < 2.0 * size.u
    assert size.u < 1e-5


@pytest.mark.parametrize("load", [payloads, forces])
@pytest.mark.parametrize(
    ("machine", "columns"),
    [("planar4", ("x_m", "y_m", "rz_rad")), ("hexaglide", ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"))],
)
def test_a_folder_whose_visits_carried_loads_is_diagnosed_and_more_is_proposed(machine, columns, load):
    found = diagnose_measurements(made(Wanted(machine, columns, shift=play, sides=True, visits=60, load=load)))
    assert found.verdict == "backlash"
    assert abs(found.effects[0].size.value - 6e-5) < 2.0 * found.effects[0].size.u
    proposed = [addition for addition in found.next_measurement if addition.visits]
    assert "random poses" in {addition.name for addition in proposed}
    # A force is none that a proposed visit can have.
    assert ("another payload" in {addition.name for addition in proposed}) == (load is payloads)
    assert all(np.isfinite(addition.gain_bit) for addition in proposed)


def test_an_error_along_a_drive_is_named_and_shrinks_the_gap():
    found = diagnose_measurements(made(Wanted(columns=("x_m", "y_m", "z_m"), pairs=30, shift=wave)))
    assert (found.verdict, found.effects[0].place) == ("screw_cumulative_error", "a")
    assert found.gap.before_m > 1.2e-5
    assert found.gap.shrink > 0.8
    assert found.gap.noise_floor_m == pytest.approx(5e-6, rel=0.15)
    largest = max(found.where, key=lambda share: share.share)
    assert (largest.kind, largest.name) == ("drive", "a")
    assert not {share.kind for share in found.where} & {"direction", "dwell", "speed", "time", "temperature", "smr"}
    assert not found.visits.times_known
    assert len(found.withheld.rows) == len(found.withheld.before_m) == 3 * 120 + 30
    assert {"t_rig_s", "dwell_s", "a_direction", "payload_mass_kg"} <= {c.name for c in found.next_measurement}
    (sides,) = (c for c in found.next_measurement if c.name == "a_direction")
    assert sides.settles == ("backlash",)


def test_readings_that_are_left_out_are_listed():
    measured = made(Wanted("planar4", ("x_m", "y_m", "rz_rad"), shift=play, sides=True, visits=60, load=payloads))
    measured.conditions["t_rig_s"] = np.arange(60.0) * 90.0
    measured.coordinates[[7, 30], 0] += [5e-3, -2e-3]
    found = diagnose_measurements(measured)
    assert found.verdict == "backlash"
    listed = [(r.name, r.of, r.visit, r.t_rig_s, r.unit, r.reason) for r in found.left_out]
    assert listed == [
        ("coordinates.csv line 9", "visit 7", 7, 630.0, "m", "model gate"),
        ("coordinates.csv line 32", "visit 30", 30, 2700.0, "m", "model gate"),
    ]
    assert [r.size for r in found.left_out] == pytest.approx([5e-3, 2e-3], rel=0.1)
    assert all(r.sigmas > 6.0 for r in found.left_out)


def test_a_machine_as_it_was_calibrated_has_no_effect():
    found = diagnose_measurements(made(Wanted(columns=("x_m", "y_m", "z_m"), sides=True)))
    assert found.verdict == "none"
    assert found.gap.before_m < 3e-6


@pytest.mark.parametrize(
    "wanted",
    [Wanted(pairs=240), Wanted(columns=("x_m", "y_m", "z_m")), Wanted("planar4", ("x_m", "y_m", "rz_rad"), visits=60)],
    ids=["distances", "places", "pose"],
)
def test_readings_that_scatter_more_than_the_folder_says_are_no_cause(wanted):
    found = diagnose_measurements(made(replace(wanted, noise=1.6, sides=True, seed=12)))
    assert found.verdict == "none"
    (remark,) = (remark for remark in found.remarks if "scatter" in remark)
    (times,) = re.findall(r"scatter ([\d.]+) times", remark)
    assert float(times) == pytest.approx(1.6, rel=0.1)  # some 200 degrees of freedom tell it within 5 %
    assert found.gap.noise_floor_m == pytest.approx(1.6 * SD, rel=0.15)


def test_a_cause_is_found_beside_more_scatter_than_stated():
    found = diagnose_measurements(made(Wanted(columns=("x_m", "y_m", "z_m"), pairs=30, shift=wave, noise=1.6)))
    assert (found.verdict, found.effects[0].place) == ("screw_cumulative_error", "a")
    assert found.gap.noise_floor_m == pytest.approx(1.6 * SD, rel=0.15)


def three_lobes(size_mm: float) -> Rows:
    """Heights at the centre and at twelve points around it, higher towards the towers and lower between them."""
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    points = [(0.0, 0.0), *zip(70.0 * np.cos(angles), 70.0 * np.sin(angles), strict=True)]
    lobes = [0.0, *(-size_mm * np.sin(3.0 * angles))]
    steps = [np.round(TRUE.steps(np.array([*point, 0.0]))) for point in points]
    return Rows([(float(TRUE.tool(p)[2] + lobe), p) for p, lobe in zip(steps, lobes, strict=True)], [])


def test_three_lobes_have_equivalent_causes_and_never_a_scale_alone():
    found = printer(TRUE, three_lobes(0.1))
    together = {found.verdict, *found.equivalent}
    assert found.verdict != "none"
    assert len(together & LOBES) >= 2
    assert together != {"geometry.drive_scale"}
    assert found.where == ()  # a few degrees of freedom are left
    assert any("degrees of freedom" in remark for remark in found.remarks)
    assert printer(TRUE, three_lobes(0.0)).verdict == "none"


@pytest.mark.skipif(not REAL, reason="published sets are not beside the repository")
@pytest.mark.parametrize("path", REAL, ids=lambda p: p.stem)
def test_published_printers(path):
    """One three-lobed residual: its causes are equivalent, a bowl is one of them, a scale never the only one."""
    delta, rows = from_json(json.loads(path.read_text(encoding="utf-8")))
    found = printer(delta, rows)
    alike = [remark for remark in found.remarks if remark.startswith("not told apart by these readings")]
    assert len(alike) == 1
    assert "bed.bowl" in alike[0]
    if not rows.distances:
        assert all(kind in alike[0] for kind in ("strut_length", "axis_tilt", "drive_scale"))
    assert found.verdict in {"none", *LOBES}
    if found.verdict != "none":
        assert len({found.verdict, *found.equivalent} & LOBES) >= 3
        assert found.ranking["instrument.bed.bowl"] > 0.05
    assert found.ranking["geometry.drive_scale"] < 0.5
    assert found.where == ()
