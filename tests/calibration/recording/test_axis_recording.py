"""Recordings of one axis: they round-trip in their units, and any content is a recording or one line."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.base.errors import InputError
from calibration.recording.axis_header import AxisFile
from calibration.recording.axis_recording import is_axis_folder, read_axis_folder, write_axis_folder
from tests.either import either

TIME = np.arange(250) * 4.0
HEADER = AxisFile(
    format=1, name="own", kind="rotary", time_unit="ms", position_unit="deg", torque_unit="Nm", torque_side="motor",
    ratio=100.0,
)  # fmt: skip


def signals():
    motor = 30.0 * np.sin(TIME / 150.0)
    return {
        "time": TIME + 500.0,
        "command": motor + 0.1,
        "motor_position": motor,
        "second_position": motor - 0.01,
        "torque": np.cos(TIME / 150.0),
    }


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "own"
    write_axis_folder(HEADER, signals(), path)
    return path


def rewrite(folder, name, old, new):
    text = (folder / name).read_text(encoding="utf-8")
    assert old in text
    (folder / name).write_text(text.replace(old, new, 1), encoding="utf-8")


def test_units_of_the_header_become_si(folder):
    assert is_axis_folder(folder)
    read, given_signals = read_axis_folder(folder), signals()
    assert read.step_s == pytest.approx(0.004)
    assert read.time_s[0] == 0.0
    np.testing.assert_allclose(read.motor, np.radians(given_signals["motor_position"]))
    np.testing.assert_allclose(read.second, np.radians(given_signals["second_position"]))
    np.testing.assert_allclose(read.command, np.radians(given_signals["command"]))
    np.testing.assert_allclose(read.torque, 100.0 * given_signals["torque"])
    with pytest.raises(InputError, match="exists already"):
        write_axis_folder(HEADER, given_signals, folder)


@pytest.mark.parametrize(
    ("line", "ratio", "load_unit"), [("", None, "Nm"), ("ratio = 1.0", 1.0, "N"), ("ratio = 100.0", 100.0, "N")]
)
def test_a_ratio_of_one_is_one_and_a_ratio_left_out_is_not_known(folder, line, ratio, load_unit):
    """Without a ratio the torque of a spindle's motor stays one; with any it is a force on the slide."""
    rewrite(folder, "axis.toml", "ratio = 100.0", line)
    rewrite(folder, "axis.toml", 'kind = "rotary"', 'kind = "linear"')
    rewrite(folder, "axis.toml", 'position_unit = "deg"', 'position_unit = "mm"')
    read = read_axis_folder(folder)
    assert (read.file.ratio, read.file.load_unit) == (ratio, load_unit)
    np.testing.assert_allclose(read.torque, (ratio or 1.0) * signals()["torque"])
    write_axis_folder(read.file, signals(), folder / "again")
    assert read_axis_folder(folder / "again").file.ratio == ratio


