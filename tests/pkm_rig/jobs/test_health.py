"""The short check over the real protocols of the embedded mock rig, against a calibration of the kept store."""

from __future__ import annotations

import gzip
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.intervals.check_estimate import estimate_check
from calibration.recording.header import KnownTable
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.check_readings import design_and_residual, observe, plan_check, true_drives
from pkm_rig.jobs.health import PHASE, health, health_json
from pkm_rig.jobs.history import history
from pkm_rig.jobs.interim import run_interim_test
from pkm_rig.jobs.life_record import key_of
from pkm_rig.jobs.reference import load_reference
from pkm_rig.jobs.tables_in_force import parse_tables, require_tables, wrong_tables
from pkm_rig.report.health_text import print_health
from pkm_rig.store.life import life_rows
from pkm_rig.store.life_facts import machine_history
from pkm_rig.store.store import Store
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file, silent
from tests.pkm_rig.plant_recording import record

KEPT = Path(__file__).parents[2] / "data" / "life" / "store.db.gz"
RIG, SEED, START_S = "embedded-mock", 4, 1e5
NOW_S = 1577880000.0  # soon after the kept machine was calibrated
TOLERANCE_M = 6e-5


def kept_store(path: Path) -> Path:
    """The life of the mock machine of SEED: one accepted calibration, whose campaign was removed."""
    path.write_bytes(gzip.decompress(KEPT.read_bytes()))
    return path


def rig_file(seed: int = SEED, **recalibration: object):
    file, machine = short_rig_file(seed=seed)
    section = file.recalibration.model_copy(update={"tolerance_m": TOLERANCE_M, **recalibration})
    return file.model_copy(update={"recalibration": section}), machine


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    """One check of a machine that has not changed, and what it left behind."""
    store = Store(kept_store(tmp_path_factory.mktemp("health") / "store.sqlite"))
    said: list[str] = []
    with mock_and_rig(*rig_file(), start_s=START_S) as (_, rig):
        result = health(rig, store, said.append, silent, lambda: NOW_S)
        states = [bank.state() for bank in rig.banks]
    yield result, store, said, states
    store.close()


def test_an_unchanged_machine_is_fit_and_the_check_is_stored(checked):
    result, store, said, states = checked
    assert result.verdict.state == "fit"
    assert result.verdict.exit_status == 0
    assert 4 <= result.fact.poses <= 12
    assert result.fact.duration_s < 600.0
    assert any("warmed up in" in line for line in said)
    assert all(state.on and state.valid for state in states)
    (row,) = life_rows(store, "checks", RIG)
    assert (row.kind, row.campaign) == ("fit", result.fact.id)
    fact = machine_history(store, RIG, row.machine).checks[0]
    assert fact == result.fact
    (check,) = history(store, RIG)["checks"]
    assert check["verdict"] == "fit"
    assert store.count_readings(result.fact.id) > 5 * result.fact.poses
    assert all(row == 2.0 for row in store.recording(result.fact.id)["compensation"][5:])


def test_the_result_can_be_read_by_people_and_programs(checked, capsys):
    result, *_ = checked
    shown = health_json(result)
    assert shown["verdict"] == "fit"
    sizes = [abs(change["value"]) / change["u"] for change in shown["changes"].values()]
    assert sizes == sorted(sizes, reverse=True)
    print_health(shown)
    printed = capsys.readouterr().out
    assert f"check {result.fact.id}: fit" in printed
    assert "calendar: fit" in printed


def test_a_change_is_found_at_its_size(checked):
    """Readings of the check, the left drive's reports shifted: a lost reference of 30 um, against its own u."""
    result, store, *_ = checked
    file, machine = rig_file()
    reference = load_reference(store, RIG, result.fact.calibration, machine, file.payloads)
    recording = store.recording(result.fact.id)
    columns = {**recording.columns, "left_actual_m": recording["left_actual_m"] - 30e-6}
    moved = replace(recording, columns=columns)
    found = []
    for one in (recording, moved):
        design, residual = design_and_residual(file, reference, observe(one, reference, PHASE), 1)
        found.append(estimate_check(design, residual))
    row = design.watched.names.index("drive_offset.left")
    change = found[1].change[row] - found[0].change[row]
    assert change == pytest.approx(30e-6, rel=0.02)
    assert found[1].error.position_m > 5e-6


