"""What the shell completes, asked as the shell asks, and the commands that are named as the next ones."""

from __future__ import annotations

import gzip
import shlex
import sys
from pathlib import Path

import pytest

from pkm_rig.cli import main
from pkm_rig.jobs.next_command import command_line, measure_more, rig_word
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.rig.runner import describe_campaign, settings_event
from pkm_rig.store.place import STORE_NAME
from pkm_rig.store.store import open_store
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file

STORE = Path(__file__).parents[1] / "data" / "version_0_1" / "store.db.gz"


@pytest.fixture
def completed(monkeypatch, capsys, tmp_path):
    """The words that a bash offers after some typed ones."""

    def ask(typed):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("_PKM_RIG_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", typed)
        monkeypatch.setenv("COMP_CWORD", str(len(shlex.split(typed)) - (0 if typed.endswith(" ") else 1)))
        monkeypatch.setattr(sys, "argv", ["pkm-rig"])
        with pytest.raises(SystemExit):
            main()
        return capsys.readouterr().out.split()

    return ask


def test_commands_and_campaigns_are_completed(completed, tmp_path):
    assert "demo" in completed("pkm-rig ")
    assert completed("pkm-rig show ") == []
    assert list(tmp_path.iterdir()) == []
    for out in ("runs", "other"):
        (tmp_path / out).mkdir()
        (tmp_path / out / STORE_NAME).write_bytes(gzip.decompress(STORE.read_bytes()))
    with open_store(tmp_path / "runs") as store:
        (campaign,) = [row[0] for row in store.campaigns()]
    assert completed("pkm-rig show ") == [campaign]
    assert completed(f"pkm-rig identify {campaign[:5]}") == [campaign]
    assert completed("pkm-rig report --out other ") == [campaign]
    assert completed("pkm-rig verify x") == []
    backup = f"other/{STORE_NAME}"
    for command in ("demo --resume", "calibrate --resume", "measure --resume", "audit", "mock --twin"):
        assert completed(f"pkm-rig {command} {campaign[:5]}") == [campaign]
    assert completed(f"pkm-rig show --out {backup} ") == [campaign]
    for path in ("list --out", "check --rig", "measure --campaign", "mock --new-rig", "mock --state", "import"):
        assert completed(f"pkm-rig {path} ") == []  # so the shell completes files
    assert completed("pkm-rig mock --twin ./") == []
    assert completed("pkm-rig show --out none ") == []
    (tmp_path / "runs" / STORE_NAME).write_bytes(b"not a store")
    assert completed("pkm-rig show ") == []


def test_the_next_command_is_quoted_and_names_rig_store_and_campaign(tmp_path):
    assert command_line("identify", Path("a b")) == "pkm-rig identify 'a b'"
    assert rig_word(embedded_rig_path()) == "embedded"
    assert rig_word(Path("my rig.toml")) == "my rig.toml"
    with mock_and_rig(*short_rig_file()) as (_, rig), open_store(tmp_path) as store:
        for name, path in (("a", tmp_path / "my rig.toml"), ("b", embedded_rig_path()), ("c", None)):
            rig.path = path
            store.add_campaign(describe_campaign(rig, name, "2026-01-01T00:00:00+00:00"), rig.machine.text)
            store.add_event(name, "settings", settings_event(rig))
        of_a, of_b, of_c = (measure_more(store, name, tmp_path) for name in "abc")
        assert of_c is None
        words = ["pkm-rig", "measure", "--rig", str(tmp_path / "my rig.toml"), "--out", str(tmp_path)]
        assert shlex.split(of_a) == [*words, "--resume", "a", "--campaign"]
        assert "--rig embedded " in of_b
        store.add_event("a", "verifying", {"first_sequence": 0})
        assert shlex.split(measure_more(store, "a", tmp_path)) == [*words, "--campaign"]
