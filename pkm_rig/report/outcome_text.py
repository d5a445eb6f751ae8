"""The result of a calibration for people."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from calibration.base.rounding import round_result
from calibration.identification.model_comparison import predicted_errors
from calibration.machine.description import COORDINATES
from calibration.reduction.figures import COVERAGE_FACTOR, Figures, coordinate_errors
from pkm_rig.report.diagnosis_text import diagnosis_line
from pkm_rig.report.left_out_text import SHOWN, left_out_lines
from pkm_rig.report.terminal import print_simulated, results
from pkm_rig.results.outcome import CampaignOutcome, VerificationResult


def print_outcome(outcome: CampaignOutcome, report: Path | None) -> None:
    """The short table, the comparison, the verdict and where the report is."""
    print_simulated(outcome.simulated)
    table = Table(box=None, pad_edge=False)
    table.add_column("")
    table.add_column("position / um (U, k = 2)", justify="right")
    table.add_column("orientation / urad", justify="right")
    for name, position, orientation in short_table(outcome):
        table.add_row(name, position, orientation)
    results.print(table)
    if outcome.back_end == "host":
        results.print()
        results.print(coordinate_table(outcome))
    last = outcome.verified[-1]
    comparison = Table(box=None, pad_edge=False)
    comparison.add_column(f"prediction at {last.payload_kg:g} kg by")
    comparison.add_column("position / um", justify="right")
    comparison.add_column("orientation / urad", justify="right")
    for name, figures in last.models.items():
        comparison.add_row(name, f"{figures.position_rms_m * 1e6:.1f}", f"{figures.orientation_rms_rad * 1e6:.1f}")
    results.print()
    results.print(comparison)
    results.print(comparison_remark(last))
    results.print()
    for verified in outcome.verified:
        results.print(f"{verified.payload_kg:g} kg: {verified.decision.rule}")
    for line in left_out_lines([reading.as_dict() for reading in outcome.reduction.left_out], SHOWN):
        results.print(line, soft_wrap=True, markup=False)
    results.print(diagnosis_line(outcome.diagnosis), soft_wrap=True, markup=False)
    results.print("accepted" if outcome.accepted else f"{outcome.decision}; {outcome.restored}")
    if report is not None:
        results.print(f"report: {report}", soft_wrap=True)


def coordinate_table(outcome: CampaignOutcome) -> Table:
    """RMS errors by free coordinate, before and after, also of those that the drives do not command."""
    machine = outcome.reduction.recording.machine
    table = Table(box=None, pad_edge=False)
    table.add_column("RMS error (um, urad)")
    for coordinate in machine.dof:
        star = "" if coordinate in machine.commanded else "*"
        table.add_column(COORDINATES[coordinate] + star, justify="right")
    for verified in outcome.verified:
        for phase in ("before", "after"):
            rms = coordinate_errors(outcome.reduction, f"verification_{phase}", verified.payload)
            table.add_row(f"{phase}, {verified.payload_kg:g} kg", *(f"{value * 1e6:.1f}" for value in rms.values()))
        if len(machine.commanded) < len(machine.dof):
            expected = predicted_errors(outcome.calibration, outcome.reduction, "verification_after", verified.payload)
            table.add_row("  predicted after", *(f"{value * 1e6:.1f}" for value in expected.values()))
    if len(machine.commanded) < len(machine.dof):
        table.caption = "* not commanded: cannot be corrected, and changes as the model predicts"
    return table


def comparison_remark(verified: VerificationResult) -> str:
    """One sentence that states the result of the comparison."""
    rows = model_rows(verified)
    good = [row.name for row in rows if row.as_good]
    if not good:
        return f"At {verified.payload_kg:g} kg no rigid identification predicts as well."
    return f"At {verified.payload_kg:g} kg as good within 10 %: {'; '.join(good)}."


def short_table(outcome: CampaignOutcome) -> list[tuple[str, str, str]]:
    """(what, um, urad) rows for the terminal."""

    def row(name: str, figures: Figures) -> tuple[str, str, str]:
        expanded = COVERAGE_FACTOR * figures.u_position_rms_m * 1e6
        return (
            name,
            " +- ".join(round_result(figures.position_rms_m * 1e6, expanded)),
            f"{figures.orientation_rms_rad * 1e6:.1f}",
        )

    rows = []
    for v in outcome.verified:
        rows.append(row(f"before, {v.payload_kg:g} kg", v.before))
        rows.append(row(f"after, {v.payload_kg:g} kg", v.after))
    rows.append(row("noise floor", outcome.floor))
    return rows


MODEL_NAMES = {
    "deformation_aware": "deformation-aware, one model for all payloads (this calibration)",
    "leave_out_link": "rigid, redundant link left out, one geometry",
    "leave_out_link_per_payload": "rigid, redundant link left out, refitted per payload",
    "mean_of_minimal_subsets": "rigid, mean over what may be left out, one geometry",
    "mean_of_minimal_subsets_per_payload": "rigid, mean over what may be left out, refitted per payload",
    "per_leg_closure": "rigid, closure leg by leg, one geometry",
    "per_leg_closure_per_payload": "rigid, closure leg by leg, refitted per payload",
    "equal_weight_closure": "rigid, equal-weight closure, one geometry",
    "equal_weight_closure_per_payload": "rigid, equal-weight closure, refitted per payload",
}
AS_GOOD_FACTOR = 1.1  # models whose error is within this factor of ours are called as good


@dataclass(frozen=True)
class ModelRow:
    """One line of the model comparison."""

    name: str
    position_um: float
    orientation_urad: float
    as_good: bool


def model_rows(verified: VerificationResult) -> list[ModelRow]:
    """The comparison at one payload; says where a baseline is as good as ours."""
    ours = verified.models["deformation_aware"]
    return [
        ModelRow(
            MODEL_NAMES.get(name, name),
            figures.position_rms_m * 1e6,
            figures.orientation_rms_rad * 1e6,
            name != "deformation_aware" and figures.position_rms_m <= AS_GOOD_FACTOR * ours.position_rms_m,
        )
        for name, figures in verified.models.items()
    ]
