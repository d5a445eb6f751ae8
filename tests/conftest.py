"""Loaded before any test loads numpy: linear algebra on one thread, as for the command; one profile of Hypothesis."""

import importlib
from contextlib import suppress
from pathlib import Path

import hypothesis
import pytest

import pkm_rig

assert pkm_rig.__version__

# Every run tries the same cases, however long one takes, and keeps no examples on disk.
hypothesis.settings.register_profile("pkm_rig", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("pkm_rig")

# Each worker takes whole files. Those that take long go first, or one of them begins when all others have ended.
LONG_FILES = (
    "benchmarks/test_withheld.py",
    "pkm_rig/jobs/test_calibrate.py",
    "pkm_rig/jobs/test_kinematics_files.py",
    "pkm_rig/jobs/test_calibrate_resume.py",
    "pkm_rig/jobs/test_resume_scaled_clock.py",
    "pkm_rig/jobs/test_host_campaign.py",
    "calibration/comparison/test_compare.py",
    "calibration/diagnosis/test_diagnosis.py",
    "calibration/axis/test_axis_diagnosis.py",
    "drivers/drives/test_homing.py",
    "drivers/station/test_station_contract.py",
    "faults/test_can.py",
    "faults/test_modbus.py",
    "faults/test_serial.py",
    "faults/test_station_and_time.py",
    "pkm_rig/recalibration/test_run.py",
    "pkm_rig/jobs/test_resume.py",
    "pkm_rig/test_terminal_operator.py",
    "docs/test_tutorial.py",
    "pkm_rig/test_wheel.py",
    "pkm_rig/rig/test_plans.py",
    "pkm_rig/report/test_report.py",
    "pkm_rig/jobs/test_measure_watched.py",
    "benchmarks/test_channel_sizes.py",
)
_HERE = Path(__file__).parent
_RANK = {_HERE / file: rank for rank, file in enumerate(LONG_FILES)}
assert all(file.is_file() for file in _RANK), "name files in LONG_FILES as they are called now"


def pytest_collection(session):
    """Each worker imports its share of the test files before all collect the same ones in the same order.

    They start together: in a new checkout each would compile every file itself, which is most of what starting costs.
    """
    worker = getattr(session.config, "workerinput", None)
    if worker is not None:
        share = slice(int(worker["workerid"].removeprefix("gw")), None, worker["workercount"])
        wanted = [Path(argument.partition("::")[0]).resolve() for argument in session.config.args]
        files = [file for file in sorted(_HERE.rglob("test_*.py")) if any(file.is_relative_to(path) for path in wanted)]
        for file in files[share]:
            # What cannot be imported, or is not to be, says so when it is collected.
            with suppress(Exception, pytest.skip.Exception):
                importlib.import_module(".".join(file.relative_to(_HERE.parent).with_suffix("").parts))


def pytest_collection_modifyitems(config, items):
    """For workers, the long files first; all else stays in its order."""
    if hasattr(config, "workerinput"):
        items.sort(key=lambda item: _RANK.get(item.path, len(_RANK)))
