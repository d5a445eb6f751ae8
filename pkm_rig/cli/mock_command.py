"""The command that serves the mock devices to other processes."""

from __future__ import annotations

import gc
import os
import secrets
import signal
import sys
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.base.errors import InputError
from pkm_rig.cli.options import OutOption, campaigns

if TYPE_CHECKING:
    from collections.abc import Callable

TOKEN = "PKM_RIG_CONTROL_TOKEN"  # environment variable with the token of the control port
MOST_PORT = 65535


def mock(
    rig: Annotated[Path | None, typer.Option("--rig", help="rig file; without it the shipped mock rig")] = None,
    new_rig: Annotated[
        Path | None, typer.Option("--new-rig", help="write the rig file anew, on free ports, and serve that")
    ] = None,
    state: Annotated[
        Path | None, typer.Option("--state", help="file that the mock goes on from, as hardware does, and keeps")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="which mock machine")] = None,
    fault: Annotated[
        list[str] | None, typer.Option(help="NAME@N: a fault at the Nth operation, again for more")
    ] = None,
    list_faults: Annotated[bool, typer.Option(help="print the names of the faults and end")] = False,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=VALUE[,place=...,variant=...]: a flaw (docs/reference/mock-effects.md); may be repeated"
        ),
    ] = None,
    twin: Annotated[
        str | None,
        typer.Option(
            help="serve this twin: campaign of `pkm-rig diagnose --add`, or the twin's folder", autocompletion=campaigns
        ),
    ] = None,
    effects: Annotated[list[Path] | None, typer.Option(help="Python file with own effects that the twin has")] = None,
    control: Annotated[
        int | None, typer.Option(help="port on which programs of this computer change the running mock; 0: a free one")
    ] = None,
    program: Annotated[
        Path | None, typer.Option(help="NC program by which a control of the mock leads the machine, past our drives")
    ] = None,
    correction: Annotated[
        list[str] | None,
        typer.Option(
            help="PAYLOAD=FOLDER: that control's own correction, of `compensate --format csv`; again for more"
        ),
    ] = None,
    operator: Annotated[
        float | None, typer.Option(help="rig seconds after which somebody presses start at M0; else `program start`")
    ] = None,
    out: OutOption = Path("runs"),
) -> None:
    """Serve the three mock devices on real transports until interrupted; lines on stdin change the running rig."""
    from pkm_rig.report.terminal import results
    from pkm_rig.rig.config import load_rig, mock_rig_path
    from pkm_rig.virtual import mock_rig
    from pkm_rig.virtual.new_rig import write_new_rig
    from pkm_rig.virtual.served_rig import control_port, how_to_connect, load_program, serve_mock_rig, tell, what_it_is
    from pkm_rig.virtual.twin_files import find_twin

    if list_faults:
        for line in mock_rig.fault_list():
            results.print(line, soft_wrap=True, markup=False)
        return
    path = rig or mock_rig_path()
    if new_rig is not None:
        write_new_rig(path, new_rig, anywhere=rig is None)
        path = new_rig
    file = mock_rig.with_mock_options(load_rig(path)[0], seed, effect or ())
    twin_files = None if twin is None else mock_rig.TwinFiles(find_twin(twin, out), tuple(effects or ()))
    if control is not None and not 0 <= control <= MOST_PORT:
        raise InputError(f"--control {control}: no port; choose 0 to {MOST_PORT}")
    if program is None and (correction or operator is not None):
        raise InputError("mock: --correction and --operator are for --program; give it")
    with ExitStack() as stack:
        devices = stack.enter_context(serve_mock_rig(file, path, fault or (), twin_files, state))
        if program is not None:
            load_program(devices, program, correction or (), operator)
        lines = [*what_it_is(file, devices, twin_files), *how_to_connect(file, path, devices)]
        if control is not None:
            token = os.environ.get(TOKEN) or secrets.token_hex(16)
            served = stack.enter_context(control_port(devices, control, token))
            shown = f"that of {TOKEN}" if os.environ.get(TOKEN) else token
            lines.insert(-1, f"control: 127.0.0.1:{served.port}, token {shown}")
        stopped = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stopped.set())
        for line in lines:
            results.print(line, soft_wrap=True, markup=False)
        sys.stdout.flush()
        gc.freeze()  # a collection of all that was loaded takes some 80 ms, in which no drive would answer
        _listen(lambda line: tell(devices, line))
        stopped.wait()


def _listen(tell: Callable[[str], str]) -> None:
    """Carry out the lines that come on stdin, for as long as there is one."""
    if hasattr(signal, "SIGTTIN"):
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)  # in the background a terminal has no lines for us

    def read() -> None:
        try:
            for line in sys.stdin:
                if line.strip():
                    _answer(tell, line)
        except (OSError, ValueError):
            return

    threading.Thread(target=read, name="mock-lines", daemon=True).start()


def _answer(tell: Callable[[str], str], line: str) -> None:
    try:
        print(tell(line), flush=True)
    except InputError as error:
        print(f"not done: {error}", flush=True)
