"""One command on all campaigns of a store. A result is kept as soon as it is there, so that what broke off goes on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from calibration.base.errors import InputError
from calibration.recording.recording import Recording
from pkm_rig.errors import StoreError
from pkm_rig.jobs.identify import check_options, identify_with_checks
from pkm_rig.jobs.worker_pool import Attempt, Pool, Task
from pkm_rig.results.done import Done
from pkm_rig.store.place import campaign_folder
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import CampaignSummary
from pkm_rig.version import __version__

PLACE = "{campaign folder}"  # in the paths of a result that was computed elsewhere


@dataclass(frozen=True)
class Product:
    """What a worker sends back: a result for programs, and the files that belong into the campaign's folder."""

    result: dict[str, Any]
    files: dict[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Work:
    """A command with its options, which say when a kept result is still the one that would be computed."""

    command: str
    function: Callable[..., Product]
    options: tuple[Any, ...]

    @property
    def file(self) -> str:
        """Where a campaign's folder keeps its result."""
        return f"{self.command}-all.json"

    def key(self, head: str) -> str:
        """All that a result depends on."""
        content = json.dumps([__version__, self.command, self.options, head])
        return hashlib.sha256(content.encode()).hexdigest()


@dataclass(frozen=True)
class Chosen:
    """The campaigns of a store that can be worked on, and why the others cannot."""

    campaigns: tuple[CampaignSummary, ...]
    skipped: dict[str, str]
    damaged: tuple[Done, ...]


def identify_work(estimator: str, *, robust: bool, draws: int) -> Work:
    """Identification of each; InputError for options without sense."""
    return Work("identify", _identify, (check_options(estimator, draws), robust, draws))


def diagnose_work(effects: Sequence[Path], *, add: bool, thorough: bool = False) -> Work:
    """Diagnosis of each; files with effects are sent along. InputError if one cannot be read."""
    try:
        texts = [(path.name, path.read_text(encoding="utf-8")) for path in effects]
    except (OSError, UnicodeError) as error:
        raise InputError(f"effects: {error}; check the path") from error
    if len({name for name, _ in texts}) < len(texts):
        raise InputError("effects: two files have the same name; rename one")
    return Work("diagnose", _diagnose, (texts, add, thorough))


def choose(store: Store) -> Chosen:
    """All campaigns with readings that nobody works on."""
    able, skipped, damaged = [], {}, []
    for row in store.campaigns():
        if row.damage:
            damaged.append(Done(row.campaign, row.rig, failure=row.damage))
        elif row.state == "running":
            skipped[row.campaign] = "is being measured"
        elif not row.readings:
            skipped[row.campaign] = "nothing was measured"
        else:
            able.append(row)
    return Chosen(tuple(able), skipped, tuple(damaged))


def work_through(
    store: Store, out: Path, work: Work, chosen: Sequence[CampaignSummary], pool: Pool, *, again: bool = False
) -> Iterator[Done]:
    """Do the work on each campaign, as they come; kept results first, unless `again`. InputError if `out` is none."""
    rigs = {row.campaign: row.rig for row in chosen}
    keys = {name: work.key(head) for name, head in store.heads().items() if head}  # unchained: nothing vouches for it
    missing = []
    for name, rig in rigs.items():
        kept = None if again else _kept(out, work, name, keys.get(name))
        if kept is None:
            missing.append(name)
        else:
            yield Done(name, rig, kept, kept=True)
    unread: list[Attempt] = []
    for attempt in pool.attempts(_tasks(store, work, missing, unread)):
        if attempt.failure:
            yield Done(attempt.name, rigs[attempt.name], failure=attempt.failure)
        else:
            result = _keep(out, work, attempt.name, attempt.value, keys.get(attempt.name))
            yield Done(attempt.name, rigs[attempt.name], result)
    for attempt in unread:
        yield Done(attempt.name, rigs[attempt.name], failure=attempt.failure)


def _tasks(store: Store, work: Work, names: Sequence[str], unread: list[Attempt]) -> Iterator[Task]:
    """Recordings are read when they are asked for, and travel with their task: workers need no store."""
    for name in names:
        try:
            recording = store.recording(name)
        except (InputError, StoreError) as error:
            unread.append(Attempt(name, failure=str(error)))
        else:
            yield Task(name, work.function, (recording, *work.options))


def _kept(out: Path, work: Work, campaign: str, key: str | None) -> dict[str, Any] | None:
    try:
        kept = json.loads((campaign_folder(out, campaign) / work.file).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    is_same = isinstance(kept, dict) and key is not None and kept.get("key") == key
    return kept["result"] if is_same and isinstance(kept.get("result"), dict) else None


def _keep(out: Path, work: Work, campaign: str, product: Product, key: str | None) -> dict[str, Any]:
    """Write a campaign's files, the result last: where it is, all others are."""
    folder = campaign_folder(out, campaign)
    result: dict[str, Any] = _replaced(product.result, PLACE, str(folder))
    try:
        for name, data in product.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        folder.mkdir(parents=True, exist_ok=True)
        part = folder / f"{work.file}.part"
        part.write_text(json.dumps({"key": key, "result": result}, allow_nan=False), encoding="utf-8")
        part.replace(folder / work.file)
    except OSError as error:
        raise InputError(f"{work.command}: {error}; choose another --out") from error
    return result


def _replaced(value: Any, before: str, after: str) -> Any:
    """A result in which texts that begin with one folder begin with another."""
    if isinstance(value, Mapping):
        return {key: _replaced(entry, before, after) for key, entry in value.items()}
    if isinstance(value, list):
        return [_replaced(entry, before, after) for entry in value]
    if isinstance(value, str) and value.startswith(before):
        return after + value.removeprefix(before)
    return value


def _as_read(result: Mapping[str, Any]) -> dict[str, Any]:
    """A result as it will be read from its file. ValueError if it holds what JSON has not."""
    read: dict[str, Any] = json.loads(json.dumps(result, allow_nan=False))
    return read


def _identify(recording: Recording, estimator: str, robust: bool, draws: int) -> Product:
    return Product(_as_read(identify_with_checks(recording, estimator, robust=robust, draws=draws)))


def _diagnose(recording: Recording, effects: Sequence[tuple[str, str]], add: bool, thorough: bool) -> Product:
    """As `diagnose` does it of one campaign, in a temporary folder, whose files are sent back."""
    from pkm_rig.jobs.diagnose import run_diagnosis  # noqa: PLC0415 - draws, which takes a second to import

    with TemporaryDirectory() as name:
        root = Path(name)
        paths = [root / "effects" / file for file, _ in effects]
        for path, (_, text) in zip(paths, effects, strict=True):
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        out = root / "out"
        out.mkdir()
        _, result = run_diagnosis(recording, out, paths, add=add, thorough=thorough)
        folder = campaign_folder(out, recording.file.campaign)
        files = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        return Product(_replaced(_as_read(result), str(folder), PLACE), files)
