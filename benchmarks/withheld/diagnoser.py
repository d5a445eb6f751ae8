"""Diagnoses a folder of recordings in a process that knows nothing else.

    python -m benchmarks.withheld.diagnoser RECORDINGS ANSWERS [--diagnose MODULE:FUNCTION]

RECORDINGS holds recording folders and options.json (by folder: names of effects, and of forms of others, that the
catalogue shall not have). Writes
ANSWERS/answers.json and one npz a recording, named with its hash in answers.json. Exit status 1 if the mock plant was
asked for (`sealing`); nothing is written then.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import io
import json
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.withheld.sealing import SealBroken, check, seal

REAL = "benchmarks.withheld.diagnoser:real"


def main(arguments: list[str] | None = None) -> int:
    """Diagnose every recording."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--diagnose", default=REAL, help=argparse.SUPPRESS)
    parser.add_argument("--no-baselines", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    try:
        seal()
        answers = answer_all(
            options.recordings, options.answers, loaded(options.diagnose), baselines=not options.no_baselines
        )
        check()
    except SealBroken as error:
        print(f"diagnoser: {error}", file=sys.stderr)
        return 1
    text = json.dumps(answers, indent=1, sort_keys=True)
    (options.answers / "answers.json").write_text(text + "\n", encoding="utf-8")
    return 0


def loaded(name: str) -> Callable[..., Any]:
    """The function of MODULE:FUNCTION; it takes a recording, then effects and forms that are left out."""
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(module), function)


def real(recording: Any, without: tuple[str, ...], without_forms: tuple[str, ...] = ()) -> Any:
    """The diagnosis that users have."""
    from calibration.diagnosis.diagnose import diagnose  # noqa: PLC0415
    from calibration.effects.catalogue import load_catalogue  # noqa: PLC0415 - sealed first

    return diagnose(recording, load_catalogue().without_forms(without_forms).without(without))


def answer_all(
    recordings: Path, answers: Path, diagnose: Callable[..., Any], *, baselines: bool = True
) -> dict[str, Any]:
    """Answers by folder; a diagnosis that fails is an answer too, a wrong one."""
    answers.mkdir(parents=True, exist_ok=True)
    table = json.loads((recordings / "options.json").read_text(encoding="utf-8"))
    return {name: _answer(recordings / name, answers, diagnose, entry, baselines) for name, entry in table.items()}


def _answer(
    folder: Path, answers: Path, diagnose: Callable[..., Any], entry: dict[str, Any], baselines: bool
) -> dict[str, Any]:
    import numpy as np  # noqa: PLC0415 - sealed first

    from benchmarks.withheld.answers import to_data  # noqa: PLC0415
    from benchmarks.withheld.baselines import simple_answers  # noqa: PLC0415
    from calibration.recording.folder import read_folder  # noqa: PLC0415

    recording = read_folder(folder)
    without = tuple(entry["without"])
    without_forms = tuple(entry["without_forms"])
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
        (answers / f"{folder.name}.npz").write_bytes(data)
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


if __name__ == "__main__":
    sys.exit(main())
