"""A device that is simulated says so, and nothing that comes from it can be taken for a machine's."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace

import pytest
from matplotlib.figure import Figure

import mock_devices.drives.mock_drive
import mock_devices.plc.plc_registers
import mock_devices.station.mock_station
from calibration.base.errors import InputError
from calibration.recording.folder import read_folder, write_folder
from drivers.drives.drive_records import DriveIdentity
from drivers.plc.plc_registers import SIMULATED, RegisterMap, decode
from drivers.station.station_setup import StationIdentity
from pkm_rig.report.diagnosis_pictures import save
from pkm_rig.report.pictures import data_uri
from pkm_rig.rig.device_sections import PlcConnection
from pkm_rig.rig.plc_connection import register_map
from pkm_rig.rig.rig_checks import require_same_kind
from pkm_rig.rig.runner import describe_campaign, settings_event
from pkm_rig.store.store import open_store
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file
from tests.pkm_rig.plant_recording import record

REAL = {
    "station": (mock_devices.station.mock_station, "NAME", "TDRA6000"),
    "drives": (mock_devices.drives.mock_drive, "SIMULATED_SERIAL", 4000),
    "PLC": (mock_devices.plc.plc_registers, "_SIMULATED", 0),
}
NAMES = {"station": ("mock station",), "drives": ("drive left", "drive right"), "PLC": ("PLC",)}


@pytest.fixture
def rig_of(monkeypatch):
    """What a rig on the mock says of itself where all but some devices have a real one's identity."""

    def connect(*simulated, ask):
        for device, (module, name, value) in REAL.items():
            if device not in simulated:
                monkeypatch.setattr(module, name, value)
        with mock_and_rig(*short_rig_file()) as (_, rig):
            answer = ask(rig)
        monkeypatch.undo()
        return answer

    return connect


@pytest.mark.parametrize("device", REAL)
def test_one_simulated_device_makes_the_campaign_simulated(rig_of, device):
    def ask(rig):
        return rig.simulated_devices, describe_campaign(rig, "a", "2026-01-01T00:00:00+00:00").simulated

    assert rig_of(device, ask=ask) == (NAMES[device], True)


def test_a_campaign_does_not_go_on_with_devices_of_another_kind(rig_of, tmp_path):
    def begin(campaign, *, old=False):
        def ask(rig):
            header = describe_campaign(rig, campaign, "2026-01-01T00:00:00+00:00")
            assert header.simulated is (campaign != "real")
            with open_store(tmp_path) as store:
                store.add_campaign(header.model_copy(update={"simulated": False}) if old else header, rig.machine.text)
                store.add_event(campaign, "settings", settings_event(rig))
                require_same_kind(rig, store, campaign)  # on the rig that it was begun on it goes on
                return [refusal(rig, store, other) for other in ("real", "mock", "version-0.1") if other != campaign]

        return ask

    def refusal(rig, store, campaign):
        if campaign not in [row[0] for row in store.campaigns()]:
            return ""
        try:
            require_same_kind(rig, store, campaign)
        except InputError as error:
            return str(error)
        return "goes on"

    real, mock = REAL.keys() ^ REAL.keys(), REAL.keys()
    assert rig_of(*real, ask=begin("real")) == ["", ""]
    on_real, _ = rig_of(*mock, ask=begin("mock"))
    assert "measured with real devices" in on_real
    assert "station, drive left, drive right, PLC are simulated" in on_real
    assert rig_of(*mock, ask=begin("version-0.1", old=True))[1] == "goes on"
    with open_store(tmp_path) as store:
        assert [store.header(name).simulated for name in ("real", "mock", "version-0.1")] == [False, True, False]
        assert {row.campaign: row.simulated for row in store.campaigns()}["mock"] is True
        assert sum(row.simulated for row in store.campaigns()) == 1
        *_, on_mock = rig_of(*real, ask=lambda rig: [refusal(rig, store, "mock")])
    assert "measured with simulated devices, and none of these devices is simulated" in on_mock


@pytest.mark.parametrize(
    ("name", "simulated"),
    [
        ("MOCK TDRA", True),
        ("TDRA6000 simulated", True),
        ("Mock-6000", True),
        ("TDRA6000", False),
        ("MOCKINGBIRD", False),
    ],
)
def test_the_name_of_a_station(name, simulated):
    assert StationIdentity(name, 1, (1, 0, 0), (1, 0, 0)).simulated is simulated


@pytest.mark.parametrize(
    ("serial", "simulated"),
    [(0x53494D01, True), (0x53494DFF, True), (0x53494E00, False), (0x53494CFF, False), (1001, False), (0, False)],
)
def test_the_serial_number_of_a_drive(serial, simulated):
    assert DriveIdentity(0x504B, 0x402, 1, serial).simulated is simulated


@pytest.mark.parametrize(("word", "simulated"), [(SIMULATED, True), (0, False), (1, False), (0xFFFF, False)])
def test_the_register_of_a_plc(word, simulated):
    registers = RegisterMap(simulated=18, temperatures_c={}, interlocks_inverted=None)
    words = [0] * registers.count
    words[14:16] = [0x447D, 0x2000]  # 1012.5 hPa
    words[18] = word
    assert decode(registers, words, fresh=True, times_s=(0.0, 0.0)).simulated is simulated


@pytest.mark.parametrize(
    ("section", "address"),
    [
        ({}, 18),
        ({"registers": {"air_temperature_c": 40}}, 18),
        ({"without": ("simulated",)}, None),
        ({"registers": {"simulated": 50}}, 50),
        ({"registers": {name: 100 + 2 * i for i, name in enumerate((
            "heartbeat", "interlocks", "interlocks_inverted", "payload", "master_seen", "pressure_hpa",
            "humidity_percent", *(f"{part}_temperature_c" for part in ("air", "struts", "columns", "base", "platform")),
        ))}}, None),
    ],
)  # fmt: skip
def test_where_the_register_is(section, address):
    registers = register_map(PlcConnection.model_validate(section))
    assert registers.simulated == address
    if address is not None:
        assert registers.first <= address < registers.first + registers.count


def test_a_recording_folder_says_it_only_if_it_is(tmp_path):
    real = record(4, calibration_poses=4)
    for name, simulated in (("real", False), ("mock", True)):
        recording = replace(real, file=real.file.model_copy(update={"simulated": simulated}))
        write_folder(recording, tmp_path / name)
        header = tomllib.loads((tmp_path / name / "recording.toml").read_text(encoding="utf-8"))
        assert header.get("simulated") is (True if simulated else None)
        assert read_folder(tmp_path / name).file.simulated is simulated
        assert ("simulated" in json.loads(recording.file.model_dump_json())) is simulated


def test_pictures_say_it(tmp_path):
    figures = {name: Figure() for name in ("mock", "real", "saved")}
    marked, plain = data_uri(figures["mock"], simulated=True), data_uri(figures["real"], simulated=False)
    assert marked != plain
    assert [text.get_text() for text in figures["mock"].texts] == ["SIMULATED"]
    assert figures["real"].texts == []
    save({"saved": figures["saved"]}, tmp_path, simulated=True)
    assert [text.get_text() for text in figures["saved"].texts] == ["SIMULATED"]
