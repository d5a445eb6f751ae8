"""What a reader of a diagnosis has to know beside its figures, a line each."""

from __future__ import annotations

from collections.abc import Sequence

from calibration.diagnosis.few_visits import AtFewVisits
from calibration.diagnosis.level_posterior import COLUMNS
from calibration.diagnosis.levels_and_causes import TOLD_BY_FORM, LevelsAndCauses, ToldByForm
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.diagnosis.ranking import Cause
from calibration.diagnosis.result import FEW_COORDINATES, NONE, UNKNOWN, GapFigures
from calibration.diagnosis.search import SearchResult
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import MIN_RATIO_TO_DECLARED
from calibration.recording.header import DisturbanceLevels
from calibration.reduction.part_temperatures import remarks_on_sensors

INEXACT = 10.0  # excess log evidence from which on a remark says that the effect's model is not exact
MOST_LISTED = 4  # names in a remark
MUCH = 2.0  # times the stated level of a disturbance
BEYOND = 1.5  # times the tolerances
SCATTERS = 1.1  # times the stated standard deviations of the readings


def remarks(
    linear: LinearisedReadings,
    stated: DisturbanceLevels,
    found: LevelsAndCauses,
    verdict: str,
    noise_floor_m: float | None,
    gap: GapFigures,
) -> tuple[str, ...]:
    """Effects with which the readings are predicted worse, readings that are far off and were kept, sensors of
    temperature that scatter or were off, disturbances and
    errors of geometry larger than stated, a machine that does not repeat, effects that are no larger than these may be,
    what limits the verdict, and what was not tried."""
    here, search_result = linear.levels, found.result
    return (
        *_predicts_worse(search_result, verdict, gap),
        *_far_off(linear),
        *remarks_on_sensors(linear.sensors),
        *_stronger_disturbances(stated, here),
        *_beyond_tolerances(found.times_tolerances),
        *_more_scatter(found.times_scatter),
        *_does_not_repeat(found.positioning_sd_m),
        *_kept_for_its_form(found.told_by_form),
        *_of_verdict(search_result, verdict, noise_floor_m),
        *_cut_for_time(found),
        *_as_many_as_are_looked_for(search_result),
    )


def _predicts_worse(search_result: SearchResult, verdict: str, gap: GapFigures) -> tuple[str, ...]:
    """That what was found explains the readings it was fitted to, and no others."""
    if verdict in (NONE, UNKNOWN) or not gap.grows:
        return ()
    names = list(dict.fromkeys(cause.effect.name for cause in search_result.causes))
    return (
        f"with {_listed(names)} withheld readings are predicted worse than without, from a gap of "
        f"{1e6 * gap.before_m:.1f} to {1e6 * gap.after_m:.1f} um: do not add {'them' if len(names) > 1 else 'it'} to "
        "the model",
    )


def _far_off(linear: LinearisedReadings) -> tuple[str, ...]:
    """How many readings are how far off, where they are too many to be left out."""
    off = linear.far_off
    if not off.size:
        return ()
    return (
        f"{off.size} of {len(linear.residual)} readings are {off.min():.0f} to {off.max():.0f} standard deviations off "
        "what all others say: too many to be left out as wrong, so they were kept; unless an effect that is named "
        "explains them, check reflectors, nests and lines of sight, and measure again",
    )


def _stronger_disturbances(stated: DisturbanceLevels, here: DisturbanceLevels) -> tuple[str, ...]:
    """Disturbances that are much stronger than declared, or than the default."""
    stronger = []
    for key in COLUMNS:
        level, expected = getattr(here, key), getattr(stated, key)
        if level > MUCH * expected:
            said = "declared" if key in stated.model_fields_set else "the default"
            stronger.append(f"{key} = {level:.2g} ({said}: {expected:.2g})")
    return (f"stronger disturbances than stated: {', '.join(stronger)}",) if stronger else ()


def _beyond_tolerances(times: float) -> tuple[str, ...]:
    if times < BEYOND:
        return ()
    return (
        f"the machine's geometry is off by more than its tolerances, most likely {times:.1f} times as much: state "
        "larger ones in the machine file, or check its nominal values",
    )


