"""The built wheel, installed in an environment of its own outside the checkout, used from an empty folder."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import tomllib
import venv
from pathlib import Path

import pytest

from pkm_rig.version import __version__
from tests.pkm_rig.conftest import SHORT, SLIDERS, campaign_lines

ROOT = Path(__file__).parents[2]
CAMPAIGN = {**SHORT, **SLIDERS, "calibration_poses": 6, "verification_payloads": [0]}
PACKAGES = ("pkm_rig", "drivers", "calibration", "mock_devices")


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """The `bin` folder of an environment that has the wheel, and its dependencies from this one."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, source)
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", folder]
    subprocess.run([*pip, "wheel", *options, source], check=True)
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "env", symlinks=True)
    python = folder / "env" / "bin" / "python"
    subprocess.run([*pip, "--python", python, "install", "--quiet", "--no-deps", "--no-index", wheel], check=True)
    (site,) = (folder / "env").glob("lib/python*/site-packages")
    # A folder in a .pth file is searched, but the .pth files in it, such as that of the checkout, are not read.
    (site / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n", encoding="utf-8")
    return folder / "env" / "bin"


def start(program, *arguments, folder):
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return subprocess.Popen(
        [program, *arguments], cwd=folder, env=clean, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )


def run(program, *arguments, folder):
    process = start(program, *arguments, folder=folder)
    printed, _ = process.communicate(timeout=120)
    assert process.returncode == 0, printed
    return printed


@pytest.fixture
def empty(tmp_path):
    folder = tmp_path / "empty"
    folder.mkdir()
    return folder


def test_it_holds_every_file_that_is_read_by_default(environment, empty):
    script = "import pkm_rig, pathlib; print(pathlib.Path(pkm_rig.__file__).parent.parent)"
    site = Path(run(environment / "python", "-c", script, folder=empty).strip())
    assert site.is_relative_to(environment.parent)
    data = [
        path.relative_to(ROOT)
        for name in PACKAGES
        for path in (ROOT / name).rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    ]
    assert {path.suffix for path in data} == {".py", ".typed", ".toml", ".html", ".css", ".js", ".eds"}
    assert [path for path in data if not (site / path).is_file()] == []


def test_it_calibrates_from_an_empty_folder(environment, empty):
    assert run(environment / "pkm-rig", "--version", folder=empty) == f"pkm-rig {__version__}\n"
    rig = (ROOT / "pkm_rig" / "rig" / "data" / "embedded.toml").read_text(encoding="utf-8")
    (empty / "rig.toml").write_text(f"{rig}\n[campaign]\n{campaign_lines(CAMPAIGN)}", encoding="utf-8")
    process = start(environment / "pkm-rig", "calibrate", "--rig", "rig.toml", folder=empty)
    printed, _ = process.communicate(timeout=300)
    assert process.returncode in {0, 1}, printed  # so short a campaign may be refused
    assert "noise floor" in printed
    assert len(list(empty.glob("runs/*/report.html"))) == 1


def test_it_serves_the_mock_rig_from_an_empty_folder(environment, empty):
    process = start(environment / "pkm-rig", "mock", folder=empty)
    lines = [process.stdout.readline() for _ in range(8)]
    process.send_signal(signal.SIGINT)
    rest, _ = process.communicate(timeout=60)
    assert process.returncode == 0, rest
    assert [line.split(":")[0] for line in lines] == [
        *("machine", "effects", "faults", "twin"),
        *("station", "drives", "PLC", "time"),
    ]


def test_it_announces_its_pytest_plugin(environment, empty):
    script = "from importlib.metadata import entry_points as e; print(*(p.value for p in e(group='pytest11')))"
    assert "pkm_rig.pytest_plugin" in run(environment / "python", "-c", script, folder=empty).split()


def test_the_example_is_the_default():
    """examples/mock-rig.toml is what users copy; `pkm-rig mock` reads the same file from its package."""
    example = (ROOT / "examples" / "mock-rig.toml").read_text(encoding="utf-8")
    assert example == (ROOT / "pkm_rig" / "rig" / "data" / "mock-rig.toml").read_text(encoding="utf-8")
    assert tomllib.loads(example)["rig"] == "mock-rig"
