"""Diagnosis of a recording as a command does it: pictures, campaign files and the twin beside the store."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from calibration.diagnosis.diagnose import (
    diagnose,
    diagnose_and_score,
    diagnose_measurements,
    diagnose_measurements_and_score,
)
from calibration.diagnosis.result import Diagnosis
from calibration.diagnosis.settings import VERDICT
from calibration.diagnosis.twin.folder_twin import FolderTwin
from calibration.diagnosis.twin.score import TwinScore
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.catalogue import load_catalogue
from calibration.identification.calibration import calibration_part
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.recording.recording import Recording
from calibration.reduction.nest_checks import drop_unclosed_readings
from pkm_rig.jobs.campaign_file import remarks_on_unwritable, write_campaign_files
from pkm_rig.jobs.visit_file import write_visit_files
from pkm_rig.report import diagnosis_pictures
from pkm_rig.report.diagnosis_json import additions_by_gain, diagnosis_json, gap_json
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.store.place import campaign_folder
from pkm_rig.virtual.twin_files import PREDICTED_NAME, TWIN_FOLDER, write_folder_twin, write_twin

PICTURES_FOLDER = "diagnosis"


def try_diagnosis(recording: Recording) -> DiagnosisAttempt:
    """Diagnose the calibration's readings; errors are reported in the result and never fail the calibration."""
    try:
        return DiagnosisAttempt(diagnose(drop_unclosed_readings(calibration_part(recording))))
    except InputError as error:
        return DiagnosisAttempt(None, str(error))
    except Exception as error:  # an error in the diagnosis must not abort the calibration
        return DiagnosisAttempt(None, f"internal error: {type(error).__name__}: {error}; please report it")


def run_diagnosis(
    recording: Recording, out: Path, effects: Sequence[Path] = (), *, add: bool = False, thorough: bool = False
) -> tuple[Diagnosis, dict[str, Any]]:
    """Run the diagnosis, write its files to `out`/campaign, return the object of docs/reference/diagnosis.schema.json.

    `add`: the rig's twin is written too; `thorough`: nothing is left out to save time. Raises InputError.
    """
    catalogue = load_catalogue(tuple(effects))
    readings = drop_unclosed_readings(calibration_part(recording))
    twin_and_score: tuple[Twin, TwinScore] | None = None
    with _named(effects):
        if add:
            diagnosis, twin, score = diagnose_and_score(readings, catalogue, work=_work(thorough=thorough))
            twin_and_score = twin, score
        else:
            diagnosis = diagnose(readings, catalogue, work=_work(thorough=thorough))
    simulated = readings.file.simulated
    candidates = additions_by_gain(diagnosis)
    unwritable = remarks_on_unwritable(candidates, readings.machine)
    diagnosis = replace(diagnosis, remarks=(*diagnosis.remarks, *unwritable))
    with _writing(out, diagnosis.campaign) as folder:
        files = write_campaign_files(
            candidates,
            readings.machine,
            readings.file.payloads,
            diagnosis.campaign,
            folder,
        )
        result = diagnosis_json(diagnosis, files) | {"simulated": simulated}
        figures = diagnosis_pictures.draw_all(diagnosis, readings.machine)
        result["pictures"] = diagnosis_pictures.save(figures, folder, simulated=simulated)
        if twin_and_score is not None:
            twin, score = twin_and_score
            twin_folder = campaign_folder(out, readings.file.campaign) / TWIN_FOLDER
            write_twin(twin, readings, twin_folder)
            result["twin"] = twin_json([added.effect for added in twin.added], score, twin_folder)
    return diagnosis, result


def run_folder_diagnosis(
    measured: MeasuredMachine, out: Path, effects: Sequence[Path] = (), *, add: bool = False, thorough: bool = False
) -> tuple[Diagnosis, dict[str, Any]]:
    """The same of a measurement folder, which says nothing of simulated devices. Raises InputError."""
    catalogue = load_catalogue(tuple(effects))
    twin_and_score: tuple[FolderTwin, TwinScore] | None = None
    with _named(effects):
        if add:
            diagnosis, twin, score = diagnose_measurements_and_score(measured, catalogue, work=_work(thorough=thorough))
            twin_and_score = twin, score
        else:
            diagnosis = diagnose_measurements(measured, catalogue, work=_work(thorough=thorough))
    with _writing(out, diagnosis.campaign) as folder:
        files = write_visit_files(additions_by_gain(diagnosis), measured, folder)
        result = diagnosis_json(diagnosis, files) | {"simulated": False}
        figures = diagnosis_pictures.draw_all(diagnosis, measured.machine)
        result["pictures"] = diagnosis_pictures.save(figures, folder, simulated=False)
        if twin_and_score is not None:
            twin, score = twin_and_score
            twin_folder = campaign_folder(out, diagnosis.campaign) / TWIN_FOLDER
            write_folder_twin(twin, measured, twin_folder)
            said = twin_json([effect for effect, _ in twin.effects], score, twin_folder)
            result["twin"] = said | {"predictions": str(twin_folder / PREDICTED_NAME)}
    return diagnosis, result


def _work(*, thorough: bool) -> float:
    """The work of all searches, beyond which none begins."""
    return math.inf if thorough else VERDICT.search_work


@contextmanager
def _named(effects: Sequence[Path]) -> Iterator[None]:
    """An error of a user's effect is bad input; one line names the file."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        if not effects:
            raise
        names = ", ".join(str(path) for path in effects)
        raise InputError(f"diagnose with {names}: {type(error).__name__}: {error}; correct that effect") from error


@contextmanager
def _writing(out: Path, campaign: str) -> Iterator[Path]:
    """The folder of a campaign's pictures, which is there. Raises InputError where it cannot be written."""
    folder = campaign_folder(out, campaign) / PICTURES_FOLDER
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield folder
    except OSError as error:
        raise InputError(f"diagnose: {error}; choose another --out") from error


def twin_json(effects: Sequence[str], score: TwinScore, folder: Path) -> dict[str, Any]:
    """Agreement of each region's readings with the campaign simulated on a twin of the other regions."""
    return {
        "folder": str(folder),
        "effects": list(effects),
        "readings": score.readings,
        **gap_json(score.figures),
        "before_sigma": score.before_sigma,
        "after_sigma": score.after_sigma,
    }
