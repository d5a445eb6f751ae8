"""The certified problems before they are drawn: machine, what is measured of it, payloads, errors and noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Task:
    """What a problem is made of. error, noise: shares of the tolerances and sigmas that the data are drawn with."""

    name: str
    about: str
    machine: str
    coordinates: tuple[str, ...]
    poses: int
    seed: int
    payloads: tuple[tuple[float, tuple[float, float, float]], ...] = ((0.0, (0.0, 0.0, 0.0)),)
    sigma_m: float = 5e-6
    sigma_rad: float = 3e-5
    error: float = 1.0
    noise: float = 1.0
    warm: bool = False
    kinds: tuple[str, ...] | None = None
    tolerances: Mapping[str, float] = field(default_factory=dict)  # instead of those of the shipped machine
    bold: float = 0.9  # of the chain's moves: 1 forgets where it was
    steps: int = 500


NOTHING = (0.0, (0.0, 0.0, 0.0))
POSE = ("x", "y", "z", "rx", "ry", "rz")
PLANAR_POSE = ("x", "y", "rz")


def fine(metres: float) -> dict[str, float]:
    """Tolerances so small that the posterior of an over-constrained machine is close to a Gaussian.

    The product of a misfit and a stiffness error is what bends it: with the shipped tolerances the Laplace standard
    errors of the stiffnesses are too large by up to a tenth (`planar4-shop`).
    """
    lengths = ("strut_length_m", "platform_joint_m", "base_joint_m")
    return dict.fromkeys(lengths, metres) | {"ln_stiffness": 0.05}


TASKS = (
    Task(
        "planar4-pose",
        "Over-constrained by one; full pose; with and without a known load, each part at its own temperature.",
        "planar4",
        PLANAR_POSE,
        12,
        1,
        (NOTHING, (400.0, (0.0, -0.2, 0.0))),
        error=0.3,
        noise=0.1,
        warm=True,
        tolerances=fine(2e-5),
    ),
    Task(
        "planar4-xy",
        "Over-constrained by one; x and y only; no load difference.",
        "planar4",
        ("x", "y"),
        12,
        2,
        noise=0.1,
        tolerances=fine(3e-5),
    ),
    Task(
        "planar4-shop",
        "Shipped tolerances and full noise: what a Gaussian cannot say about a strained machine's stiffness.",
        "planar4",
        PLANAR_POSE,
        12,
        3,
        (NOTHING, (400.0, (0.0, -0.2, 0.0))),
        bold=0.4,
        steps=3000,
    ),
    Task("rrr3-pose", "Exactly constrained, cranks; full pose; no load in its plane.", "rrr3", PLANAR_POSE, 12, 4),
    Task(
        "rrr4-xy",
        "Over-constrained by one, cranks; x and y only.",
        "rrr4",
        ("x", "y"),
        16,
        5,
        noise=0.1,
        tolerances=fine(3e-5),
    ),
    Task(
        "delta6-xyz",
        "Exactly constrained; the tool point only; with and without a known load.",
        "delta6",
        ("x", "y", "z"),
        12,
        6,
        (NOTHING, (40.0, (0.0, 0.0, -0.08))),
        noise=0.2,
        tolerances={"ln_stiffness": 0.05},
    ),
    Task(
        "delta8-pose",
        "Over-constrained by two; full pose; no load difference; each part at its own temperature.",
        "delta8",
        POSE,
        10,
        7,
        error=0.3,
        noise=0.1,
        warm=True,
        tolerances=fine(1.5e-5),
    ),
    Task(
        "stewart6-pose",
        "Exactly constrained, legs; full pose; with and without a known load.",
        "stewart6",
        POSE,
        10,
        8,
        (NOTHING, (400.0, (0.02, 0.01, 0.25))),
        error=0.3,
        noise=0.2,
        tolerances={"ln_stiffness": 0.05},
    ),
    Task(
        "gough8-height",
        "Over-constrained by two, legs; the height only; with and without a known load.",
        "gough8",
        ("z",),
        20,
        9,
        (NOTHING, (400.0, (0.02, 0.01, 0.25))),
        noise=0.1,
        tolerances=fine(3e-5),
    ),
    Task(
        "hexaglide-pose",
        "Exactly constrained, sliders; full pose; no load difference.",
        "hexaglide",
        POSE,
        8,
        10,
        noise=0.2,
        tolerances={"ln_stiffness": 0.05},
    ),
    Task(
        "prs3-height",
        "Guide planes; the height only; with and without a known load.",
        "prs3",
        ("z",),
        20,
        11,
        (NOTHING, (60.0, (0.01, 0.0, -0.12))),
        noise=0.2,
        tolerances={"ln_stiffness": 0.05},
    ),
)
