"""A mock rig on real transports: pseudo-terminal, socketcand and Modbus TCP, in scaled time."""

from __future__ import annotations

import socket
import threading
from contextlib import ExitStack

import numpy as np
import pytest
import trustme

from calibration.base.errors import InputError
from drivers.errors import ConnectionFailed, DriveFault, NoAnswer, ProtocolError
from pkm_rig.jobs.check import check_devices
from pkm_rig.rig.clock import ScaledClock
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.virtual.mock_rig import settings_of
from pkm_rig.virtual.served_rig import how_to_connect, serve_mock_rig


def free_ports(count):
    with ExitStack() as stack:
        probes = [stack.enter_context(socket.socket()) for _ in range(count)]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [probe.getsockname()[1] for probe in probes]


@pytest.fixture
def rig_path(tmp_path, request):
    """The example rig on free ports."""
    can_port, plc_port = free_ports(2)
    text = (request.config.rootpath / "examples" / "mock-rig.toml").read_text(encoding="utf-8")
    text = text.replace("29536", str(can_port)).replace("15020", str(plc_port))
    path = tmp_path / "rig.toml"
    path.write_text(text.replace("/tmp/pkm-rig-station", str(tmp_path / "station")), encoding="utf-8")
    return path


def test_the_example_rig_is_served_checked_and_moved_over_real_transports(rig_path, tmp_path):
    file, machine = load_rig(rig_path)
    with serve_mock_rig(file, rig_path) as mock:
        lines = how_to_connect(file, rig_path, mock)
        assert str(tmp_path / "station") in lines[0]
        assert str(file.can.port) in lines[1]
        assert str(file.plc.port) in lines[2]
        clock = ScaledClock(file.time_scale)
        with connect_rig(file, machine, clock) as rig:
            assert check_devices(rig)["problems"] == []
            rig.enable()
            rig.move(np.array([1.15, 1.10]), 0.2)
            np.testing.assert_allclose(rig.positions_m(), [1.15, 1.10], atol=1e-7)
        clock.close()
        assert not any(drive.axis.powered for drive in mock.drives)
    assert not (tmp_path / "station").is_symlink()


def test_a_file_in_the_place_of_the_terminals_link_is_not_touched(rig_path, tmp_path):
    (tmp_path / "station").write_text("mine")
    file, _ = load_rig(rig_path)
    with pytest.raises(InputError, match="another path"), serve_mock_rig(file, rig_path):
        pass
    assert (tmp_path / "station").read_text() == "mine"


def test_a_station_that_answers_nonsense_is_named_and_the_drives_are_left_alone(rig_path):
    file, machine = load_rig(rig_path)
    with serve_mock_rig(file, rig_path) as mock, socket.create_server(("127.0.0.1", 0)) as server:

        def babble():
            line, _ = server.accept()
            with line:
                while line.recv(200):
                    line.sendall(b"\xff\x00 what? \r\n")

        talker = threading.Thread(target=babble, daemon=True)
        talker.start()
        port = f"socket://127.0.0.1:{server.getsockname()[1]}"
        station = file.station.model_copy(update={"port": port})
        clock = ScaledClock(file.time_scale)
        with (
            pytest.raises((ProtocolError, ConnectionFailed, NoAnswer)) as caught,
            connect_rig(file.model_copy(update={"station": station}), machine, clock),
        ):
            pass
        clock.close()
        talker.join(5.0)
        assert port in str(caught.value)
        assert "\n" not in str(caught.value)
        assert not any(drive.axis.powered for drive in mock.drives)


@pytest.mark.parametrize("transport", ["tls", "rtu"])
def test_the_mock_serves_its_plc_by_tls_and_rtu(rig_path, tmp_path, transport):
    authority = trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    certificate = authority.issue_cert("127.0.0.1")
    certificate.cert_chain_pems[0].write_to_path(tmp_path / "plc.pem")
    certificate.private_key_pem.write_to_path(tmp_path / "plc.key")
    changes = {
        "tls": 'transport = "tls"\nca_file = "ca.pem"',
        "rtu": f'transport = "rtu"\nserial_port = "{tmp_path / "plc"}"\nparity = "N"',
    }
    text = rig_path.read_text(encoding="utf-8").replace("[plc]", f"[plc]\n{changes[transport]}")
    text = text.replace("[mock]", '[mock]\nplc_certificate_file = "plc.pem"\nplc_key_file = "plc.key"')
    rig_path.write_text(text, encoding="utf-8")
    file, machine = load_rig(rig_path)
    with serve_mock_rig(file, rig_path) as mock:
        assert f"Modbus {transport.upper()}" in how_to_connect(file, rig_path, mock)[2]
        clock = ScaledClock(file.time_scale)
        with connect_rig(file, machine, clock, rig_path=rig_path) as rig:
            assert rig.supervisor.state().payload == 0
        clock.close()


def test_a_fault_by_name_strikes_a_served_rig(rig_path):
    file, machine = load_rig(rig_path)
    with serve_mock_rig(file, rig_path, ["drive-emergency@5", "serial-split@3"]) as mock:
        clock = ScaledClock(file.time_scale)
        with connect_rig(file, machine, clock) as rig:
            rig.enable()
            with pytest.raises(DriveFault, match="0x2310"):
                rig.move(np.array([1.15, 1.10]), 0.2)
        clock.close()
        assert set(mock.faults.struck) == {"drive-emergency", "serial-split"}
    for wrong in ("nothing@1", "serial-lost"):
        with pytest.raises(InputError, match="--fault"), serve_mock_rig(file, rig_path, [wrong]):
            pass


def test_the_mocks_station_is_as_good_as_the_rig_file_states():
    file, _ = load_rig(embedded_rig_path())
    stated = {"angle_sd_rad": 1.1e-6, "range_sd_m": 2.2e-5, "range_constant_u_m": 3.3e-5, "range_scale_u": 4.4e-7}
    drift = {"drift_rad_per_sqrt_h": 5.5e-6, "drift_of_level_rad_per_sqrt_h": 6.6e-6, "drift_m_per_sqrt_h": 7.7e-6}
    accuracy = file.station.accuracy.model_copy(update=stated | drift)
    station = file.station.model_copy(update={"accuracy": accuracy})
    instrument = settings_of(file.model_copy(update={"station": station})).instrument
    assert {name: getattr(instrument, name) for name in stated} == stated
    assert (instrument.drift_about_vertical_rad, instrument.drift_of_level_rad, instrument.drift_m) == (
        5.5e-6,
        6.6e-6,
        7.7e-6,
    )
