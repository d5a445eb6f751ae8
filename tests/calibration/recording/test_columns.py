"""The table of columns: checks by kind and unit, optional columns, and columns that a recording declares."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from calibration.base.errors import InputError
from calibration.recording.columns import COLUMNS, Column, columns_of, unit_of
from calibration.recording.folder import read_folder, write_folder
from calibration.recording.recording import Recording, make_recording
from calibration.reduction.reduction import reduce
from pkm_rig.store.store import Store
from tests.pkm_rig.plant_recording import record

EXTRA = {"coolant_temperature_c": "Coolant at the pump.", "spindle_power_w": "Power of the spindle's drive."}


@pytest.fixture(scope="module")
def plain() -> Recording:
    return record(2, calibration_poses=6)


def with_extra(plain: Recording, **values: float) -> Recording:
    """The same readings with two further columns; values of the third reading by name."""
    file = plain.file.model_copy(update={"extra_columns": EXTRA})
    rows = [
        plain.row(i) | {"coolant_temperature_c": 21.5 + 0.01 * i, "spindle_power_w": 0.0} for i in range(len(plain))
    ]
    rows[2] |= values
    return make_recording(file, plain.machine, rows)


def test_every_column_is_there_once_with_a_unit_where_its_name_has_one():
    names = [column.name for column in columns_of(("a", "b"), ("base",), EXTRA)]
    assert len(set(names)) == len(names)
    for column in COLUMNS:
        unit = unit_of(column.name)
        assert column.unit == ("" if unit is None or column.kind != "number" else unit.symbol), column.name
        assert column.meaning.endswith(".")


@pytest.mark.parametrize(
    ("name", "symbol"),
    [
        ("speed_m_per_s", "m/s"),
        ("t_rig_s", "s"),
        ("cov_xx_m2", "m²"),
        ("coolant_flow_l_per_min", "l/min"),
        ("ppm", "ppm"),
    ],
)
def test_the_longer_of_two_fitting_units_counts(name, symbol):
    unit = unit_of(name)
    assert unit is not None
    assert unit.symbol == symbol


def test_names_without_a_known_unit_have_none():
    assert unit_of("spindle_load") is None
    assert unit_of("charm") is None


@pytest.mark.parametrize(
    ("kind", "value", "missing"), [("text", "a", ""), ("count", 3.0, -1.0), ("number", 0.5, math.nan)]
)
def test_optional_columns_of_any_kind_may_be_missing_in_a_row(kind, value, missing):
    column = Column("it", kind, "Something.", lowest=-2.0, largest=5.0, required=False)
    values = column.array([{"it": value}, {}])
    np.testing.assert_array_equal(values, np.array([value, missing]))
    column.check(values)
    assert column.parse(str(value)) == value
    if kind != "text":
        np.testing.assert_equal(column.parse(""), missing)
        with pytest.raises(InputError, match="row 1, column 'it' = 6 is out of range"):
            column.check(np.array([6.0]))
        with pytest.raises(InputError, match="row 2, column 'it' is not finite"):
            column.check(np.array([0.0, math.inf]))
    with pytest.raises(KeyError):
        replace(column, required=True).array([{}])


def test_declared_columns_are_written_and_read_again(plain, tmp_path):
    made = with_extra(plain)
    write_folder(made, tmp_path / "folder")
    read = read_folder(tmp_path / "folder")
    assert read.file.extra_columns == EXTRA
    np.testing.assert_array_equal(read["coolant_temperature_c"], made["coolant_temperature_c"])
    with closing(Store(tmp_path / "store.db")) as store:
        store.add_recording(read)
        stored = store.recording(read.file.campaign)
    for name, column in read.columns.items():
        np.testing.assert_array_equal(stored[name], column, err_msg=name)


def test_a_header_that_declares_none_is_written_as_before(plain, tmp_path):
    write_folder(plain, tmp_path / "folder")
    assert "extra_columns" not in (tmp_path / "folder" / "recording.toml").read_text(encoding="utf-8")
    assert "extra_columns" not in plain.file.model_dump_json()


def test_columns_that_are_not_declared_are_not_kept(plain, tmp_path):
    write_folder(with_extra(plain), tmp_path / "folder")
    header = tmp_path / "folder" / "recording.toml"
    text = header.read_text(encoding="utf-8")
    header.write_text(text[: text.index("[extra_columns]")], encoding="utf-8")
    assert not EXTRA.keys() & read_folder(tmp_path / "folder").columns.keys()


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"coolant_temperature_c": 294.0}, "row 3, column 'coolant_temperature_c' = 294 is out of range"),
        ({"spindle_power_w": math.nan}, "row 3, column 'spindle_power_w' is not finite"),
    ],
)
def test_their_values_are_finite_and_within_the_limits_of_their_unit(plain, values, complaint):
    with pytest.raises(InputError, match=complaint):
        with_extra(plain, **values)


def test_a_declared_column_must_be_there(plain):
    file = plain.file.model_copy(update={"extra_columns": EXTRA})
    with pytest.raises(InputError, match="a row lacks 'coolant_temperature_c'"):
        make_recording(file, plain.machine, [plain.row(i) for i in range(len(plain))])


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("spindle_load", "does not end in a unit"),
        ("c", "does not end in a unit"),
        ("Coolant_c", "is no name"),
        ("x_m", "is one of the recording's own"),
        ("left_actual_m", "is one of the recording's own"),
        ("struts_temperature_c", "is one of the recording's own"),
    ],
)
def test_names_of_declared_columns_are_checked(plain, name, complaint):
    with pytest.raises(ValidationError, match=complaint):
        type(plain.file)(**plain.file.model_dump() | {"extra_columns": {name: "?"}})


def test_readings_of_several_visits_are_not_all_of_one_moment(plain):
    """The drift of the station could not be told from what the machine does, and was taken for refraction."""
    rows = [plain.row(i) | {"t_rig_s": 1000.0} for i in range(len(plain))]
    with pytest.raises(InputError, match="column 't_rig_s' is 1000 in every row") as caught:
        make_recording(plain.file, plain.machine, rows)
    assert "\n" not in str(caught.value)
    visit = plain.row(len(plain) - 1)["visit"]
    assert make_recording(plain.file, plain.machine, [row for row in rows if row["visit"] == visit])
    whole_minutes = [row | {"t_rig_s": 60.0 * (i // 20)} for i, row in enumerate(rows)]
    assert make_recording(plain.file, plain.machine, whole_minutes)


def test_a_part_without_temperature_is_named_with_its_column(plain):
    """A folder has no rig file in which it could be mapped."""
    sensors = tuple(sensor for sensor in plain.file.sensors if sensor != "base")
    assert len(sensors) == len(plain.file.sensors) - 1
    rows = [plain.row(i) for i in range(len(plain))]
    recording = make_recording(plain.file.model_copy(update={"sensors": sensors}), plain.machine, rows)
    with pytest.raises(InputError, match=r"no column 'base_temperature_c', .* list 'base' in 'sensors' of") as caught:
        reduce(recording)
    assert "\n" not in str(caught.value)
    assert "rig file" not in str(caught.value)
