"""Names of strangers: none reaches a path, a terminal, rich, matplotlib or a spreadsheet as anything but a name."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from calibration.base.errors import InputError, printable
from calibration.base.toml_file import read_toml
from calibration.identification.calibration import identify_recording
from calibration.machine.description import parse_machine
from calibration.recording.folder import read_folder, write_folder
from calibration.recording.header import RecordingFile
from pkm_rig.jobs.measured_machine import printer_name
from pkm_rig.report import pictures
from pkm_rig.report.notation import literal
from pkm_rig.report.terminal import PeopleConsole
from pkm_rig.store.place import STORE_NAME
from tests.pkm_rig.plant_recording import record

NAMES = ["[/b]", "[red]x", r"$\frac{$", "$", ":smile:", "_hidden", "a%s{0}", "<b>&amp;", "..", "CON", "‘’", "x" * 200]
HOSTILE = st.one_of(st.sampled_from([*NAMES, "\x1b[2J", "\x9b31m", "a\u202eb", "\r", "\x07"]), st.text(max_size=30))


def with_names(recording, smr, payload):
    """The recording with a reflector and a payload of other names."""
    text = recording.machine.text.replace('"P1"', json.dumps(smr))
    payloads = (recording.file.payloads[0].model_copy(update={"name": payload}), *recording.file.payloads[1:])
    names = np.array([smr if name == "P1" else name for name in recording["smr"].tolist()])
    return replace(
        recording,
        file=recording.file.model_copy(update={"payloads": payloads}),
        machine=parse_machine(text, "machine"),
        columns={**recording.columns, "smr": names},
    )


@pytest.mark.parametrize("uid", ["=cmd|' /C calc'!A0", "-1+1", "@SUM(1)", "\x1b[2Jx", "", "a b", "x" * 101])
def test_readings_with_a_name_for_a_spreadsheet_or_a_terminal_are_refused(run, uid, tmp_path):
    recording = record(4, calibration_poses=12)
    uids = recording["uid"].copy().astype("U120")
    uids[1] = uid
    write_folder(replace(recording, columns={**recording.columns, "uid": uids}), tmp_path / "folder")
    status, _, complaint = run("import", tmp_path / "folder", "--out", tmp_path)
    assert status == 2
    assert "row 2, column 'uid'" in complaint
    assert len(complaint.splitlines()) == 1
    assert "\x1b" not in complaint


@pytest.mark.parametrize("name", [r"[/b]$\frac{$%s<b>"])
def test_names_go_through_all_commands(run, name, tmp_path):
    recording = with_names(record(4, calibration_poses=12), name, name)
    write_folder(recording, tmp_path / "folder")
    assert set(read_folder(tmp_path / "folder")["smr"].tolist()) == set(recording["smr"].tolist())
    for command in ("import", "identify"):
        status, printed, complaint = run(command, tmp_path / "folder", "--out", tmp_path)
        assert status == 0, complaint
        assert printed
    for command in ("list", "show"):
        status, _, complaint = run(command, *(["plant-4"] if command != "list" else []), "--out", tmp_path)
        assert status == 0, complaint
    calibration = identify_recording(recording)
    for figure in (pictures.residuals(calibration), pictures.parameter_plot(calibration)):
        assert pictures.data_uri(figure, simulated=False)


@pytest.mark.parametrize("name", ["\x1b[2Jx", "a\nb", "a\u202eb", "", "y" * 201, "=cmd|' /C calc'!A0", "+1", "@a"])
def test_names_that_no_machine_has_are_refused(name):
    text = record(4, calibration_poses=4).machine.text
    with pytest.raises(InputError, match="name") as refused:
        parse_machine(text.replace('"P1"', json.dumps(name)), "machine")
    assert printable(str(refused.value)) == str(refused.value)


@pytest.mark.parametrize("name", ["pkm-rig.sqlite-wal", "PKM-RIG.sqlite-shm", "pkm-rig-schema-1.sqlite"])
def test_no_campaign_takes_the_place_of_a_store_s_file(run, name, tmp_path):
    recording = record(4, calibration_poses=4)
    write_folder(recording, tmp_path / "folder")
    header = tmp_path / "folder" / "recording.toml"
    header.write_text(header.read_text(encoding="utf-8").replace('"plant-4"', f'"{name}"'), encoding="utf-8")
    with pytest.raises(InputError, match="files of a store"):
        read_toml(header, RecordingFile)
    for command in ("import", "diagnose", "compensate"):
        status, printed, complaint = run(command, tmp_path / "folder", "--out", tmp_path / "runs")
        assert (status, printed) == (2, "")
        assert "files of a store" in complaint.splitlines()[-1]
    assert not (tmp_path / "runs" / name).exists()
    assert name.lower().startswith(STORE_NAME.partition(".")[0])


@pytest.mark.parametrize(
    ("stem", "name"),
    [
        ("printer", "printer"),
        ("pkm-rig.sqlite-wal", "printer"),
        ("..", "printer"),
        ("a b/..", "printer"),
        ("-x$y", "x-y"),
    ],
)
def test_a_printer_s_folder_is_beside_the_store_s_files(stem, name, tmp_path):
    assert printer_name(tmp_path / f"{stem}.cfg") == name


@given(HOSTILE)
def test_a_console_obeys_nothing(name):
    for cell in (name, Text(name)):
        console = PeopleConsole()
        console.file = io.StringIO()
        console.width = 500
        table = Table(box=None)
        table.add_column("name")
        table.add_row(cell)
        console.print(f"name {name}", soft_wrap=True)
        console.print(table)
        shown = console.file.getvalue()
        assert "".join(letter for letter in shown if printable(letter) != letter).strip("\n") == ""
        if "\n" not in name:
            assert f"name {printable(name)}".rstrip() in [line.rstrip() for line in shown.splitlines()] or "u" in name


@settings(max_examples=25)
@given(HOSTILE)
def test_matplotlib_shows_a_name_letter_by_letter(name):
    figure = Figure(figsize=(1.0, 1.0))
    text = figure.suptitle(literal(name))
    pictures.data_uri(figure, simulated=True)
    shown, is_math = text._preprocess_math(text.get_text())
    assert not is_math
    assert shown == printable(name)
