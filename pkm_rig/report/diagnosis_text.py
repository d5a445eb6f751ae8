"""A diagnosis in words."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from calibration.base.rounding import round_result
from calibration.diagnosis.result import (
    FEW_COORDINATES,
    NONE,
    UNKNOWN,
    CampaignAddition,
    Diagnosis,
    FoundEffect,
    GapFigures,
    Quantity,
    Share,
)
from calibration.reduction.figures import COVERAGE_FACTOR
from pkm_rig.report.diagnosis_json import additions_by_gain, largest_shares, ranking_by_probability
from pkm_rig.report.left_out_text import SHOWN, left_out_lines
from pkm_rig.report.notation import plain_number
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt

PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"), (1e-12, "p"))
PREFIXED = ("m", "rad", "s")
LARGEST_PPM = 1e-3  # ratios below are shown in ppm
MOST_RANKED, LEAST_PROBABILITY = 6, 0.005
MEANINGS = {  # of channels whose effect has another name
    "light.range": "scale of the ranges: index of air wrong or late",
}
WORTH_MEASURING_BIT = 0.01  # expected information below which no campaign is recommended


def one_line_summary(diagnosis: Diagnosis) -> str:
    """The verdict, its size and how far the gap shrinks, in one line."""
    gap = diagnosis.gap
    fall = f"gap {length(gap.before_m)} on withheld data (noise floor {length(gap.noise_floor_m)})"
    if diagnosis.verdict == NONE:
        return f"no effect beyond the model; detection limit {length(diagnosis.hidden_m)} RMS; {fall}"
    if diagnosis.verdict == UNKNOWN:
        clue = (
            f", strongest over {diagnosis.clues[0].coordinate} ({diagnosis.clues[0].channel})"
            if diagnosis.clues
            else ""
        )
        return f"unknown effect: the gap has structure that no effect of the catalogue explains{clue}; {fall}"
    alike = f" (or {', '.join(diagnosis.equivalent)}: not told apart)" if diagnosis.equivalent else ""
    causes = " and ".join(describe_effect(effect) for effect in diagnosis.effects) or diagnosis.verdict
    if gap.grows:
        it = "it" if len(diagnosis.effects) < 2 else "them"
        grows = f"gap {length(gap.before_m)} to {length(gap.after_m)}: do not add {it} to the model"
        return f"{causes}{alike}; but with {it} withheld data are predicted worse, {grows}"
    low, high = diagnosis.gap.shrink_interval
    falls = f"gap {length(gap.before_m)} to {length(gap.after_m)} on withheld data, shrink {percent(gap.shrink)}"
    return f"{causes}{alike}; {falls} (95 %: {percent(low)} to {percent(high)})"


def describe_effect(effect: FoundEffect) -> str:
    """An effect in words: name, places with the size at each and its U, probability."""
    sizes = " and".join(
        f" at {place.place}, {format_quantity(place.size)}" if place.place else f", {format_quantity(place.size)}"
        for place in effect.places
    )
    return f"{effect.effect}{sizes}, probability {probability(effect.probability)}"


def describe_diagnosis(
    diagnosis: Diagnosis, result: Mapping[str, Any], measure_with: str | None = None
) -> RenderableType:
    """The diagnosis for people; `result` is its JSON object with pictures and campaign files."""
    parts: list[RenderableType] = [
        _line(f"campaign {diagnosis.campaign}"),
        _line(f"verdict: {diagnosis.verdict}"),
        _line(one_line_summary(diagnosis)),
    ]
    if diagnosis.equivalent:
        together = " = ".join((diagnosis.verdict, *diagnosis.equivalent))
        parts.append(
            _line(f"equivalent: {together}; their predictions differ by at most {length(diagnosis.matters_m)} RMS")
        )
    if diagnosis.effects:
        what = "raw, visible: RMS change of a coordinate in sigma, before and after the geometry is fitted again"
        parts += [_title(f"effects ({what})"), _effects(diagnosis.effects)]
    likely = [(n, p) for n, p in ranking_by_probability(diagnosis)[:MOST_RANKED] if p >= LEAST_PROBABILITY]
    parts.append(_line(f"\nranking: {', '.join(f'{name} {probability(p)}' for name, p in likely)}"))
    parts += [_title("the gap, RMS on withheld data, noise floor removed"), *_gap(diagnosis.gap)]
    if diagnosis.where:
        parts += [
            _title("where: share of the gap's variance (they need not add up)"),
            _shares(largest_shares(diagnosis)),
        ]
    if diagnosis.clues:
        parts.append(_title("clues to the unknown effect"))
        parts += [_line(f"- {c.channel} over {c.coordinate}: {percent(c.share)} of the gap") for c in diagnosis.clues]
    if diagnosis.inside_geometry:
        inside = ", ".join(f"{name} {length(rms)}" for name, rms in diagnosis.inside_geometry.items())
        parts.append(_line(f"\nabsorbed by the geometry, not causes: {inside}"))
    parts.append(_line(f"undetected effects are below {length(diagnosis.hidden_m)} RMS (95 %)"))
    if diagnosis.not_tested:
        parts.append(_title("not tested: this campaign's design cannot show"))
        parts += [_line(f"- {name}: {reason}") for name, reason in diagnosis.not_tested.items()]
    parts += [_line(f"note: {remark}") for remark in diagnosis.remarks]
    parts += [_line(line) for line in left_out_lines([r.as_dict() for r in diagnosis.left_out], SHOWN)]
    then: list[RenderableType] = []
    if diagnosis.next_measurement:
        parts += [_title("measure next, by expected information"), _candidates(additions_by_gain(diagnosis))]
        files = [(c["name"], c["file"], c["gain_bit"]) for c in result["next_measurement"] if c["file"]]
        parts += [_line(f"- {name}: {file}") for name, file, _ in files]
        worth = [file for _, file, gain_bit in files if gain_bit >= WORTH_MEASURING_BIT]
        if worth:
            then.append(_line(_measure_line(worth[0], measure_with)))
    if result["twin"] is not None:
        parts += _twin(result["twin"])
    if result["pictures"]:
        parts.append(_line(f"\npictures: {', '.join(result['pictures'].values())}"))
    return Group(*parts, *then)  # a command to be typed stands last


def _measure_line(file: str, measure_with: str | None) -> str:
    if file.endswith(".csv"):
        return f"to measure it: visit the rows of {file}, and append them with what was read to coordinates.csv"
    if measure_with is None:
        return f"to measure it: `pkm-rig measure --campaign {shlex.quote(file)}`, with the campaign's rig file as --rig"
    return f"next: {measure_with} {shlex.quote(file)}"


def _line(content: str) -> Text:
    return Text(content, no_wrap=False)


def _title(content: str) -> Text:
    return Text(f"\n{content}", style="bold")


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, left: int) -> Padding:
    """Columns after the first `left` ones are numbers."""
    table = Table(box=None, pad_edge=False)
    for number, column in enumerate(columns):
        table.add_column(column, justify="left" if number < left else "right", overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    return Padding(table, (0, 0, 0, 2))


def _effects(effects: Sequence[FoundEffect]) -> Padding:
    rows = []
    for effect in effects:
        for number, at in enumerate(effect.places):
            named = (effect.effect, at.place or "whole rig") if number == 0 else ("", at.place)
            sure = (
                probability(effect.probability) if number == 0 else "",
                probability(at.probability) if at.place else "",
            )
            size = f"{quantity_name(at.size)} = {format_quantity(at.size)}"
            rows.append((*named, size, *sure, f"{at.raw_sigma:.1f}", f"{at.visible_sigma:.1f}"))
            rows += [("", "", f"{quantity_name(q)} = {format_quantity(q)}", "", "", "", "") for q in at.others]
            rows += [("", "", _at_channel(q), "", "", "", "") for q in at.at_channels]
            if at.aliases:
                rows.append(("", "", _aliased(at.aliases), "", "", "", ""))
            if at.differs_with:
                rows.append(("", "", _differs(at.differs_with), "", "", "", ""))
    columns = (
        "effect",
        "place",
        f"size +- U (k = {COVERAGE_FACTOR:g})",
        "prob.",
        "of place",
        "raw",
        "visible",
    )
    return _table(columns, rows, left=3)


def _at_channel(quantity: Quantity) -> str:
    """What an effect does there, RMS over the readings that respond: the same whatever the effect calls its size."""
    meaning = MEANINGS.get(quantity.name)
    return f"at {quantity.name}{f' ({meaning})' if meaning else ''}: {format_quantity(quantity)} RMS"


def _aliased(periods_m: Sequence[float]) -> str:
    return f"or a period of {', '.join(f'{1e3 * period:.4g}' for period in periods_m)} mm: positions do not tell"


def _differs(coordinates: Sequence[str]) -> str:
    if len(coordinates) > FEW_COORDINATES:
        return "differs a little with all that varies"
    return f"differs with {', '.join(coordinates)}"


def _gap(gap: GapFigures) -> list[RenderableType]:
    low, high = gap.shrink_interval
    return [
        _line(f"before {length(gap.before_m)}, after {length(gap.after_m)}, noise floor {length(gap.noise_floor_m)}"),
        _line(f"shrink {percent(gap.shrink)} (95 %: {percent(low)} to {percent(high)}); withheld: {gap.withheld}"),
    ]


def _twin(twin: Mapping[str, Any]) -> list[RenderableType]:
    """Comparison of the campaign with its simulation on the twin."""
    added = " and ".join(dict.fromkeys(twin["effects"])) or "no effect: none was found"
    shrink = twin["shrink"]
    lines = [
        f"twin: the identified model with {added}: {twin['folder']}",
        f"campaign simulated on twins built without each region's readings, compared with the {twin['readings']} "
        f"that were recorded there: missed by {_length(twin['after_m'])} RMS, without the effect by "
        f"{_length(twin['before_m'])}, shrink {'not known' if shrink is None else percent(shrink)} (noise included: "
        f"{twin['after_sigma']:.2f} and {twin['before_sigma']:.2f} sigma)",
        f"each number read, beside what machine and twin predict: {twin['predictions']}"
        if "predictions" in twin
        else f"serve it: pkm-rig mock --rig RIG.toml --twin {twin['folder']}",
    ]
    return [_title("the rig's twin"), *(_line(line) for line in lines)]


def _length(value_m: float | None) -> str:
    return length(math.nan if value_m is None else value_m)


def _shares(where: Sequence[Share]) -> Padding:
    rows = [(s.kind, s.name, percent(s.share), f"{percent(s.low)} to {percent(s.high)}") for s in where]
    return _table(("over", "which", "share", "95 %"), rows, left=2)


def _candidates(candidates: Sequence[CampaignAddition]) -> Padding:
    rows = [
        (c.name, c.adds, ", ".join(c.settles), f"{c.minutes:.0f}", f"{c.gain_bit:z.2f}", f"{c.gain_bit_per_min:z.3f}")
        for c in candidates
    ]
    return _table(("candidate", "adds", "settles", "min", "bit", "bit/min"), rows, left=3)


def percent(share: float) -> str:
    """A share in per cent."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else "not known"


