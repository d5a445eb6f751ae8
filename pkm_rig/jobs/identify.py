"""Identification of a recording as a command does it."""

from __future__ import annotations

from typing import Any, get_args

from calibration.base.errors import InputError
from calibration.identification.calibration import identified_summary, identify_recording
from calibration.identification.fit import Estimator
from calibration.identification.held_out import cross_check, held_out_error
from calibration.recording.recording import Recording

MOST_DRAWS = 200_000


def check_options(estimator: str, draws: int) -> Estimator:
    """The estimator; InputError if there is none of that name, or so many draws make no sense."""
    if estimator not in get_args(Estimator):
        raise InputError(f"estimator '{estimator}' is unknown; use {', '.join(get_args(Estimator))}")
    if draws != 0 and not 2 <= draws <= MOST_DRAWS:
        raise InputError(f"monte carlo: {draws} draws; choose 0 (none) or 2 to {MOST_DRAWS}")
    chosen: Estimator = estimator  # type: ignore[assignment]
    return chosen


def identify_with_checks(
    recording: Recording, estimator: str, *, robust: bool = False, draws: int = 0
) -> dict[str, Any]:
    """Identification with held-out error and posterior bound (docs/reference/json.md). `draws`: Monte Carlo."""
    chosen = check_options(estimator, draws)
    identification = identify_recording(recording, chosen, baselines=False, robust=robust)
    held_out, bound = held_out_error(identification, chosen, robust=robust)
    return {
        "calibration": recording.file.campaign,
        "simulated": recording.file.simulated,
        **identified_summary(identification),
        "held_out": held_out,
        "bound": bound,
        **({"monte_carlo": cross_check(identification, draws)} if draws else {}),
    }
