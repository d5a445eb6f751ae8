"""What commands that connect tell of a machine's life, over the real protocols of the embedded mock rig."""

from __future__ import annotations

from contextlib import closing
from datetime import date

import numpy as np
import pytest

from calibration.identification.calibration import identify_recording
from calibration.reduction.figures import Figures
from pkm_rig.jobs.life_record import key_of, note_devices, operating_h, pooled, record_identified
from pkm_rig.rig.config import RigFile, embedded_rig_path, load_rig
from pkm_rig.rig.recalibration_sections import CertificateEntry
from pkm_rig.store.life import life_rows
from pkm_rig.store.life_facts import covariance_of
from pkm_rig.store.store import Store
from tests.pkm_rig.plant_recording import record

RIG = "embedded-mock"


@pytest.fixture
def store(tmp_path):
    with closing(Store(tmp_path / "store.sqlite")) as made:
        yield made


def with_tolerance(rig, tolerance_m):
    section = rig.file.recalibration.model_copy(update={"tolerance_m": tolerance_m})
    rig.file = rig.file.model_copy(update={"recalibration": section})


def test_devices_are_noted_once_and_changes_are_said(short_rig, store):
    _, rig = short_rig
    said = []
    rig.file = rig.file.model_copy(
        update={"certificates": (CertificateEntry(instrument="station", number="K-1", due=date(2027, 3, 31)),)}
    )
    with_tolerance(rig, 3e-5)
    assert note_devices(rig, store, said.append) == []
    kinds = [(row.kind, row.data["name"]) for row in life_rows(store, "instruments", RIG)]
    assert kinds == [("drive", "left"), ("drive", "right"), ("station", "station"), ("certificate", "station")]
    assert [row.kind for row in life_rows(store, "machine_events", RIG)] == ["tolerance changed"]
    assert note_devices(rig, store, said.append) == []
    assert len(life_rows(store, "instruments", RIG)) == 4
    identity = rig.drives.drives[0].identity
    rig.drives.drives[0].identity = type(identity)(identity.vendor, identity.product, identity.revision, 0x53494D09)
    with_tolerance(rig, 2e-5)
    changes = note_devices(rig, store, said.append)
    assert changes == said == [
        f"drive left was replaced: serial number {0x53494D09}, before {identity.serial}",
        "the tolerance is 20 um, before 30 um",
    ]  # fmt: skip
    replaced = [row for row in life_rows(store, "machine_events", RIG) if row.kind == "drive replaced"]
    assert [(row.data["part"], row.data["serial"]) for row in replaced] == [("left", str(0x53494D09))]
    assert note_devices(rig, store, said.append) == []


def test_another_machine_file_begins_the_history_anew(short_rig, store):
    _, rig = short_rig
    note_devices(rig, store, lambda _line: None)
    file = rig.machine.file.model_copy(update={"reference_temperature_c": 21.0})
    object.__setattr__(rig.machine, "file", file)
    (line,) = note_devices(rig, store, lambda _line: None)
    assert line.endswith("its history begins anew")
    assert life_rows(store, "machines", RIG)[-1].machine == key_of(rig)


def test_what_was_identified_is_kept_with_its_covariance(short_rig, store):
    _, rig = short_rig
    calibration = identify_recording(record(3), baselines=False)
    record_identified(rig, store, "c1", calibration, now_s=5000.0)
    (row,) = life_rows(store, "calibrations", RIG)
    fit = calibration.fit
    count = len(fit.theta)
    np.testing.assert_array_equal(row.data["values"], fit.theta)
    np.testing.assert_array_equal(covariance_of(row.data), fit.covariance[:count, :count])
    assert row.data["parameters"] == list(fit.model.parameters.names)
    assert (row.kind, row.campaign, row.data["instrument"]) == ("identified", "c1", str(rig.station.identity.serial))
    assert row.machine == key_of(rig)


def test_operating_time_is_that_since_the_first_record(short_rig, store):
    _, rig = short_rig
    assert operating_h(rig, store, 7200.0) == 0.0
    note_devices(rig, store, lambda _line: None, now_s=lambda: 3600.0)
    assert operating_h(rig, store, 9000.0) == pytest.approx(1.5)
    assert operating_h(rig, store, 0.0) == 0.0  # the clock was set back


def test_the_uncertainty_of_pooled_figures_is_that_of_draws():
    """Against draws of both RMS values."""
    several = [Figures(8e-6, 0.0, 0.0, 1e-6, 0.0, 40), Figures(12e-6, 0.0, 0.0, 2e-6, 0.0, 20)]
    rng = np.random.default_rng(7)
    draws = [rng.normal(f.position_rms_m, f.u_position_rms_m, 200_000) for f in several]
    together = np.sqrt((40 * draws[0] ** 2 + 20 * draws[1] ** 2) / 60)
    got = pooled(several)
    assert got["position_m"] == pytest.approx(np.sqrt((40 * 64 + 20 * 144) / 60) * 1e-6)
    assert got["u_m"] == pytest.approx(together.std(), rel=0.03)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"recalibration": {"tolerance_m": 0.0}}, "tolerance_m"),
        ({"recalibration": {"operating_time": "on_s"}}, r"'on_s' is not in \[\[plc.readings\]\]"),
        ({"certificates": [{"instrument": "station", "number": "1", "due": "soon"}]}, "due"),
    ],
)
def test_a_rig_file_that_cannot_be_is_refused(change, complaint):
    file, _ = load_rig(embedded_rig_path())
    with pytest.raises(ValueError, match=complaint):
        RigFile.model_validate(file.model_dump(mode="json") | change)
