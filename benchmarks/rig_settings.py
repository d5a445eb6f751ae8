"""What the rig study does: its machines, its calibration cases, its noise."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from calibration.machine.description import shipped_machine

WITHIN_95 = 1.959964  # standard deviations
ESTIMATORS = ("map", "least_squares", "tikhonov", "l_curve", "truncated_svd")


@dataclass(frozen=True)
class Study:
    """What is common to all rigs of one machine; a change of any of it makes another study.

    Payloads have one centre of mass and one relative error of their masses, of the stated standard uncertainty: they
    are weighed on one scale and mounted in one place.
    """

    machine: str
    payload_com_m: tuple[float, float, float]
    u_payload_mass: float
    u_payload_com_m: float
    poses: int = 64
    held_out: int = 300
    sigma_m: float = 7e-6
    sigma_rad: float = 30e-6
    layout: int = 1  # of a stored rig

    @property
    def path(self) -> Path:
        """The machine file."""
        return shipped_machine(self.machine)

    def settings(self) -> dict[str, Any]:
        """Everything that a stored result depends on but the code."""
        cases = [asdict(case) for case in CASES]
        return {**asdict(self), "cases": cases, "machine_file": self.path.read_text(encoding="utf-8")}


@dataclass(frozen=True)
class CalibrationCase:
    """Payloads (kg) that are measured, each at all poses, and payloads that are predicted for held-out poses.

    uncertain: the payload's mass and centre of mass are off by draws of their standard uncertainties, which are
    unknowns of the fit. compared: other estimators and the rigid baselines are run too.
    """

    name: str
    measured_kg: tuple[float, ...]
    used_kg: tuple[float, ...]
    judged_kg: tuple[float, ...]
    uncertain: bool = False
    compared: bool = True


CASES = (
    CalibrationCase("no payload", (0.0,), (0.0, 400.0), (0.0,)),
    CalibrationCase("0 and 400 kg, known", (0.0, 400.0), (0.0, 200.0, 400.0), (0.0, 200.0, 400.0)),
    CalibrationCase(
        "0 and 400 kg, uncertain",
        (0.0, 400.0),
        (0.0, 200.0, 400.0),
        (0.0, 200.0, 400.0),
        uncertain=True,
        compared=False,
    ),
)
STUDIES = (
    Study("planar4", (0.0, -0.2, 0.0), u_payload_mass=1e-3, u_payload_com_m=2e-3),
    Study("gough8", (0.02, 0.01, 0.25), u_payload_mass=2e-3, u_payload_com_m=2e-3),
)
