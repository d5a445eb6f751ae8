"""One contract for the PLC's driver, run over each kind of line to the mock PLC."""

from __future__ import annotations

import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path

import pytest
import trustme
from pymodbus.client.base import ModbusBaseClient

import calibration
from drivers.errors import ConnectionFailed, InterlockOpen, NoAnswer, PlcError, StaleData
from drivers.plc.modbus_line import ModbusLine, RtuLine, TcpLine, TlsLine
from drivers.plc.plc import Plc, PlcTiming
from drivers.plc.plc_registers import ReadingRegister, RegisterMap
from mock_devices.faults import Fault, FaultPlan
from mock_devices.plant.plant import Plant
from mock_devices.plc.plc_server import PlcServer
from mock_devices.settings import MockSettings, PlcReading
from pkm_rig.rig.clock import VirtualClock
from tests.mock_devices.standing import StandingPlant

MACHINE = Path(calibration.__file__).parent / "machine" / "data" / "planar4.toml"
TIMING = PlcTiming()  # host time, for connecting too: on a busy machine that may take half a second
ON_EVERY_LINE = ("modbus-exception", "modbus-short", "modbus-stuck-coil", "modbus-stale-heartbeat")

READINGS = (
    PlcReading("coolant", 40, part="base", offset_k=-1.5, type="i16", scale=0.1),
    PlcReading("oil", 42, part="air"),
)
COOLANT = ReadingRegister(40, low=5.0, high=50.0, type="i16", scale=0.1, unit="degC")
OIL = ReadingRegister(42, low=5.0, high=50.0, unit="degC")


class Bench:
    """A mock PLC, the line to it and a virtual clock."""

    def __init__(self, kind: str, folder: Path) -> None:
        self.clock = VirtualClock()
        self.faults = FaultPlan()
        plant = StandingPlant(
            Plant(MACHINE, MockSettings(operator_time_s=5.0, plc_readings=READINGS), self.clock)
        ).plant
        authority = trustme.CA()
        context: ssl.SSLContext | None = None
        if kind == "tls":
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            authority.issue_cert("127.0.0.1").configure_cert(context)
            authority.cert_pem.write_to_path(folder / "ca.pem")
        self.server = PlcServer(plant, transport=kind, tls=context, faults=self.faults)  # type: ignore[arg-type]
        host, port = self.server.address
        lines: dict[str, Callable[[], ModbusLine]] = {
            "tcp": lambda: TcpLine(host, port),
            "tls": lambda: TlsLine(host, folder / "ca.pem", port),
            "rtu": lambda: RtuLine(self.server.serial_port, parity="N"),
        }
        self.line = lines[kind]()
        self.plc = Plc(self.line, clock=self.clock, timing=TIMING)

    def close(self) -> None:
        self.plc.close()
        self.server.close()
        self.clock.close()


@pytest.fixture(params=["tcp", "tls", "rtu"])
def bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(request.param, tmp_path)
    with bench.clock.activity():
        yield bench
    bench.close()


def test_values_interlocks_and_both_heartbeats(bench: Bench) -> None:
    bench.plc.connect().require_safe()
    for _ in range(8):
        bench.clock.sleep_s(0.5)
        state = bench.plc.read()
        state.require_safe()
        assert state.master_seen
    assert set(state.temperatures_c) == {"air", "struts", "columns", "base", "platform"}
    assert 900.0 < state.pressure_hpa < 1100.0
    bench.server.set_interlock(0, False)
    with pytest.raises(InterlockOpen, match="guard closed"):
        bench.plc.read().require_safe()


def test_a_coolant_temperature_that_follows_the_machine(bench: Bench) -> None:
    bench.plc.connect()
    registers = RegisterMap(readings={"coolant": COOLANT, "oil": OIL})
    plc = Plc(bench.line, register_map=registers, clock=bench.clock, timing=TIMING)
    bench.plc.close()
    plc.connect().require_safe()
    first = plc.read().readings
    bench.clock.sleep_s(1800.0)
    then = plc.read()
    thermal, t_s = bench.server.state._plant.thermal, then.t_rig_s
    assert then.readings["coolant"] == pytest.approx(thermal.part_c("base", t_s) - 1.5, abs=0.051)
    assert then.readings["oil"] == pytest.approx(thermal.air_c(t_s), abs=1e-3)
    assert then.readings["coolant"] > first["coolant"] + 0.3
    plc.close()


def test_a_payload_by_the_sequence_word(bench: Bench) -> None:
    bench.plc.connect()
    assert bench.plc.request_payload(2).payload == 2
    with pytest.raises(PlcError, match="refused"):
        bench.plc.request_payload(9)


