"""The Python interface: what the commands do, as functions of objects. SI units; every error is one line.

Raises InputError (`calibration.base.errors`) for files and choices, DeviceError (`drivers.errors`) for devices,
CampaignRefused and StoreError (`pkm_rig.errors`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibration.comparison.result import Comparison
    from calibration.compensation.tables import CompensationTable
    from calibration.diagnosis.result import Diagnosis
    from calibration.identification.calibration import Calibration
    from calibration.identification.fit import Estimator
    from calibration.machine.description import Machine
    from calibration.recording.recording import Recording
    from calibration.reduction.reduction import Reduction
    from pkm_rig.results.outcome import CampaignOutcome
    from pkm_rig.rig.config import RigFile
    from pkm_rig.rig.rig import Rig
    from pkm_rig.store.store import Store


def load_machine(machine: str | Path) -> Machine:
    """A machine of the package by its name ("planar4"), or your own by the path of its file."""
    from calibration.machine.description import load_machine, shipped_machine

    path = Path(machine)
    return load_machine(path if path.suffix == ".toml" else shipped_machine(str(machine)))


def load_rig(rig_file: str | Path) -> tuple[RigFile, Machine]:
    """A rig file and its machine, checked; "embedded" names those of the embedded mock rig."""
    from pkm_rig.rig.config import load_rig, rig_path

    return load_rig(rig_path(rig_file))


@contextmanager
def connect(
    rig_file: str | Path,
    *,
    real_time: bool = False,
    seed: int | None = None,
    homing: bool = False,
    goes_on: tuple[Store, str] | None = None,
) -> Iterator[Rig]:
    """A connected, supervised rig, left stopped and without power in the end.

    "embedded" names the embedded mock rig: in virtual time unless `real_time`, with the mock machine number `seed`.
    For `homing` drives may have lost their reference; they are then refused any other motion. `goes_on`: store and
    campaign that this rig will go on with; its time begins after the campaign's.
    """
    from pkm_rig.jobs.session import open_rig
    from pkm_rig.rig.config import rig_path
    from pkm_rig.rig.session_record import last_moment

    after = last_moment(*goes_on) if goes_on else None
    with open_rig(rig_path(rig_file), real_time=real_time, seed=seed, homing=homing, after=after) as rig:
        yield rig


@contextmanager
def open_store(folder: str | Path) -> Iterator[Store]:
    """The store of campaigns in a folder, created if it does not exist."""
    from pkm_rig.store.store import open_store

    with open_store(Path(folder)) as store:
        yield store


def measure(
    rig: Rig,
    store: Store,
    *,
    resume: str | None = None,
    new_setup: bool = False,
    notify: Callable[[str], None] = lambda _line: None,
    progress: Callable[[int, int, str], None] = lambda _count, _total, _phase: None,
) -> str:
    """Measure a calibration campaign into the store, or continue one with `resume`, in a `new_setup` if asked; its id.

    `notify` gets lines of text, `progress` the readings since its last call, those of the campaign and the phase.
    """
    from pkm_rig.jobs.measure import measure

    return measure(rig, store, notify, progress, resume, new_setup=new_setup)


def calibrate(
    rig: Rig,
    store: Store,
    *,
    resume: str | None = None,
    notify: Callable[[str], None] = lambda _line: None,
    progress: Callable[[int, int, str], None] = lambda _count, _total, _phase: None,
) -> CampaignOutcome:
    """The main job: measure, identify, diagnose, write tables, verify them; refused tables are taken back.

    `resume` goes on with a campaign wherever it ended; the rig is connected with `goes_on`.
    """
    from pkm_rig.jobs.calibrate import calibrate

    return calibrate(rig, store, notify, progress, resume)


def read_recording(folder: str | Path) -> Recording:
    """A recording folder, checked (docs/reference/recording.md); those of the store come from `Store.recording`."""
    from calibration.recording.folder import read_folder

    return read_folder(Path(folder))


def reduce(recording: Recording) -> Reduction:
    """Readings reduced to poses: drift estimated, range constant taken off, report frame fitted."""
    from calibration.reduction.reduction import reduce

    return reduce(recording)


def identify(recording: Recording, estimator: Estimator = "map", *, robust: bool = False) -> Calibration:
    """The machine's parameters from the calibration's readings, with their covariance; `robust` bears outliers."""
    from calibration.identification.calibration import identify_recording

    return identify_recording(recording, estimator, baselines=False, robust=robust)


def diagnose(recording: Recording, effects: tuple[str | Path, ...] = ()) -> Diagnosis:
    """Where model and machine still differ, and which effect causes it; `effects`: Python files with your own."""
    from calibration.diagnosis.diagnose import diagnose
    from calibration.effects.catalogue import load_catalogue
    from calibration.identification.calibration import calibration_part
    from calibration.reduction.nest_checks import drop_unclosed_readings

    readings = drop_unclosed_readings(calibration_part(recording))
    return diagnose(readings, load_catalogue(tuple(Path(path) for path in effects)))


def compare(before: Recording, after: Recording) -> Comparison:
    """What changed on the machine between two campaigns. InputError if they cannot be compared."""
    from calibration.comparison.compare import compare
    from calibration.identification.calibration import calibration_part
    from calibration.reduction.nest_checks import drop_unclosed_readings

    first, second = (drop_unclosed_readings(calibration_part(recording)) for recording in (before, after))
    return compare(first, second)


def build_tables(
    identification: Calibration, payload: int = 0, temperatures_c: Mapping[str, float] | None = None
) -> CompensationTable:
    """Corrections of all drives for a payload of the recording's list, at its last temperatures unless given."""
    from calibration.compensation.tables import table_for_payload

    if temperatures_c is None:
        recording = identification.reduction.recording
        temperatures_c = {name: float(values[-1]) for name, values in recording.temperatures_c().items()}
    return table_for_payload(identification, payload, dict(temperatures_c))
