"""Diagnosis of a recording as a command does it: pictures, campaign files and the twin beside the store."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from calibration.diagnosis.diagnose import diagnose, diagnose_and_score
from calibration.diagnosis.result import Diagnosis
from calibration.diagnosis.twin.score import TwinScore
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.catalogue import Catalogue, load_catalogue
from calibration.identification.calibration import calibration_part
from calibration.recording.recording import Recording
from calibration.reduction.reduction import drop_unclosed_readings
from pkm_rig.jobs.campaign_file import write_candidates
from pkm_rig.report import diagnosis_pictures
from pkm_rig.report.diagnosis_json import by_gain, diagnosis_json, gap_json
from pkm_rig.results.attempt import Attempt
from pkm_rig.virtual.twin_files import TWIN_FOLDER, write_twin

PICTURES_FOLDER = "diagnosis"


def attempt(recording: Recording) -> Attempt:
    """Diagnose the calibration's readings; whatever goes wrong is said and fails nothing else."""
    try:
        return Attempt(diagnose(drop_unclosed_readings(calibration_part(recording))))
    except InputError as error:
        return Attempt(None, str(error))
    except Exception as error:  # the calibration of a machine must not end for what is said beside it
        return Attempt(None, f"internal error: {type(error).__name__}: {error}; please report it")


def run(
    recording: Recording, out: Path, effects: Sequence[Path] = (), *, add: bool = False
) -> tuple[Diagnosis, dict[str, Any]]:
    """Diagnose, write the files into `out`/campaign, and give it as an object (docs/reference/diagnosis.schema.json).

    `add`: the rig's twin is written too. Raises InputError.
    """
    catalogue = load_catalogue(tuple(effects))
    part = drop_unclosed_readings(calibration_part(recording))
    found, added = _diagnosed(part, catalogue, effects, add=add)
    folder = out / part.file.campaign / PICTURES_FOLDER
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = write_candidates(by_gain(found), part.machine, part.file.payloads, found.campaign, folder)
        result = diagnosis_json(found, files)
        result["pictures"] = diagnosis_pictures.save(diagnosis_pictures.figures(found, part.machine), folder)
        if added is not None:
            twin, score = added
            place = out / part.file.campaign / TWIN_FOLDER
            write_twin(twin, part, place)
            result["twin"] = twin_json(twin, score, place)
    except OSError as error:
        raise InputError(f"diagnose: {error}; choose another --out") from error
    return found, result


def _diagnosed(
    recording: Recording, catalogue: Catalogue, effects: Sequence[Path], *, add: bool
) -> tuple[Diagnosis, tuple[Twin, TwinScore] | None]:
    try:
        if not add:
            return diagnose(recording, catalogue), None
        found, twin, score = diagnose_and_score(recording, catalogue)
    except InputError:
        raise
    except Exception as error:
        if not effects:
            raise
        names = ", ".join(str(path) for path in effects)
        raise InputError(f"diagnose with {names}: {type(error).__name__}: {error}; correct that effect") from error
    return found, (twin, score)


def twin_json(twin: Twin, score: TwinScore, folder: Path) -> dict[str, Any]:
    """How the campaign, simulated on twins of the other regions' readings, agrees with those of each region."""
    return {
        "folder": str(folder),
        "effects": [added.effect for added in twin.added],
        "readings": score.readings,
        **gap_json(score.figures),
        "before_sigma": score.before_sigma,
        "after_sigma": score.after_sigma,
    }
