"""Files of strangers: only plain ones are read, and never more of them than allowed. Bytes are counted, not seconds."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from calibration.base import plain_file
from calibration.base.csv_table import MAX_CSV_BYTES, read_table
from calibration.base.errors import InputError
from calibration.base.plain_file import MAX_FILE_BYTES, MAX_LINE, open_text, read_text
from calibration.base.text_bounds import MOST_DIGITS, MOST_LEVELS, MOST_PARTS, check_toml_text, parse_json
from calibration.base.toml_file import Section, parse_toml, read_toml
from calibration.machine.description import load_machine
from calibration.recording.folder import read_folder, write_folder
from calibration.recording.klipper import read_printer
from calibration.recording.measurement_folder import read_measurements
from drivers.drives.drive_profile import load_profile
from mock_devices.machine_file import MachineFileError, read_machine_file
from pkm_rig.rig.config import load_rig
from pkm_rig.virtual.twin_files import read_twin
from tests.pkm_rig.plant_recording import record


@pytest.fixture
def taken(monkeypatch):
    """How many bytes were asked of the system for files."""
    counted = []
    real = os.read

    def read(descriptor, size):
        data = real(descriptor, size)
        counted.append(len(data))
        return data

    monkeypatch.setattr(plain_file.os, "read", read)
    return counted


def sparse(path: Path, size: int) -> Path:
    with path.open("wb") as file:
        file.truncate(size)
    return path


SMALL_FILES = {
    "machine": load_machine,
    "rig": load_rig,
    "printer": read_printer,
    "text": read_text,
}


@pytest.mark.parametrize("read", SMALL_FILES.values(), ids=SMALL_FILES)
def test_nothing_is_read_of_a_file_that_is_too_large(read, taken, tmp_path):
    path = sparse(tmp_path / "file.toml", MAX_FILE_BYTES + 1)
    with pytest.raises(InputError, match=f"larger than {MAX_FILE_BYTES} bytes"):
        read(path)
    assert sum(taken) == 0


@pytest.mark.parametrize("what", ["recording", "table"])
def test_nothing_is_read_of_134_mb_of_csv(what, taken, tmp_path):
    if what == "recording":
        write_folder(record(2, calibration_poses=4), tmp_path / "folder")
        sparse(tmp_path / "folder" / "readings.csv", 134_000_000)
        small = sum(path.stat().st_size for path in (tmp_path / "folder").glob("*.toml"))
        taken.clear()
        with pytest.raises(InputError, match=f"readings.csv: larger than {MAX_CSV_BYTES}"):
            read_folder(tmp_path / "folder")
        assert sum(taken) == small
    else:
        with pytest.raises(InputError, match="larger than"):
            read_table(sparse(tmp_path / "table.csv", 134_000_000), ["a"])
        assert sum(taken) == 0


def test_a_line_without_end_is_given_up(taken, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a\n" + "0," * 5_000_000, encoding="utf-8")
    with pytest.raises(InputError, match="line 2 is longer than"):
        read_table(path, ["a"])
    assert sum(taken) < 2 * MAX_LINE


@pytest.mark.parametrize("read", [*SMALL_FILES.values(), lambda path: read_table(path, ["a"])])
@pytest.mark.parametrize("kind", ["zeros", "pipe", "folder"])
def test_only_plain_files_are_read(read, kind, taken, tmp_path):
    path = Path("/dev/zero") if kind == "zeros" else tmp_path / "there.toml"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    with pytest.raises(InputError, match=r"not a plain file|Is a directory"):
        read(path)
    assert sum(taken) == 0


@pytest.mark.parametrize("folder_reader", [read_folder, read_measurements, read_twin])
def test_folders_of_pipes_are_refused(folder_reader, taken, tmp_path):
    for name in ("recording.toml", "machine.toml", "readings.csv", "measurements.toml", "coordinates.csv", "twin.json"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match="not a plain file"):
        folder_reader(tmp_path)
    assert sum(taken) == 0


def test_readers_that_know_nothing_of_this_package_do_the_same(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    for name in ("pipe.toml", "/dev/zero"):
        path = tmp_path / name
        with pytest.raises(MachineFileError, match="not a plain file"):
            read_machine_file(path)
        link = tmp_path / "link.toml"
        link.unlink(missing_ok=True)
        link.symlink_to(path)
        with pytest.raises(ValueError, match="not a plain file"):
            load_profile("link.toml", tmp_path)
    with pytest.raises(MachineFileError, match="larger than"):
        read_machine_file(sparse(tmp_path / "large.toml", 10_000_000_000))
    with pytest.raises(ValueError, match="longer than"):
        load_profile(sparse(tmp_path / "large.toml", 10_000_000_000).name, tmp_path)


def test_a_file_that_grows_while_it_is_read_is_given_up(taken, tmp_path):
    path = tmp_path / "growing.csv"
    path.write_text("a\n1\n", encoding="utf-8")
    with ExitStack() as stack:
        stream = stack.enter_context(open_text(path, 10))
        with path.open("a", encoding="utf-8") as file:
            file.write("1\n" * 1000)
        with pytest.raises(InputError, match="larger than 10 bytes"):
            stream.read()
    assert sum(taken) == 11


def test_the_last_byte_that_is_allowed(tmp_path):
    path = tmp_path / "whole.txt"
    path.write_bytes(b"a\r\nb\rc\nd" + b"e" * 92)
    assert read_text(path, 100) == "a\nb\nc\nd" + "e" * 92
    with pytest.raises(InputError, match="larger than 99 bytes"):
        read_text(path, 99)
    for name, complaint in (("none.txt", "No such file"), ("bytes.txt", "not UTF-8"), ("zero\0.txt", "no path")):
        if name == "bytes.txt":
            (tmp_path / name).write_bytes(b"\xff\xfe")
        with pytest.raises(InputError, match=complaint) as refused:
            read_text(tmp_path / name)
        assert "\n" not in str(refused.value)


class Anything(Section):
    a: int = 0


DEEP = {
    "tables": "[" + ".".join(["a"] * 20_000) + "]",
    "dotted key": ".".join(["a"] * 20_000) + " = 1",
    "quoted key": ".".join(['"a b"'] * 20_000) + " = 1",
    "in an inline table": "x = {" + " . ".join(["a"] * 20_000) + " = 1}",
    "arrays": "a = " + "[" * 20_000 + "]" * 20_000,
    "inline tables": "a = " + "{a=" * 20_000 + "1" + "}" * 20_000,
    "digits": "a = " + "9" * 900_000,
    "digits apart": "a = " + "9_9" * 300_000,
    "hexadecimal": "a = 0x" + "f" * 900_000,
    "a float": "a = 0." + "9" * 900_000,
}


@pytest.mark.parametrize("what", DEEP)
def test_depth_and_digits_are_bounded_before_parsing(what, monkeypatch):
    def never(_text):
        raise AssertionError("it was parsed")

    monkeypatch.setattr("calibration.base.toml_file.tomllib.loads", never)
    with pytest.raises(InputError, match=r"^here: (nested|a key of more than|a number of more than)") as refused:
        parse_toml(DEEP[what], Anything, "here")
    assert len(str(refused.value)) < 200


def test_what_only_looks_deep_is_read(tmp_path):
    """Brackets, dots and digits within strings and comments are no nesting."""
    strings = ["[" * 99, "a." * 99, "9" * 999, '\\"[' * 40, "#" * 9]
    lines = [f'a{i} = "{text}"' for i, text in enumerate(strings)]
    lines += [f"b = '''{'[' * 99}\n{'9' * 999}'''", 'c = """' + '"[' * 99 + '"""', "# " + "[" * 99 + "." * 99]
    check_toml_text("\n".join(lines), "here")
    check_toml_text("a = " + "[" * MOST_LEVELS + "]" * MOST_LEVELS, "here")
    check_toml_text("a" + ".a" * (MOST_PARTS - 1) + " = 1", "here")
    check_toml_text("a = " + "9" * MOST_DIGITS, "here")
    check_toml_text("a = [" + ", ".join(["1.5"] * 1000) + "]\n", "here")
    path = tmp_path / "file.toml"
    path.write_text("a = 3\n", encoding="utf-8")
    assert read_toml(path, Anything).a == 3


@pytest.mark.parametrize(
    "text",
    ["[" * 20_000 + "]" * 20_000, '{"a":' * 20_000 + "1" + "}" * 20_000, "9" * 900_000, "NaN", "[Infinity]", "x"],
)
def test_json_is_bounded_too(text):
    with pytest.raises(InputError, match=r"^here: ") as refused:
        parse_json(text, "here")
    assert "\n" not in str(refused.value)
    assert parse_json('{"[[": ["]]", 1.5, "' + "9" * 900 + '"]}', "here")["[["][1] == 1.5


def test_a_recording_reads_as_it_was_written(taken, tmp_path):
    recording = record(2, calibration_poses=4)
    write_folder(recording, tmp_path / "folder")
    taken.clear()
    np.testing.assert_array_equal(read_folder(tmp_path / "folder")["x_m"], recording["x_m"])
    assert sum(taken) == sum(path.stat().st_size for path in (tmp_path / "folder").iterdir())
