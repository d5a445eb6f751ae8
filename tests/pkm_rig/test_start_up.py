"""What a command loads before it does anything: help and usage errors must come at once."""

from __future__ import annotations

import gzip
import subprocess
import sys
from pathlib import Path

import pytest

import pkm_rig
from pkm_rig.cli.entry import COMMANDS
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.store.place import STORE_NAME

STORE = Path(__file__).parents[1] / "data" / "version_0_1" / "store.db.gz"
FOR_WORK = ("numpy", "sqlalchemy", "bluesky", "matplotlib", "scipy", "canopen", "pymodbus", "jinja2")
FOR_RIGS_AND_REPORTS = ("scipy", "bluesky", "matplotlib", "canopen")
REPORT = """
import sys
sys.argv = ["pkm-rig", *sys.argv[1:]]
from pkm_rig.cli import main
try:
    main()
except SystemExit as ended:
    code = ended.code or 0
print("loaded", code, *(name for name in sys.modules if "." not in name))
"""


def loaded_by(*arguments, folder):
    """Exit status and top-level modules of a command in an interpreter of its own."""
    done = subprocess.run(
        [sys.executable, "-c", REPORT, *arguments], cwd=folder, capture_output=True, text=True, timeout=60, check=True
    )
    status, *modules = done.stdout.splitlines()[-1].removeprefix("loaded ").split()
    return int(status), set(modules)


@pytest.mark.parametrize(
    "arguments",
    [("--help",), ("--version",), *((name, "--help") for name in COMMANDS)],
    ids=" ".join,
)
def test_help_loads_nothing_that_is_for_work(arguments, tmp_path):
    status, modules = loaded_by(*arguments, folder=tmp_path)
    assert status == 0
    assert not modules & set(FOR_WORK)


@pytest.mark.parametrize("arguments", [("calibrat",), ("calibrate", "--colour"), ("verify",), ("list", "--out")])
def test_so_do_usage_errors(arguments, tmp_path):
    status, modules = loaded_by(*arguments, folder=tmp_path)
    assert status == 2
    assert not modules & set(FOR_WORK)


@pytest.mark.parametrize("arguments", [("list",), ("show", "nothing"), ("list", "--json")])
def test_looking_into_the_store_loads_neither_rig_nor_report(arguments, tmp_path):
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / STORE_NAME).write_bytes(gzip.decompress(STORE.read_bytes()))
    status, modules = loaded_by(*arguments, folder=tmp_path)
    assert status == (2 if "nothing" in arguments else 0)
    assert "sqlalchemy" in modules
    assert not modules & set(FOR_RIGS_AND_REPORTS)


def test_the_python_interface_loads_nothing_until_it_is_used(tmp_path):
    script = "import os, sys, pkm_rig; print(os.environ['OPENBLAS_NUM_THREADS'], *sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=True
    )
    threads, *modules = done.stdout.split()
    assert threads == "1"
    assert not set(modules) & set(FOR_WORK)
    assert set(pkm_rig.__all__) == {name for name in pkm_rig.__all__ if callable(getattr(pkm_rig, name))}


@pytest.mark.parametrize("arguments", [("list",), ("show", "any"), ("report", "any"), ("export", "any", "folder")])
def test_no_store_is_said_and_none_is_made(arguments, tmp_path):
    status, _ = loaded_by(*arguments, "--out", "misspelt", folder=tmp_path)
    assert status == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", [("calibrate",), ("verify", "any")])
def test_a_rig_that_cannot_is_refused_before_anything_heavy_is_loaded(command, tmp_path):
    text = embedded_rig_path().read_text(encoding="utf-8")
    text = text.replace("metres_per_increment = 1.0e-8", 'metres_per_increment = 1.0e-8\nprofile = "plain-402"')
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    status, modules = loaded_by(*command, "--rig", "rig.toml", folder=tmp_path)
    assert status == 2
    assert not modules & {"scipy", "bluesky", "sqlalchemy", "matplotlib", "jinja2"}
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]