def probability(p: float) -> str:
    """A probability that never rounds to certainty."""
    if not math.isfinite(p):
        return "not known"
    return "> 0.999" if p > 0.999 else "< 0.001" if p < 0.001 else f"{p:.3f}"


def length(value_m: float) -> str:
    """A length in micrometres."""
    return f"{value_m * 1e6:.1f} um" if math.isfinite(value_m) else "not known"


def quantity_name(quantity: Quantity) -> str:
    """Its name without its unit, which stands with the number."""
    return quantity.name.removesuffix("_" + quantity.unit.lower().replace("/", "_per_"))


def format_quantity(quantity: Quantity) -> str:
    """A quantity with its expanded uncertainty, in a unit that suits its size."""
    if not math.isfinite(quantity.value):
        return "not known"
    divisor, unit = unit_that_suits(quantity)
    unit = f" {unit}" if unit else ""
    value, expanded = quantity.value / divisor, COVERAGE_FACTOR * quantity.u / divisor
    if not math.isfinite(expanded) or expanded <= 0.0:
        return f"{plain_number(value, 4)}{unit}"
    return f"{' +- '.join(round_result(value, expanded))}{unit}"


def unit_that_suits(quantity: Quantity) -> tuple[float, str]:
    """The unit in which a quantity is shown, in SI units, and its name: empty for a plain number."""
    divisor, prefix = 1.0, ""
    magnitude = max(abs(quantity.value), COVERAGE_FACTOR * quantity.u)
    if quantity.unit.partition("/")[0] in PREFIXED and math.isfinite(magnitude) and magnitude > 0.0:
        divisor, prefix = next((p for p in PREFIXES if magnitude >= p[0]), PREFIXES[-1])
    ratio, _, per = quantity.unit.partition("/")
    if ratio == "1" and 0.0 < magnitude < LARGEST_PPM:
        return 1e-6, f"ppm/{per}" if per else "ppm"
    return divisor, "" if quantity.unit in ("", "1") else f"{prefix}{quantity.unit}"


def diagnosis_line(attempt: DiagnosisAttempt) -> str:
    """The diagnosis within a calibration in one line."""
    return f"diagnosis: {attempt.failure if attempt.diagnosis is None else one_line_summary(attempt.diagnosis)}"
