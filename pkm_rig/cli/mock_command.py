"""The command that serves the mock devices to other processes."""

from __future__ import annotations

import signal
import sys
import threading
from pathlib import Path
from typing import Annotated

import typer

from pkm_rig.cli.options import OutOption


def mock(
    rig: Annotated[Path | None, typer.Option("--rig", help="rig file; without it the shipped mock rig")] = None,
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
        str | None, typer.Option(help="serve this twin: campaign of `pkm-rig diagnose --add`, or the twin's folder")
    ] = None,
    effects: Annotated[list[Path] | None, typer.Option(help="Python file with own effects that the twin has")] = None,
    out: OutOption = Path("runs"),
) -> None:
    """Serve the three mock devices on real transports until interrupted."""
    from pkm_rig.report.terminal import results
    from pkm_rig.rig.config import load_rig, mock_rig_path
    from pkm_rig.virtual import mock_rig
    from pkm_rig.virtual.twin_files import find_twin

    if list_faults:
        for line in mock_rig.fault_list():
            results.print(line, soft_wrap=True, markup=False)
        return
    path = rig or mock_rig_path()
    file = mock_rig.with_mock_options(load_rig(path)[0], seed, effect or ())
    twin_files = None if twin is None else mock_rig.TwinFiles(find_twin(twin, out), tuple(effects or ()))
    with mock_rig.serve_mock_rig(file, path, fault or (), twin_files) as devices:
        stopped = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stopped.set())
        for line in mock_rig.how_to_connect(file, devices):
            results.print(line, soft_wrap=True)
        sys.stdout.flush()
        stopped.wait()
