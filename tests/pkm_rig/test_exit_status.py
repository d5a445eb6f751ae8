"""Exit statuses: 0 good, 1 refused, 2 input, 3 device or store, 4 internal; and which key was misspelt."""

from __future__ import annotations

import errno
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import pkm_rig.cli.rig_commands
import pkm_rig.jobs.report
import pkm_rig.report.outcome_text
import pkm_rig.store.store
from calibration.base.errors import InputError
from drivers.errors import NoAnswer
from pkm_rig.cli import main
from pkm_rig.errors import CampaignRefused, StoreError
from pkm_rig.rig.config import embedded_rig_path, load_rig


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    def command(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["pkm-rig", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), capsys.readouterr().err.strip().splitlines()

    return command


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (CampaignRefused("refused"), 1),
        (InputError("refused"), 2),
        (NoAnswer("PLC", "line", "refused", "wait"), 3),
        (StoreError("refused"), 3),
        (RuntimeError("refused"), 4),
        (ValueError("refused"), 4),
        (NotADirectoryError(errno.ENOTDIR, "refused", "file/tables"), 2),
        (IsADirectoryError(errno.EISDIR, "refused", "folder"), 2),
        (OSError(errno.ENAMETOOLONG, "refused", "a" * 300), 2),
        (PermissionError(errno.EACCES, "refused", "/root/tables"), 2),
        (OSError(errno.EROFS, "refused", "/mnt/tables"), 2),
        (OSError(errno.ENOSPC, "refused"), 3),
        (OSError(errno.EDQUOT, "refused"), 3),
        (OSError(errno.EIO, "refused"), 3),
        (OSError(errno.ECHILD, "refused"), 4),
    ],
)
def test_each_kind_of_failure_has_its_status(run, monkeypatch, error, status):
    def fail(_out):
        raise error

    monkeypatch.setattr(pkm_rig.store.store, "open_existing_store", fail)
    ended, lines = run("list")
    assert ended == status
    assert lines[-1].startswith("pkm-rig: ")
    if not (isinstance(error, OSError) and error.errno == errno.EIO):
        assert "refused" in lines[-1]
    assert ("internal error" in lines[-1]) == (status == 4)
    assert str(getattr(error, "filename", None) or "") in lines[-1]


def test_a_place_where_no_file_can_be_is_one_line_whatever_is_to_be_written_there(run, tmp_path):
    """Not by permissions: root may everything."""
    (tmp_path / "file").touch()
    printer = Path(__file__).parents[1] / "data" / "printer.cfg"
    ended, lines = run("import", printer, tmp_path / "file" / "delta", "--out", tmp_path)
    assert ended == 2
    assert len(lines) == 1
    assert f"{tmp_path / 'file' / 'delta'}: Not a directory; " in lines[0]


@pytest.mark.parametrize(
    ("decision", "writes", "refusal"),
    [
        ("accepted", True, None),
        ("refused", True, CampaignRefused),
        ("not decided", True, CampaignRefused),
        ("accepted", False, StoreError),
        ("refused", False, StoreError),
    ],
)
def test_a_result_that_is_not_accepted_never_ends_with_status_0(monkeypatch, tmp_path, decision, writes, refusal):
    def write(_outcome, _path):
        if not writes:
            raise OSError("no space")

    monkeypatch.setattr(pkm_rig.jobs.report, "write_outcome_report", write)
    monkeypatch.setattr(pkm_rig.report.outcome_text, "print_outcome", lambda _outcome, _path: None)
    outcome = SimpleNamespace(campaign="a", decision=decision, accepted=decision == "accepted", back_end="drive-tables")
    raised = None
    try:
        pkm_rig.cli.rig_commands._report_outcome(outcome, tmp_path, json=False)
    except (CampaignRefused, StoreError) as error:
        raised = error
    assert type(raised) is (type(None) if refusal is None else refusal)
    if refusal is CampaignRefused:
        assert decision in str(raised)


def rig_with(tmp_path, old, new):
    text = embedded_rig_path().read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "rig.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("command", "old", "new", "complaint"),
    [
        ("check", "position_m = [0.0, 0.3, 3.2]", "position_m = [2.9, 0.3, 1.2]", "in-plane uncertainty"),
        ("interim-test", "value_m = 1.6", "value_m = 1.61", "interim test"),
    ],
)
def test_a_check_that_fails_is_a_refusal(run, tmp_path, command, old, new, complaint):
    ended, lines = run(command, "--rig", rig_with(tmp_path, old, new))
    assert ended == 1, lines
    assert complaint in lines[-1]


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('rig = "embedded-mock"', 'rig = "embedded-mock"\nmachin = "x"', "machin"),
        ("[can]", "[can]\nspeed = 1", "can.speed"),
        ("node_id = 2", "node_id = 2\nvendorid = 1", "drives.1.vendorid"),
        ("[station.accuracy]", "[station.accuracy]\nangle_sd = 1", "station.accuracy.angle_sd"),
        ("[plc]", "[plc.registers.humidity_percent]\naddres = 1\n[plc]", "plc.registers.humidity_percent.addres"),
        ("[nuisance]", "[nuisance]\ndrift = 1", "nuisance.drift"),
        ("[nuisance]", "[limits]\nheartbeat = 1\n[nuisance]", "limits.heartbeat"),
        ("[nuisance]", "[campaign]\nposes = 1\n[nuisance]", "campaign.poses"),
    ],
)
def test_a_misspelt_key_is_named_with_its_table(tmp_path, old, new, key):
    with pytest.raises(InputError, match=f"unknown key '{key}'"):
        load_rig(rig_with(tmp_path, old, new))
