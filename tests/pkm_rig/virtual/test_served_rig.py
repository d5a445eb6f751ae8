"""`pkm-rig mock` as processes of their own: two on one computer, killed and started again, told by lines."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest

from calibration.base.errors import InputError
from drivers.errors import DeviceError
from mock_devices.commands import USAGE
from pkm_rig.rig.clock import ScaledClock
from pkm_rig.rig.config import load_rig, mock_rig_path
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.operator_devices import PayloadDevice
from pkm_rig.rig.worker import Worker
from pkm_rig.virtual.new_rig import with_values, write_new_rig
from pkm_rig.virtual.ownership import owned, require_free_port
from pkm_rig.virtual.served_rig import serve_mock_rig, tell
from tests.faults.short_campaign import flat_table


class Mock:
    """A mock in a process of its own."""

    def __init__(self, stack, *options):
        command = [sys.executable, "-m", "pkm_rig.cli", "mock", *map(str, options)]
        self.process = stack.enter_context(
            subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            )
        )
        stack.callback(self.process.kill)
        self.said = []
        while not self.said or not self.said[-1].startswith("connect:"):
            line = self.process.stdout.readline()
            assert line, f"the mock ended: {self.said}"
            self.said.append(line.strip())

    def tell(self, line):
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(10.0)


@contextmanager
def connected(path):
    file, machine = load_rig(path)
    clock = ScaledClock(file.time_scale)
    try:
        with connect_rig(file, machine, clock, rig_path=path) as rig:
            yield rig
    finally:
        clock.close()


def exchange_payload(rig, number):
    """What a campaign keeps of the exchange."""
    noted, worker = [], Worker()
    device = PayloadDevice(rig, worker, lambda _line: None, lambda *event: noted.append(event), lambda *_: None)
    assert device.set(number).exception(timeout=60.0) is None
    worker.close()
    return noted


def test_two_mocks_run_side_by_side_and_one_that_was_killed_comes_back_as_hardware_does(tmp_path):
    with ExitStack() as stack:
        first_path, second_path = tmp_path / "first.toml", tmp_path / "second.toml"
        first = Mock(stack, "--new-rig", first_path, "--state", tmp_path / "first.state")
        write_new_rig(first_path, second_path, anywhere=False)
        second = stack.enter_context(serve_mock_rig(load_rig(second_path)[0], second_path))
        assert first.said[-1] == f"connect: --rig {first_path}"
        with connected(first_path) as rig:
            rig.enable()
            rig.move(np.array([1.15, 1.10]), 0.5)
            generation = rig.next_generation()
            rig.switch_compensation(rig.images(flat_table(), generation))
            before = rig.positions_m()
            exchanged = exchange_payload(rig, 1)
        kinds, (_, on) = zip(*exchanged, strict=True)
        assert kinds == ("payload_asked", "payload_on")
        assert on["payload"] == 1
        assert on["acknowledged_by"] == f"PLC (127.0.0.1:{load_rig(first_path)[0].plc.port} unit 1)"
        status = json.loads(first.tell("status"))
        assert [drive["generation"] for drive in status["drives"].values()] == [generation] * 2
        assert [drive["generation"] for drive in json.loads(tell(second, "status"))["drives"].values()] == [0, 0]
        assert first.tell("jump") == f"not done: unknown: 'jump'; there is {'; '.join(USAGE.values())}"
        first.kill()
        again = Mock(stack, "--rig", first_path, "--state", tmp_path / "first.state")
        later = json.loads(again.tell("status"))
        assert later["t_rig_s"] > status["t_rig_s"]
        assert [d["compensation"] for d in later["drives"].values()] == [0, 0]
        with connected(first_path) as rig:
            assert [bank.state().next_generation for bank in rig.banks] == [generation + 1] * 2
            np.testing.assert_allclose(rig.positions_m(), before, atol=25e-6)  # the table was still in use before
            assert again.tell("silent plc") == "plc is silent"
            with pytest.raises(DeviceError):
                rig.wait(4000.0)
            assert again.tell("silent none") == "all answer"
        with connected(second_path) as rig:
            assert rig.positions_m() == pytest.approx([1.118033988749895] * 2, abs=1e-7)


def test_a_taken_port_is_named_with_its_owner(tmp_path):
    path = tmp_path / "rig.toml"
    write_new_rig(mock_rig_path(), path, anywhere=True)
    file, _ = load_rig(path)
    with socket.create_server(("127.0.0.1", file.plc.port)), pytest.raises(InputError) as caught:
        require_free_port("plc.port", file.plc.port)
    message = str(caught.value)
    assert message.startswith(f"plc.port {file.plc.port}: ")
    assert f"by process {os.getpid()} (" in message
    assert "--new-rig" in message
    require_free_port("plc.port", file.plc.port)


def test_what_one_process_has_no_other_one_takes(tmp_path):
    path = tmp_path / "state"
    script = "import sys; from pathlib import Path; from pkm_rig.virtual.ownership import owned\n"
    script += "with owned(Path(sys.argv[1]), 'thing'): print('mine', flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", script, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "mine\n"
        with pytest.raises(InputError, match=f"thing .* in use by .*process {other.pid} "), owned(path, "thing"):
            pass
        other.kill()
        other.wait()
    with owned(path, "thing"):
        pass


def test_a_new_rig_file_differs_in_its_ports_only_and_is_written_once(tmp_path):
    path = tmp_path / "rig.toml"
    write_new_rig(mock_rig_path(), path, anywhere=True)
    old, new = load_rig(mock_rig_path())[0], load_rig(path)[0]
    assert (new.can.port, new.plc.port) != (old.can.port, old.plc.port)
    assert new.station.port == str(tmp_path / "rig.station")
    same = {"station": old.station, "can": old.can, "plc": old.plc}
    assert new.model_copy(update=same) == old
    with pytest.raises(InputError, match="exists; serve it with"):
        write_new_rig(mock_rig_path(), path, anywhere=True)
    with pytest.raises(InputError, match="put it beside"):
        write_new_rig(path, tmp_path / "elsewhere" / "rig.toml", anywhere=False)


def test_values_are_set_where_they_stand_or_at_the_head_of_their_section():
    text = "port = 1\n[can]\nport = 2 # two\n[[drives]]\nport = 3\n[plc]\n"
    assert with_values(text, {("can", "port"): "20", ("plc", "port"): "40"}) == (
        "port = 1\n[can]\nport = 20\n[[drives]]\nport = 3\n[plc]\nport = 40\n"
    )
