"""Every reader of TOML and CSV, given a good file with hostile changes: a whole object, or one line."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.base.errors import InputError
from calibration.machine.description import Machine, load_machine, shipped_machine
from calibration.recording.folder import read_folder, write_folder
from calibration.recording.klipper import read_printer
from calibration.recording.measurement_folder import read_measurements
from drivers.drives import drive_profile
from mock_devices.machine_file import MachineFileError, read_machine_file
from pkm_rig.jobs.measured_machine import import_printer
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.visits_file import with_visits
from tests.either import either
from tests.pkm_rig.plant_recording import record

CAMPAIGN = """
[[campaign.visits]]
target = [0.0, 0.3]
payload = 0

[[campaign.visits]]
target = [0.1, 0.4]
payload = 1
direction = [1, -1]
"""


@dataclass(frozen=True)
class Reader:
    """A reader, one of whose files is changed, and what holds of whatever it gives."""

    file: str
    read: Callable[[Path], Any]
    holds: Callable[[Any], bool]
    refusal: type[Exception] = InputError


def finite_machine(machine: Machine) -> bool:
    nominal = machine.nominal
    return bool(np.all(np.isfinite(machine.travel)) and np.all(np.isfinite(nominal.axis)) and machine.name)


def finite_recording(recording: Any) -> bool:
    needed = [recording[name] for name in ("t_rig_s", "x_m", "y_m", "z_m", "cov_xx_m2")]
    return len(recording) > 0 and all(bool(np.all(np.isfinite(column))) for column in needed)


def whole_rig(pair: Any) -> bool:
    rig, machine = pair
    return len(rig.drives) == len(machine.drive_names) == 2 and rig.payloads[0].mass_kg == 0.0


def finite_measurements(measured: Any) -> bool:
    return bool(np.all(np.isfinite(measured.visits.drives))) and len(measured.number) > 0


READERS = {
    "recording.toml": Reader("folder/recording.toml", lambda p: read_folder(p.parent), finite_recording),
    "readings.csv": Reader("folder/readings.csv", lambda p: read_folder(p.parent), finite_recording),
    "machine of a recording": Reader("folder/machine.toml", lambda p: read_folder(p.parent), finite_recording),
    "machine": Reader("machine.toml", load_machine, finite_machine),
    "the mock's machine": Reader(
        "machine.toml", read_machine_file, lambda m: len(m.sliders) >= 1 and bool(m.name), MachineFileError
    ),
    "rig": Reader("rig.toml", load_rig, whole_rig),
    "campaign": Reader(
        "campaign.toml",
        lambda p: with_visits(load_rig(embedded_rig_path())[0], p, load_rig(embedded_rig_path())[1]),
        lambda rig: len(rig.campaign.visits) > 0 and all(v.payload <= 2 for v in rig.campaign.visits),
    ),
    "campaign as CSV": Reader(
        "campaign.csv",
        lambda p: with_visits(load_rig(embedded_rig_path())[0], p, load_rig(embedded_rig_path())[1]),
        lambda rig: len(rig.campaign.visits) > 0 and all(v.payload <= 2 for v in rig.campaign.visits),
    ),
    "drive profile": Reader(
        "profile.toml",
        lambda p: drive_profile.load_profile(p.name, p.parent),
        lambda profile: isinstance(profile.name, str) and profile.home_offset_sign in (1, -1),
        ValueError,
    ),
    "measurements.toml": Reader(
        "measured/measurements.toml", lambda p: read_measurements(p.parent), finite_measurements
    ),
    "coordinates.csv": Reader("measured/coordinates.csv", lambda p: read_measurements(p.parent), finite_measurements),
    "distances.csv": Reader("measured/distances.csv", lambda p: read_measurements(p.parent), finite_measurements),
    "printer.cfg": Reader("printer.cfg", read_printer, lambda printer: bool(np.all(np.isfinite(printer.step_m)))),
}
PIECES = st.one_of(
    st.binary(max_size=12),
    st.text(max_size=8).map(str.encode),
    st.sampled_from(
        [
            b"nan", b"-inf", b"1e999", b"9" * 500, b"0x" + b"f" * 500, b"[" * 40, b"a." * 30, b"\n[a.b]\n", b"'", b'"',
            b'"""', b"\\u0000", b"\x1b[2J", b"1979-05-27T07:32:00Z", b"true", b"=", b",", b",,,,", b"\r", b"\0", b"-1",
            b"1e308", b"../../etc/passwd", b"[/b]", b"$\\frac{$", b"=cmd|' /C calc'!A0", "\u202e".encode(), b"# ",
        ]
    ),
)  # fmt: skip


@pytest.fixture(scope="module")
def good(tmp_path_factory, request):
    """All good files in one folder."""
    place = tmp_path_factory.mktemp("good")
    write_folder(record(2, calibration_poses=4), place / "folder")
    shutil.copy(shipped_machine("planar4"), place / "machine.toml")
    shutil.copy(embedded_rig_path(), place / "rig.toml")
    (place / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    (place / "campaign.csv").write_text("target_x_m,target_y_m,payload\n0.1,0.2,0\n-0.1,0.2,2\n", encoding="utf-8")
    shutil.copy(Path(drive_profile.__file__).parent / "profiles" / "pkm-mock.toml", place / "profile.toml")
    printer = request.config.rootpath / "tests" / "data" / "printer.cfg"
    shutil.copy(printer, place / "printer.cfg")
    import_printer(printer, place / "measured")
    return place


@pytest.mark.parametrize("name", READERS)
def test_the_good_file_is_read(good, name):
    reader = READERS[name]
    assert reader.holds(reader.read(good / reader.file))


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(changes=st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 20), PIECES), min_size=1, max_size=3))
def test_changed_it_gives_something_whole_or_one_line(good, name, changes):
    reader = READERS[name]
    whole = (good / reader.file).read_bytes()
    changed = whole
    for at, dropped, piece in changes:
        start = int(at * len(changed))
        changed = changed[:start] + piece + changed[start + dropped :]
    (good / reader.file).write_bytes(changed)
    try:
        found, complaint = either(lambda: reader.read(good / reader.file), reader.refusal)
    finally:
        (good / reader.file).write_bytes(whole)
    if complaint is None:
        assert reader.holds(found)
    else:
        assert len(complaint) < 1000
        assert found is None
