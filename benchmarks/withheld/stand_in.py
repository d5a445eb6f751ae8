"""A diagnosis by rule of thumb in place of the real one: tests of the harness need one that is quick."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np

from calibration.diagnosis.result import (
    CampaignAddition,
    Diagnosis,
    FoundEffect,
    FoundPlace,
    GapFigures,
    ProposedVisit,
    Quantity,
    Share,
    VisitGaps,
    Withheld,
)
from calibration.recording.recording import Recording

from .baselines import NONE, UNKNOWN, simple_answers


def diagnose(recording: Recording, without: tuple[str, ...] = (), without_forms: tuple[str, ...] = ()) -> Diagnosis:
    """The nearest residual's effect; predicts what was measured."""
    verdict = simple_answers(recording, without)["nearest_residual"]
    platform = {s.name for s in recording.machine.smrs if s.on == "platform"}
    rows = np.flatnonzero(np.isin(np.asarray(recording["smr"]), list(platform)))
    measured = recording.positions_m[rows]
    nothing, none = np.empty((0, 3)), np.empty(0)
    size = Quantity("width_m", 1e-5, 1e-6, "m")
    places = (FoundPlace("left", size, 0.6, 3.0, 2.0),)
    effect = FoundEffect(verdict, "left", size, 0.8, 0.6, 3.0, 2.0, places=places)
    return Diagnosis(
        campaign=recording.file.campaign,
        verdict=verdict,
        equivalent=(),
        matters_m=0.0,
        effects=() if verdict in (NONE, UNKNOWN) else (effect,),
        ranking={verdict: 0.8, **({} if verdict == UNKNOWN else {UNKNOWN: 0.2})},
        where=(Share("time", "time", 0.5, 0.4, 0.6),),
        gap=GapFigures(2e-5, 1e-5, 8e-6, 0.5, (0.3, 0.7), "every fourth visit"),
        not_tested={},
        hidden_m=1e-6,
        inside_geometry={},
        clues=(),
        next_measurement=(CampaignAddition("both sides", "other sides", (), 10.0, 1.0, _visits()),),
        withheld=Withheld(rows, measured + 2e-5, measured),
        visits=VisitGaps(nothing, nothing, nothing, none, none, none, none, none),
        spectra=(),
    )


def asks_for_the_plant(
    recording: Recording, without: tuple[str, ...] = (), without_forms: tuple[str, ...] = ()
) -> Diagnosis:
    """One that cheats, and hides it."""
    with contextlib.suppress(Exception):
        __import__("mock_devices.effects")
    return diagnose(recording, without)


def reads_a_truth(
    recording: Recording, without: tuple[str, ...] = (), without_forms: tuple[str, ...] = ()
) -> Diagnosis:
    """One that looks for the truths of former batches, and hides it."""
    with contextlib.suppress(Exception):
        Path("truth.json").read_text(encoding="utf-8")
    return diagnose(recording, without)


def _visits() -> tuple[ProposedVisit, ...]:
    rng = np.random.default_rng(1)
    return tuple(
        ProposedVisit(
            (float(x), float(y), 0.0, 0.0, 0.0, 0.0), tuple(int(s) for s in rng.choice([-1, 1], 2)), 0, 0.25, 2.0
        )
        for x, y in rng.uniform(-0.3, 0.3, (30, 2))
    )