def _more_scatter(times: float) -> tuple[str, ...]:
    if times < SCATTERS:
        return ()
    return (f"the readings scatter {times:.2f} times as much as stated: state the instrument's accuracy as it is",)


def _does_not_repeat(sd_m: float) -> tuple[str, ...]:
    return (does_not_repeat(sd_m),) if sd_m > 0.0 else ()


def does_not_repeat(sd_m: float) -> str:
    """Of a machine whose drives stand off with a standard deviation in m."""
    return (
        f"the machine does not repeat better than {1e6 * sd_m:.1f} um: by that standard deviation its drives "
        "stand off anew at each visit, whatever they report, and no calibration takes that away"
    )


def _kept_for_its_form(told: ToldByForm | None) -> tuple[str, ...]:
    """Effects that are small enough for a disturbance and were kept all the same."""
    if told is None:
        return ()
    return (
        f"{_listed(told.names)}: less than {MIN_RATIO_TO_DECLARED:g} times what an ordinary disturbance may do (95 % "
        f"point of its level), and kept only because the form tells it from one ({told.log_posterior:.0f} of log "
        f"posterior over disturbances alone, {TOLD_BY_FORM:.0f} needed)",
    )


def _of_verdict(search_result: SearchResult, verdict: str, noise_floor_m: float | None) -> tuple[str, ...]:
    out = []
    if noise_floor_m is None:
        out.append(
            "no target was visited three times alike: the noise floor is what the fullest model leaves of the readings"
        )
    is_effect = verdict not in (NONE, UNKNOWN)
    if is_effect and search_result.excess_log_evidence > INEXACT:
        out.append(
            f"the effect's form is not exact: {_left_over(search_result)} "
            f"({search_result.excess_log_evidence:.0f} of log evidence, {search_result.log_evidence:.0f} explained)"
        )
    elif is_effect and _gain_that_counts(search_result) > INEXACT:
        out.append(f"the effect's form is not exact: {_departs(search_result)}")
    first = next(iter(search_result.non_parametric_alone), None)
    if isinstance(first, AtFewVisits) and verdict != NONE:
        out.append(_at_few_visits(first, certain=verdict == UNKNOWN))
    elif verdict == UNKNOWN and search_result.causes and search_result.non_parametric:
        most_alike = search_result.ranking[0]
        out.append(
            f"most like {_named(most_alike)} ({most_alike.log_evidence:.0f} of log evidence alone), but "
            f"{_why_not(search_result)}"
        )
    elif verdict == UNKNOWN and search_result.non_parametric:
        out.append(_nearest(search_result))
    if is_effect and (names := list(dict.fromkeys(c.effect.name for c in search_result.causes if c.alike))):
        out.append(
            f"{_listed(names)}: at all places of its kind alike, which says more than each of them by itself; a size "
            "at one place leans on the others'"
        )
    if is_effect and not any(cause.effect.name == verdict for cause in search_result.causes):
        out.append("the most probable single effect is not among those that together explain most")
    return tuple(out)


def _at_few_visits(found: AtFewVisits, *, certain: bool) -> str:
    """When what is off, and that nothing else is."""
    return (
        f"{'' if certain else 'about as likely: '}{elsewhere(found)} "
        f"({found.log_evidence:.0f} of log evidence), and at all others nothing is: see what happened then"
    )


def elsewhere(found: AtFewVisits) -> str:
    """At which visits what is off, and by how much."""
    one, visits = len(found.visits) == 1, ", ".join(map(str, found.visits))
    farthest = 1e6 * max(map(abs, found.off))
    return (
        f"at visit{'' if one else 's'} {visits} alone something is elsewhere, "
        f"most likely {found.channel} by {'' if one else 'up to '}{farthest:.0f} u{found.unit}"
    )