def test_a_temperature_that_no_part_has_is_no_change(checked):
    result, store, *_ = checked
    file, machine = rig_file()
    reference = load_reference(store, RIG, result.fact.calibration, machine, file.payloads)
    recording = store.recording(result.fact.id)
    visit = recording["visit"]
    wrong = visit == np.unique(visit[np.asarray(recording["phase"]) == PHASE])[1]
    columns = {**recording.columns, "struts_temperature_c": np.where(wrong, 85.0, recording["struts_temperature_c"])}
    found = []
    for one in (recording, replace(recording, columns=columns)):
        design, residual = design_and_residual(file, reference, observe(one, reference, PHASE), 1)
        found.append(estimate_check(design, residual))
    assert found[1].error.position_m == pytest.approx(found[0].error.position_m, abs=2e-8)


def test_drives_stand_where_command_and_table_put_them(checked):
    """Corrections of the header's tables are added to what drives report, and to nothing measured without tables."""
    _, store, *_ = checked
    table = KnownTable(generation=2, drive="left", own_m=(0.0, 2.0), corrections_m=((1e-4,), (3e-4,)))
    other = table.model_copy(update={"drive": "right", "corrections_m": ((0.0,), (0.0,))})
    recording = record(3, calibration_poses=6).take(slice(20))
    recording = replace(recording, file=recording.file.model_copy(update={"known_tables": (table, other)}))
    generation = np.where(np.arange(20) < 10, 0.0, 2.0)
    recording = replace(recording, columns={**recording.columns, "compensation": generation})
    drives, reported = true_drives(recording)["left_actual_m"], recording["left_actual_m"]
    np.testing.assert_array_equal(drives[:10], reported[:10])
    np.testing.assert_allclose(drives[10:] - reported[10:], 1e-4 + 1e-4 * reported[10:], rtol=1e-9)
    bare = replace(recording, file=recording.file.model_copy(update={"known_tables": ()}))
    with pytest.raises(InputError, match="does not hold table 2 of drive left"):
        true_drives(bare)
    assert store.recording(checked[0].fact.id).file.known_tables


def test_the_first_poses_tell_most(checked):
    """The chosen order beats the reverse one: the watched change known worst after four poses is known better."""
    result, store, *_ = checked
    file, machine = rig_file()
    reference = load_reference(store, RIG, result.fact.calibration, machine, file.payloads)
    planned, _ = plan_check(file, reference, 1, 12)
    low, high = machine.commanded_limits.T
    assert len({tuple(visit.target_m) for visit in planned}) == 12
    for visit in planned:
        assert np.all((visit.target_m[machine.commanded] >= low - 1e-9) & (visit.target_m[machine.commanded] <= high))
    assert [visit.pose for visit in planned] == list(range(12))


def test_another_machine_is_out_of_tolerance(tmp_path):
    """The mock machine of another seed under the tables of this one."""
    with (
        closing(Store(kept_store(tmp_path / "store.sqlite"))) as store,
        mock_and_rig(*rig_file(seed=7), start_s=START_S) as (_, rig),
    ):
        result = health(rig, store, silent, silent, lambda: NOW_S)
        assert result.fact.poses == 4
        assert (result.verdict.state, result.verdict.exit_status) == ("out of tolerance", 1)
        assert [row.kind for row in life_rows(store, "checks", RIG)] == ["out of tolerance"]


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_nests_are_found_by_a_station_that_was_set_up_a_little_elsewhere(side):
    """Up to what campaigns permit of their first reflectors, whichever way this mock's station stands already."""
    with mock_and_rig(*rig_file()) as (mock, rig):
        mock.plant.move_station((side * 0.02, 0.0, 0.0), side * 0.004)
        assert run_interim_test(rig).passed


def test_what_cannot_be_checked_is_said(tmp_path):
    with (
        closing(Store(kept_store(tmp_path / "store.sqlite"))) as store,
        closing(Store(tmp_path / "empty.sqlite")) as empty,
        mock_and_rig(*rig_file()) as (_, rig),
    ):
        with pytest.raises(InputError, match="no accepted calibration of it; run `pkm-rig calibrate`"):
            health(rig, empty, silent, silent)
        calibration = machine_history(store, RIG, key_of(rig)).last_calibration
        wanted = parse_tables(calibration.tables)
        assert set(wanted) == {"left", "right"}
        assert wrong_tables(rig, calibration.tables) == "drive left uses no table"
        require_tables(rig, store, calibration.id, calibration.tables, silent)
        assert wrong_tables(rig, calibration.tables) is None
        other = calibration.tables.replace("left:2:", "left:3:")
        with pytest.raises(CampaignRefused, match="drive left uses generation 2"):
            require_tables(rig, store, calibration.id, other, silent)
        rig.change_payload(0)
        with pytest.raises(CampaignRefused, match="not for the payload that is on"):
            require_tables(rig, store, calibration.id, calibration.tables, silent)
