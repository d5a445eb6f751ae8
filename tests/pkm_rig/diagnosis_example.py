"""A diagnosis made by hand: backlash of 30 um at the left drive, seen in visits over the workspace of planar4."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.diagnosis.result import (
    NONE,
    UNKNOWN,
    CampaignAddition,
    Clue,
    Diagnosis,
    FoundEffect,
    FoundPlace,
    GapFigures,
    ProposedVisit,
    Quantity,
    Share,
    Spectrum,
    VisitGaps,
    Withheld,
)
from calibration.reduction.left_out import LeftOutReading


def example(visits: int = 160) -> Diagnosis:
    rng = np.random.default_rng(1)
    tool = np.zeros((visits, 3))
    tool[:, :2] = rng.uniform(-0.3, 0.3, (visits, 2))
    direction = rng.choice([-1.0, 1.0], (visits, 2))
    noise = rng.normal(0.0, 4e-6, (2, visits, 3)) * [1.0, 1.0, 0.0]
    shift = np.zeros((visits, 3))
    shift[:, 0], shift[:, 1] = 6e-6 * direction[:, 0], 12e-6 * direction[:, 0] * (1.0 + tool[:, 0])
    period = np.geomspace(0.2, 0.004, 80)
    return Diagnosis(
        campaign="made-by-hand",
        verdict="backlash",
        equivalent=("friction_windup",),
        matters_m=4.1e-7,
        effects=(
            FoundEffect(
                effect="backlash",
                place="left",
                size=Quantity("width_m", 3.04e-5, 6.2e-7, "m"),
                probability=0.9962,
                place_probability=0.9999,
                raw_sigma=4.9,
                visible_sigma=3.4,
                others=(Quantity("lag_m", 2.0e-3, 4.0e-4, "m"),),
                differs_with=("travel.left", "payload"),
                places=(
                    FoundPlace(
                        place="left",
                        size=Quantity("width_m", 3.04e-5, 6.2e-7, "m"),
                        probability=0.9999,
                        raw_sigma=4.2,
                        visible_sigma=3.1,
                        others=(Quantity("lag_m", 2.0e-3, 4.0e-4, "m"),),
                        differs_with=("travel.left", "payload"),
                    ),
                    FoundPlace(
                        "right",
                        Quantity("width_m", 1.8e-5, 4.0e-7, "m"),
                        1.0,
                        2.5,
                        1.4,
                        at_channels=(Quantity("travel.right", 9.0e-6, 1.1e-6, "m"),),
                    ),
                ),
            ),
        ),
        ranking={"none": 0.0, "unknown": 0.0026, "friction_windup": 0.0012, "backlash": 0.9962},
        where=(
            Share("direction", "left", 0.81, 0.74, 0.88),
            Share("drive", "left", 0.22, 0.1, 0.31),
            Share("pose", "x", 0.08, 0.01, 0.15),
            Share("time", "", 0.01, 0.0, 0.05),
            Share("smr", "P2", 0.0, 0.0, 0.03),
        ),
        gap=GapFigures(1.31e-5, 1.9e-6, 4.2e-6, 0.855, (0.79, 0.9), "four passes"),
        not_tested={"screw_thermal_growth": "the drives' temperatures did not change"},
        hidden_m=9e-7,
        inside_geometry={"smr_offset": 3.0e-6, "joint_spacing": 1.1e-5},
        clues=(),
        next_measurement=(
            CampaignAddition(
                "other dwell", "dwells of 0.5 to 60 s", ("backlash", "friction_windup"), 40.0, 0.4, planned()
            ),
            CampaignAddition("an SMR on the slider", "a reflector on slider left", ("unknown",), 30.0, 0.9, ()),
        ),
        withheld=Withheld(np.arange(3), np.zeros((3, 3)), np.zeros((3, 3))),
        visits=VisitGaps(
            tool_m=tool, before_m=shift + noise[0], after_m=noise[1], t_rig_s=np.linspace(3600.0, 3600.0 * 5, visits),
            drives=1.1 + 0.3 * tool[:, :2], direction=direction,
            payload_kg=np.where(np.arange(visits) // 40 % 2, 400.0, 0.0), dwell_s=rng.choice([0.5, 2.0, 8.0], visits),
        ),
        spectra=(
            Spectrum("left", period, 0.7 + rng.random(80) + 20.0 * np.exp(-((np.log(period / 0.01) / 0.03) ** 2))),
            Spectrum("right", period, 0.7 + 0.6 * rng.random(80)),
        ),
        remarks=("the station's frame drifted more than declared",),
    )  # fmt: skip


def wrong_readings(count: int) -> tuple[LeftOutReading, ...]:
    """Readings of P2 that were left out, each farther off than the one before."""
    return tuple(
        LeftOutReading(f"r{i}", "P2", 1e-4 * (i + 1), "m", 7.0 + i, "diagnosis gate", 10 * i, 1800.0 * i)
        for i in range(count)
    )


def planned() -> tuple[ProposedVisit, ...]:
    return tuple(
        ProposedVisit((x, y, 0.0, 0.0, 0.0, 0.0), (side, -side), payload, 0.25, dwell)
        for payload in (0, 2)
        for x, y, side, dwell in ((-0.3, 0.2, 1, 0.5), (0.1, 0.123456789012, -1, 60.0), (0.35, -0.3, 1, 4.0))
    )


def nothing_found() -> Diagnosis:
    gap = GapFigures(0.0, 0.0, 4.2e-6, float("nan"), (float("nan"), float("nan")), "four passes")
    return replace(
        example(),
        verdict=NONE,
        equivalent=(),
        effects=(),
        ranking={"none": 0.997, "unknown": 0.003},
        where=(),
        gap=gap,
        spectra=(),
    )


def not_explained() -> Diagnosis:
    return replace(
        example(),
        verdict=UNKNOWN,
        equivalent=(),
        effects=(),
        ranking={"none": 0.0, "unknown": 0.98, "backlash": 0.02},
        clues=(Clue("travel.left", "pose x", 0.6),),
    )
