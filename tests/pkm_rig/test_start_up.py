"""What a command loads before it does anything: help and usage errors must come at once."""

from __future__ import annotations

import subprocess
import sys

import pytest

import pkm_rig
from pkm_rig.cli.entry import COMMANDS

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
