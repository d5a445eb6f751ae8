"""Diagnoses recordings that it is given one after the other, in a process that knows nothing else.

    python -m ... diagnoser --way namespaces --folder /recording [--diagnose MODULE:FUNCTION] [--no-baselines]

Started by `sealed_diagnoser`, from a wheel and shut in by `jail`. One JSON object a line on standard input, one answer
a line on standard output. A recording: `name` (a random one), `files` (texts by name), `without` and `without_forms`
(effects and forms that the catalogue shall not have); the answer is what the diagnosis says, with its predictions. A
proof: `probe` (paths), `modules`; the answer names those that could be opened or imported. Each is done by a child that
ends with it, so nothing of a recording is left for the next. `broken` in place of an answer: the plant or a truth was
asked for (`sealing`).
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import importlib
import io
import json
import os
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import jail
from .sealing import SealBroken, check, seal

REAL = "diagnoser:real"


def main(arguments: list[str] | None = None) -> int:
    """Serve until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--way", required=True)
    parser.add_argument("--folder", required=True)
    parser.add_argument("--diagnose", default=REAL)
    parser.add_argument("--no-baselines", action="store_true")
    options = parser.parse_args(arguments)
    # What a diagnosis prints is no answer.
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    diagnose = loaded(options.diagnose)
    _imported_once()
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            _answer_and_end(json.loads(line), out, diagnose, options)
        status = os.waitpid(child, 0)[1]
        _empty(Path(options.folder))
        if status:
            return 1
    return 0


def loaded(name: str) -> Callable[..., Any]:
    """The function of MODULE:FUNCTION beside this module; it takes a recording, then effects and forms left out."""
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(f".{module}", __package__), function)


def real(recording: Any, without: tuple[str, ...], without_forms: tuple[str, ...] = ()) -> Any:
    """The diagnosis that users have. Names that it has never heard of need not be left out."""
    from calibration.diagnosis.diagnose import diagnose  # noqa: PLC0415
    from calibration.effects.catalogue import load_catalogue  # noqa: PLC0415 - sealed first

    catalogue = load_catalogue()
    known = tuple(name for name in without if name in catalogue.names)
    return diagnose(recording, catalogue.without_forms(without_forms).without(known))


def opened(paths: list[str], modules: list[str]) -> list[str]:
    """Those of some files, folders and modules that can be opened or imported from here: the planted reader."""
    out = []
    for path in paths:
        try:
            if Path(path).is_dir():
                os.listdir(path)
            else:
                os.close(os.open(path, os.O_RDONLY))
            out.append(path)
        except OSError:
            continue
    for module in modules:
        try:
            importlib.import_module(module)
            out.append(module)
        except ImportError:
            continue
    return out


def _imported_once() -> None:
    """What every child needs, loaded before them."""
    from calibration.diagnosis import diagnose  # noqa: F401, PLC0415 - sealed first
    from calibration.recording import folder  # noqa: F401, PLC0415

    from . import answers, baselines  # noqa: F401, PLC0415


def _answer_and_end(order: dict[str, Any], out: Any, diagnose: Callable[..., Any], options: argparse.Namespace) -> None:
    """In the child: one answer, and its end."""
    status = 1
    try:
        if "probe" in order:
            answer: dict[str, Any] = {"opened": opened(order["probe"], order["modules"])}
        else:
            seal()
            with jail.receive(options.way, options.folder, order["name"], order["files"]) as folder:
                answer = _answer(folder, diagnose, order, not options.no_baselines)
            check()
        status = 0
    except SealBroken as error:
        answer, status = {"broken": str(error)}, 0
    except BaseException:
        traceback.print_exc(file=sys.stderr)
    if status == 0:
        out.write(json.dumps(answer) + "\n")
        out.flush()
    os._exit(status)


def _answer(folder: Path, diagnose: Callable[..., Any], order: dict[str, Any], baselines: bool) -> dict[str, Any]:
    """What a diagnosis says; one that fails is an answer too, a wrong one."""
    import numpy as np  # noqa: PLC0415 - sealed first

    from calibration.recording.folder import read_folder  # noqa: PLC0415

    from .answers import to_data  # noqa: PLC0415
    from .baselines import simple_answers  # noqa: PLC0415

    recording = read_folder(folder)
    without, without_forms = tuple(order["without"]), tuple(order["without_forms"])
    out: dict[str, Any] = {"without": list(without), "without_forms": list(without_forms)}
    started, on_core = time.perf_counter(), time.process_time()
    try:
        diagnosis = diagnose(recording, without, without_forms)
        out |= _lasted(started, on_core)
        out["diagnosis"] = to_data(diagnosis)
        with io.BytesIO() as stream:
            withheld = diagnosis.withheld
            np.savez(stream, rows=withheld.rows, before_m=withheld.before_m, after_m=withheld.after_m)
            data = stream.getvalue()
        out["predictions"] = base64.b64encode(data).decode()
        out["withheld_sha256"] = hashlib.sha256(data).hexdigest()
    except SealBroken:
        raise
    except Exception as error:  # any failure of what is checked must not end the run
        out |= _lasted(started, on_core)
        out["error"] = f"{type(error).__name__}: {error}"
        traceback.print_exc(file=sys.stderr)
    if baselines:
        out["baselines"] = simple_answers(recording, without)
    return out


def _lasted(started: float, on_core: float) -> dict[str, float]:
    """Time on its one core, which others at work on the computer do not lengthen, and by the clock."""
    return {"seconds": time.process_time() - on_core, "clock_seconds": time.perf_counter() - started}


def _empty(folder: Path) -> None:
    """Where the child's files are real, they go with it."""
    for home in folder.iterdir():
        for file in home.iterdir():
            file.unlink()
        home.rmdir()


if __name__ == "__main__":
    sys.exit(main())