@pytest.mark.parametrize("name", ON_EVERY_LINE)
def test_faults_fail_closed_and_the_next_good_answer_is_right(bench: Bench, name: str) -> None:
    bench.plc.connect()
    bench.faults.arm([Fault(name, 1)])
    try:
        for _ in range(12):
            bench.clock.sleep_s(0.3)
            bench.plc.read().require_safe()
    except (PlcError, StaleData, NoAnswer, ConnectionFailed):
        assert name != "modbus-short"
    else:
        assert name == "modbus-short"
    assert bench.faults.struck == (name,)
    bench.faults.clear()
    bench.clock.sleep_s(0.3)
    bench.plc.read()
    bench.clock.sleep_s(0.3)
    bench.plc.read().require_safe()


@pytest.mark.parametrize("number", [1, 2, 3, 4])
@pytest.mark.parametrize("name", ["modbus-short", "modbus-reset", "modbus-transaction"])
def test_a_lost_answer_to_a_command_does_not_send_it_twice(
    bench: Bench, name: str, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name != "modbus-short" and isinstance(bench.line, RtuLine):
        pytest.skip("RTU has neither connections nor transaction ids")
    bench.plc.connect()
    sent: list[list[int]] = []
    send = ModbusBaseClient.write_registers

    def counted(self: ModbusBaseClient, address: int, values: list[int], **more: object) -> object:
        sent.append(values)
        return send(self, address, values, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(ModbusBaseClient, "write_registers", counted)
    bench.faults.arm([Fault(name, number)])
    assert bench.plc.request_payload(1).payload == 1
    assert len(sent) == 1


def test_a_certificate_of_somebody_else_is_refused(tmp_path: Path) -> None:
    bench = Bench("tls", tmp_path)
    assert isinstance(bench.line, TlsLine)
    trustme.CA().cert_pem.write_to_path(tmp_path / "ca.pem")
    said = "TLS: the PLC's certificate is refused: .*; check the certificate files"
    with bench.clock.activity(), pytest.raises(ConnectionFailed, match=said):
        Plc(bench.line, clock=bench.clock, timing=TIMING).connect()
    bench.close()


@contextmanager
def demanding_plc(context: ssl.SSLContext) -> Iterator[tuple[str, int]]:
    """Asks for a certificate and sends what OpenSSL sends to a client whose certificate it refuses; then hangs up."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            while True:
                try:
                    plain, _ = listening.accept()
                except OSError:
                    return
                with plain, suppress(OSError):
                    plain.settimeout(5.0)
                    context.wrap_socket(plain, server_side=True)

        thread = threading.Thread(target=serve)
        thread.start()
        yield listening.getsockname()
        listening.shutdown(socket.SHUT_RDWR)
        thread.join(10.0)


def silent_about_it(context: ssl.SSLContext, clock: VirtualClock) -> AbstractContextManager[tuple[str, int]]:
    """The mock PLC, which hangs up without a word."""
    plant = StandingPlant(Plant(MACHINE, MockSettings(operator_time_s=5.0), clock)).plant
    return served(PlcServer(plant, transport="tls", tls=context))


@contextmanager
def served(server: PlcServer) -> Iterator[tuple[str, int]]:
    try:
        yield server.address
    finally:
        server.close()


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
@pytest.mark.parametrize("ours", ["none", "foreign"])
@pytest.mark.parametrize("says_why", [True, False])
def test_a_plc_that_refuses_our_certificate_says_so(
    tmp_path: Path, ours: str, version: ssl.TLSVersion, says_why: bool
) -> None:
    authority = trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = context.maximum_version = version
    context.verify_mode = ssl.CERT_REQUIRED
    authority.configure_trust(context)
    authority.issue_cert("127.0.0.1").configure_cert(context)
    foreign = trustme.CA().issue_cert("rig.example")
    foreign.cert_chain_pems[0].write_to_path(tmp_path / "rig.pem")
    foreign.private_key_pem.write_to_path(tmp_path / "rig.key")
    files = () if ours == "none" else (tmp_path / "rig.pem", tmp_path / "rig.key")
    said = "the PLC refuses our certificate: .*alert" if says_why else "the PLC hangs up .* may refuse our certificate"
    clock = VirtualClock()
    plc = demanding_plc(context) if says_why else silent_about_it(context, clock)
    with plc as (host, port), clock.activity():
        driver = Plc(TlsLine(host, tmp_path / "ca.pem", port, *files), clock=clock, timing=PlcTiming(0.3))
        with pytest.raises(ConnectionFailed, match=f"TLS: {said}.*; check the certificate files"):
            driver.connect()
    clock.close()