@pytest.mark.parametrize(
    ("name", "old", "new", "says"),
    [
        ("axis.toml", 'kind = "rotary"', 'kind = "linear"', "a linear axis has no positions in deg"),
        ("axis.toml", 'torque_side = "motor"\n', "", "torque_unit and torque_side belong together"),
        ("axis.toml", "format = 1", "format = 2", "'format'"),
        ("axis.toml", "ratio = 100.0", "ratio = 100.0\nspeed = 1", "unknown key 'speed'"),
        ("axis.toml", "ratio = 100.0", "ratio = nan", "'ratio'"),
        ("samples.csv", "motor_position", "motor", "no column 'motor_position'; see docs/reference/axis-recording.md"),
        ("samples.csv", "torque", "voltage", "unknown column 'voltage'"),
        ("samples.csv", "\n504,", "\n500,", "line 3: time does not rise"),
        ("samples.csv", "\n504,", "\n505,", "line 3: a step of 0.005 s among steps of 0.004 s"),
        ("samples.csv", "\n504,", "\ninf,", "line 3, column 'time': 'inf' is not finite"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(folder, name, old, new, says):
    rewrite(folder, name, old, new)
    with pytest.raises(InputError) as error:
        read_axis_folder(folder)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s: {name: column[:150] for name, column in s.items()}, "150 samples; it needs at least 200"),
        (lambda s: s | {"motor_position": np.zeros(250)}, "the motor stands still"),
        (
            lambda s: s | {"time": s["time"] + np.where(np.arange(250) >= 99, 5000.0, 0.0)},
            "line 101: a step of 5 s among",
        ),
        (lambda s: s | {"second_position": s["second_position"] / 100.0}, "moves 0.01 times as far as the motor's"),
        (lambda s: s | {"second_position": s["motor_position"]}, "is the motor's, value by value"),
        (lambda s: s | {"second_position": -s["second_position"]}, "moves -1 times as far"),
        (lambda s: s | {"command": 1e9 * np.ones(250)}, "line 2, column 'command': more than 1e+06 rad"),
        (lambda s: {name: column for name, column in s.items() if name != "torque"}, "torque is there without column"),
    ],
)
def test_what_no_axis_does_is_refused(tmp_path, change, says):
    write_axis_folder(HEADER, change(signals()), tmp_path / "odd")
    with pytest.raises(InputError) as error:
        read_axis_folder(tmp_path / "odd")
    assert says in str(error.value)


def test_one_wrong_sample_does_not_decide_which_side_a_position_is_of(tmp_path):
    second = signals()["second_position"].copy()
    second[100] += 1e5
    write_axis_folder(HEADER, signals() | {"second_position": second}, tmp_path / "spike")
    assert read_axis_folder(tmp_path / "spike").second[100] == pytest.approx(np.radians(second[100]))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    which=st.sampled_from(["axis.toml", "samples.csv"]),
    place=st.floats(0.0, 1.0),
    dropped=st.integers(0, 40),
    text=st.text(max_size=40),
)
def test_any_content_is_a_recording_or_one_line(tmp_path, which, place, dropped, text):
    path = tmp_path / "any"
    if not path.exists():
        write_axis_folder(HEADER, signals(), path)
    whole = (path / which).read_text(encoding="utf-8")
    at = int(place * len(whole))
    (path / which).write_text(whole[:at] + text + whole[at + dropped :], encoding="utf-8", errors="replace")
    read, refused = either(lambda: read_axis_folder(path), InputError)
    (path / which).write_text(whole, encoding="utf-8")
    assert (read is None) == (refused is not None)
    if read is None:
        return
    assert all(np.all(np.isfinite(x)) for x in (read.time_s, read.motor, read.second, read.command, read.torque))
    assert np.all(np.diff(read.time_s) > 0.0)


@pytest.mark.parametrize(("start", "unit", "per_s"), [(1.76e9, "s", 1.0), (1.76e15, "us", 1e6), (-1e8, "s", 1.0)])
def test_time_may_be_that_of_a_clock(tmp_path, start, unit, per_s):
    """Seconds since 1970 are more than any recording lasts; what is limited is how long one lasts."""
    write_axis_folder(
        HEADER.model_copy(update={"time_unit": unit}),
        signals() | {"time": start + 1e-3 * TIME * per_s},
        tmp_path / "unix",
    )
    read = read_axis_folder(tmp_path / "unix")
    assert read.time_s[0] == 0.0
    assert read.step_s == pytest.approx(0.004, rel=1e-3)


def test_what_lasts_too_long_has_another_unit(tmp_path):
    write_axis_folder(
        HEADER.model_copy(update={"time_unit": "s"}), signals() | {"time": 1.76e9 + 1e5 * TIME}, tmp_path / "long"
    )
    with pytest.raises(InputError, match=r"line 28, column 'time': more than 1e\+07 s after the first; check the unit"):
        read_axis_folder(tmp_path / "long")
