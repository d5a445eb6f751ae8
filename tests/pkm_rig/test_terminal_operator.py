"""Ctrl-C, Enter and hang-up at a real terminal, in a process of its own."""

from __future__ import annotations

import os
import pty
import select
import shlex
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest

from pkm_rig.cli.terminal_operator import TerminalOperator

LIMIT_S = 120.0  # a busy computer is no fault


def test_ctrl_c_asks_once_and_enter_acknowledges_only_while_it_waits():
    keyboard, screen = pty.openpty()
    operator = TerminalOperator(screen)
    os.write(keyboard, b"\n")
    assert operator.ask()
    assert operator.asks_to_pause()
    assert not operator.ask()
    operator.begin_wait()
    assert not operator.asks_to_pause()
    assert not operator.ask()
    assert not operator.acknowledges()  # Enter was pressed before it waited
    os.write(keyboard, b"\n")
    assert operator.acknowledges()
    operator.end_wait()
    assert operator.ask()
    os.close(keyboard)
    os.close(screen)


class AtTerminal:
    """`pkm-rig demo` at a pseudo-terminal."""

    def __init__(self, out: Path, before: str = "") -> None:
        self.master, slave = pty.openpty()
        command = shlex.join([sys.executable, "-m", "pkm_rig.cli", "demo", "--out", str(out)])
        self.process = subprocess.Popen(
            ["sh", "-c", f"{before}exec {command}"], stdin=slave, stdout=slave, stderr=slave, start_new_session=True
        )
        os.close(slave)
        self.text = ""

    def wait_for(self, words: str) -> None:
        end = time.monotonic() + LIMIT_S
        while words not in self.text:
            assert time.monotonic() < end, f"no '{words}' in: {self.text[-2000:]}"
            if select.select([self.master], [], [], 0.2)[0]:
                try:
                    self.text += os.read(self.master, 65536).decode(errors="replace")
                except OSError:
                    break
        assert words in self.text, self.text[-2000:]
        self.text = self.text.split(words, 1)[1]

    def end(self) -> int:
        end = time.monotonic() + LIMIT_S
        while self.process.poll() is None:
            assert time.monotonic() < end
            if select.select([self.master], [], [], 0.1)[0]:
                try:
                    self.text += os.read(self.master, 65536).decode(errors="replace")
                except OSError:
                    time.sleep(0.05)
        return self.process.returncode


@pytest.fixture
def at_terminal(tmp_path):
    terminal = AtTerminal(tmp_path / "out")
    yield terminal
    terminal.process.kill()
    terminal.process.wait()


def test_ctrl_c_pauses_enter_goes_on_and_a_second_ctrl_c_stops(at_terminal):
    at_terminal.wait_for("readings planned")
    at_terminal.process.send_signal(signal.SIGINT)
    at_terminal.wait_for("the drives are without power: press Enter")
    os.write(at_terminal.master, b"\n")
    at_terminal.wait_for("going on")
    assert not termios.tcgetattr(at_terminal.master)[3] & termios.ECHO  # Enter would tear what is drawn in place
    at_terminal.process.send_signal(signal.SIGINT)
    at_terminal.wait_for("the drives are without power: press Enter")
    at_terminal.process.send_signal(signal.SIGINT)
    at_terminal.wait_for("go on with: pkm-rig demo")
    assert at_terminal.end() == 3
    assert termios.tcgetattr(at_terminal.master)[3] & termios.ECHO


def test_a_terminal_that_is_gone_stops_the_campaign(at_terminal, tmp_path):
    at_terminal.wait_for("readings planned")
    at_terminal.process.send_signal(signal.SIGHUP)
    os.close(at_terminal.master)
    at_terminal.process.wait(LIMIT_S)
    assert at_terminal.process.returncode == 3
    shown = listed(tmp_path / "out")
    assert "interrupted" in shown or "failed measuring" in shown  # a write may fail before the signal is handled


def test_a_terminal_that_is_gone_without_a_signal_stops_the_campaign(tmp_path):
    terminal = AtTerminal(tmp_path / "out", "trap '' HUP; ")
    terminal.wait_for("readings planned")
    os.close(terminal.master)
    assert terminal.process.wait(LIMIT_S) == 3
    shown = listed(tmp_path / "out")
    assert "failed measuring" in shown
    assert int(shown.split("  ")[3]) < 100  # of 333: not only when there is something to say, which is at their end


def listed(out: Path) -> str:
    command = [sys.executable, "-m", "pkm_rig.cli", "list", "--out", str(out)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout
