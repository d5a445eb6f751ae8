"""Runs the diagnoser where it can see Python, a wheel and one recording, and proves that it can see nothing else.

The wheel holds `calibration` and the diagnoser with its helpers, neither `mock_devices` nor `benchmarks`. The process
has a mount namespace of its own (as root, or in a user namespace) in which nothing but Python, its installed packages,
the wheel and an empty folder is mounted; where the system forbids that, Landlock restricts what it may open. Before a
recording is given to it, a planted reader in its place must fail to open the checkout, the plant and planted truths.
Recordings come one at a time under random names, as texts; a child of the process that is gone before the next comes
sees them in a folder that cannot be written to.
"""

from __future__ import annotations

import base64
import compileall
import hashlib
import json
import os
import secrets
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from py_compile import PycInvalidationMode
from typing import IO, Any

from benchmarks.withheld.jail import LANDLOCK, NAMESPACES, UNSEALED
from benchmarks.withheld.line_process import exchange

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent
WHEELS = ROOT / "runs" / "sealed"
PACKAGE = "withheld_diagnoser"
HELPERS = ("answers", "baselines", "diagnoser", "jail", "sealing")
WAYS = (NAMESPACES, LANDLOCK)
ONE_CORE = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
FILES = ("recording.toml", "machine.toml", "readings.csv")
SYSTEM = ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/etc/ld.so.cache", "/dev/null", "/dev/urandom")  # Python's own
START = (
    f"import sys; sys.path += sys.argv[1:3]; del sys.argv[1:3]; from {PACKAGE}.diagnoser import main; sys.exit(main())"
)
PROJECT = """
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"
[project]
name = "withheld-diagnoser"
version = "0"
[tool.setuptools.packages.find]
include = ["calibration*", "withheld_diagnoser"]
[tool.setuptools.package-data]
calibration = ["py.typed", "machine/data/*.toml"]
"""


class NotSealed(RuntimeError):
    """The diagnoser cannot be shut in, or sees what it must not; one line."""


class SealedDiagnoser:
    """A process that diagnoses. way: how it is shut in; '' takes the first that the system allows.

    show: further paths that it sees. Raises NotSealed; `diagnose` also where a diagnosis asked for the plant.
    """

    def __init__(
        self, log: IO[str], function: str = "", *, way: str = "", show: Sequence[Path] = (), baselines: bool = True
    ) -> None:
        self._log, self._show = log, tuple(show)
        self._arguments = [*(["--diagnose", function] if function else []), *([] if baselines else ["--no-baselines"])]
        self._wheel = unpacked_wheel(function)
        self.way = ""
        for each in [way] if way else WAYS:
            try:
                self._start(each)
                return
            except NotSealed as error:
                print(f"{each}: {error}", file=log, flush=True)
                self.close()
                if isinstance(error, Leak):
                    raise
        raise NotSealed(
            f"the diagnoser cannot be shut in here: neither {' nor '.join([way] if way else WAYS)} (see the log); "
            "use a Linux that allows user namespaces or Landlock, or --unsealed for development"
        )

    def __enter__(self) -> SealedDiagnoser:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(BrokenPipeError):  # it may have ended before
            self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()
        shutil.rmtree(self._scratch, ignore_errors=True)

    def diagnose(self, folder: Path, without: Sequence[str] = (), without_forms: Sequence[str] = ()) -> dict[str, Any]:
        """The answer to a recording folder; `predictions` are the bytes of an npz file in base 64."""
        files = {name: (folder / name).read_text(encoding="utf-8") for name in FILES}
        answer = self._ask(
            name=secrets.token_hex(8), files=files, without=list(without), without_forms=list(without_forms)
        )
        if "broken" in answer:
            raise NotSealed(str(answer["broken"]))
        return answer

    def _start(self, way: str) -> None:
        self._scratch = Path(tempfile.mkdtemp(prefix="sealed-"))
        inside = way == NAMESPACES
        folder = "/recording" if inside else str(self._scratch)
        packages = Path(sysconfig.get_path("purelib"))
        wheel, site = ("/wheel", "/packages") if inside else (str(self._wheel), str(packages))
        python = os.path.realpath(sys.executable)
        show = [(str(self._wheel), wheel), (str(packages), site), (sys.base_prefix, sys.base_prefix)]
        show += [(path, path) for path in (*SYSTEM, *map(str, self._show)) if Path(path).exists()]
        if not Path(python).is_relative_to(sys.base_prefix):
            show.append((python, python))
        program = [python, "-I", "-S", "-B", "-c", START, wheel, site, "--way", way, "--folder", folder]
        config = {
            "way": way, "show": show, "folder": folder, "root": str(self._scratch),
            "program": [*program, *self._arguments], "environment": dict.fromkeys(ONE_CORE, "1") | {"LANG": "C.UTF-8"},
        }  # fmt: skip
        self._process = subprocess.Popen(
            [python, "-I", "-S", str(HERE / "jail.py"), json.dumps(config)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, text=True, cwd="/",
        )  # fmt: skip
        self.way = way
        self._prove()

    def _prove(self) -> None:
        """A planted reader in the diagnosis's place opens nothing that it must not."""
        with tempfile.TemporaryDirectory(dir=WHEELS) as planted:
            truth = Path(planted) / "truth.json"
            truth.write_text("{}", encoding="utf-8")
            paths = [*secret_paths(), truth]
            through = [f"/proc/{of}/root{path}" for path in paths for of in ("1", "self", str(os.getpid()))]
            missing = [str(path) for path in paths if not path.exists()]
            assert not missing, missing
            probe = [*map(str, paths), *through]
            answer = self._ask(probe=probe, modules=["mock_devices", "mock_devices.effects", "benchmarks", "pkm_rig"])
        if self.way != UNSEALED and answer["opened"]:
            raise Leak(f"the diagnoser can open {answer['opened'][0]}; nothing is scored")

    def _ask(self, **order: Any) -> dict[str, Any]:
        answer = exchange(self._process, order)
        if answer is None:
            raise NotSealed("the diagnoser ended; see its log")
        return answer


class Leak(NotSealed):
    """The planted reader has opened what it must not."""


def secret_paths() -> list[Path]:
    """What must not be seen: checkout, plant, makers and scorers, runs, the other simulator's data."""
    plant = [ROOT, ROOT / "mock_devices", ROOT / "mock_devices" / "effects" / "catalogue.py"]
    checks = [HERE / "maker.py", HERE / "scorer.py", HERE / "log.jsonl", ROOT / "runs"]
    data = ROOT.parent / "shared" / "independent"
    return [*plant, *checks, *([data, *data.glob("*.tar.xz")] if data.exists() else [])]


def answer_folder(
    recordings: Path, answers: Path, log: IO[str], function: str = "", *, sealed: bool = True, baselines: bool = True
) -> None:
    """Diagnose every recording of a folder as its options.json says, into answers.json and one npz a recording."""
    table = json.loads((recordings / "options.json").read_text(encoding="utf-8"))
    out: dict[str, Any] = {}
    answers.mkdir(parents=True, exist_ok=True)
    with SealedDiagnoser(log, function, way="" if sealed else UNSEALED, baselines=baselines) as diagnoser:
        for name, entry in table.items():
            answer = diagnoser.diagnose(recordings / name, entry["without"], entry["without_forms"])
            if predictions := answer.pop("predictions", ""):
                (answers / f"{name}.npz").write_bytes(base64.b64decode(predictions))
            out[name] = answer
    text = json.dumps(out, indent=1, sort_keys=True)
    (answers / "answers.json").write_text(text + "\n", encoding="utf-8")


def unpacked_wheel(function: str = "") -> Path:
    """The folder of the unpacked wheel of the code as it is, built if it is not there yet."""
    module = function.partition(":")[0]
    helpers = sorted({*HELPERS, *([module] if module else [])})
    calibration = [
        file for pattern in ("*.py", "*.toml", "py.typed") for file in sorted((ROOT / "calibration").rglob(pattern))
    ]
    digest = hashlib.sha256(PROJECT.encode())
    for file in (*calibration, *(HERE / f"{name}.py" for name in helpers)):
        digest.update(f"{file.relative_to(ROOT)}\0".encode() + file.read_bytes() + b"\0")
    home = WHEELS / digest.hexdigest()[:16]
    if not home.exists():
        WHEELS.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=WHEELS) as folder:
            _build(Path(folder), calibration, helpers)
            try:
                (Path(folder) / "unpacked").rename(home)
            except OSError:  # another process was quicker
                if not home.exists():
                    raise
    return home


def _build(folder: Path, calibration: Sequence[Path], helpers: Sequence[str]) -> None:
    source = folder / "source"
    for file in calibration:
        target = source / file.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
    (source / PACKAGE).mkdir()
    (source / PACKAGE / "__init__.py").write_text('"""The diagnoser of the check on withheld data."""\n')
    for name in helpers:
        shutil.copyfile(HERE / f"{name}.py", source / PACKAGE / f"{name}.py")
    (source / "pyproject.toml").write_text(PROJECT, encoding="utf-8")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    built = subprocess.run(
        [*command, "--disable-pip-version-check", "--wheel-dir", str(folder), str(source)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if built.returncode:
        raise NotSealed(f"pip cannot build the diagnoser's wheel: {built.stderr.strip().splitlines()[-1]}")
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "unpacked")
    compileall.compile_dir(folder / "unpacked", quiet=2, invalidation_mode=PycInvalidationMode.UNCHECKED_HASH)