def _nearest(search_result: SearchResult) -> str:
    """The effect that comes nearest where none has enough evidence to be a cause, and how much it lacks."""
    alternative = search_result.non_parametric[0]
    other = f"an arbitrary function of {alternative.coordinate} at {alternative.channel} explains"
    nearest = search_result.ranking[0] if search_result.ranking else None
    if nearest is None or nearest.log_evidence <= 0.0:
        return f"nothing in the catalogue explains any of it; {other} {alternative.log_evidence:.0f} of log evidence"
    lacks = max(VERDICT.detection_threshold - nearest.log_evidence, 0.0)
    return (
        f"nearest comes {_named(nearest)} ({nearest.log_evidence:.1f} of log evidence), which lacks {lacks:.1f} to "
        f"count as a cause; {other} {alternative.log_evidence:.0f}"
    )


def _why_not(search_result: SearchResult) -> str:
    """What speaks against the causes that were found: what remains, or how far they depart from their forms."""
    if _gain_that_counts(search_result) > search_result.excess_log_evidence:
        return _departs(search_result)
    return f"{_left_over(search_result)} ({search_result.excess_log_evidence:.0f} more)"


def _gain_that_counts(search_result: SearchResult) -> float:
    return VERDICT.departure_share * search_result.departure_gain


def _left_over(search_result: SearchResult) -> str:
    """The alternative that explains more: in addition to the causes, or without any."""
    remaining, alone = search_result.non_parametric[0], search_result.non_parametric_alone
    if alone and alone[0].log_evidence - search_result.log_evidence > remaining.log_evidence:
        return f"an arbitrary function of {alone[0].coordinate} at {alone[0].channel} alone explains more"
    return f"something at {remaining.channel} that depends on {remaining.coordinate} remains"


def _departs(search_result: SearchResult) -> str:
    """How far the causes depart from their forms, and the farthest of them."""
    farthest = max(search_result.causes, key=lambda cause: cause.departure_gain)
    many = len(farthest.differs_with) > FEW_COORDINATES
    coordinates = "all that varies" if many else " and ".join(farthest.differs_with)
    return (
        f"{_named(farthest)} has to depart far from its form, with {coordinates} "
        f"(departures add {search_result.departure_gain:.0f} of the {search_result.log_evidence:.0f} of log evidence "
        "that are explained)"
    )


def _named(cause: Cause) -> str:
    return f"{cause.effect.name} at {cause.place}" if cause.place else cause.effect.name


def _cut_for_time(found: LevelsAndCauses) -> tuple[str, ...]:
    """What the search did not try, to save time, in one line; nothing where it tried all."""
    search_result = found.result
    cut, included = [], {cause.effect.name for cause in search_result.causes}
    # What was included is refined beside the other causes.
    ranked = [cause.effect.name for cause in search_result.ranking if cause.unrefined]
    if names := [name for name in ranked if name not in included]:
        cut.append(
            f"of {_listed(names)} neither departures from the form nor nonlinear laws nor further places were tried: "
            f"less than {100.0 * VERDICT.refined_share:.0f} % of the strongest's log evidence (diagnose --thorough "
            "tries them)"
        )
    if names := [name for name in search_result.not_begun_with if name not in included]:
        cut.append(
            f"no search for several causes began with {_listed(names)}: {VERDICT.leaders} stronger ones did (diagnose "
            "--thorough begins with these too)"
        )
    if names := [name for name in found.left_out if name not in included]:
        cut.append(
            f"no search began with {_listed(names)}: others had taken long enough (diagnose --thorough makes these too)"
        )
    return (f"to save time {'; '.join(cut)}",) if cut else ()


def _as_many_as_are_looked_for(search_result: SearchResult) -> tuple[str, ...]:
    """That there may be more causes, which no time would have found."""
    if len({cause.effect.name for cause in search_result.causes}) < VERDICT.max_causes:
        return ()
    return (f"no more than {VERDICT.max_causes} causes are looked for: there may be others",)


def _listed(names: Sequence[str]) -> str:
    """Names in words: a, b and c; of many the first few and how many more."""
    if len(names) > MOST_LISTED:
        return f"{', '.join(names[: MOST_LISTED - 1])} and {len(names) - MOST_LISTED + 1} more"
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
