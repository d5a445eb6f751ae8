"""Makes one recording: draws again until each of its effects has a size that can be seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.independent.pack import write_case
from benchmarks.other_simulator.archives import Case
from benchmarks.other_simulator.effects import WANTED, Effect, bring_to_size, draw_effect
from benchmarks.other_simulator.forms.catalogue import FIRST
from benchmarks.other_simulator.plan import BIDIRECTIONAL, ONE_WAY, RANDOMISED
from benchmarks.other_simulator.recording_files import recording_files
from benchmarks.other_simulator.rig import Rig, draw_rig
from benchmarks.other_simulator.sizes import Size, Sizes

ATTEMPTS = 40
STYLES = {RANDOMISED: 0.6, BIDIRECTIONAL: 0.25, ONE_WAY: 0.15}
OF_SIDES = ("backlash", "friction_windup")  # not seen where all drives always come from below
FOLLOWING_SHARES, STREAM_OF_SHARES = [1.0, 0.1], 7

Sized = tuple[Effect, float, Size]  # with amplitude and sizes


class NoRecording(RuntimeError):
    """No draw gave a recording; one line."""


def make_case(case: Case, cases: Path) -> str:
    """Write a recording and its truth below `cases`; its name. The same bytes for the same case.

    Raises NoRecording.
    """
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([case.seed, attempt])
        try:
            rig = _draw(case, attempt, rng)
            sized = _draw_effects(rig, case, rng)
        except np.linalg.LinAlgError:  # a machine that falls apart
            continue
        if sized is None:
            continue
        amplitudes = [(effect, amplitude) for effect, amplitude, _ in sized]
        files, noise_free_m = recording_files(rig, case.name, amplitudes, rng)
        arrays = {"clean_m": noise_free_m, "platform": rig.rows.on_platform}
        write_case(cases / case.name, files, _entry(rig, case, sized), arrays)
        return case.name
    raise NoRecording(f"{ATTEMPTS} draws gave no recording {case.name} of archive {case.archive}")


def _draw(case: Case, attempt: int, rng: np.random.Generator) -> Rig:
    """A rig with a campaign that may show the effects."""
    names = [effect for effect, _ in case.effects]
    styles = dict(STYLES)
    if "latency" in names:
        styles = {RANDOMISED: 1.0}  # the only one with readings on the fly
    elif any(effect in OF_SIDES or "side" in form for effect, form in case.effects):
        del styles[ONE_WAY]
    shares = np.array(list(styles.values()))
    style = str(rng.choice(list(styles), p=shares / shares.sum()))
    following_share = 1.0
    if case.archive != FIRST:  # half of the later machines have velocity fed forward
        own = np.random.default_rng([case.seed, attempt, STREAM_OF_SHARES])
        following_share = float(own.choice(FOLLOWING_SHARES))
    return draw_rig(case.base, style, rng, following_share=following_share, fine_ranges="refraction" in names)


def _draw_effects(rig: Rig, case: Case, rng: np.random.Generator) -> list[Sized] | None:
    """The effects, each of a size by itself; None if one cannot have it."""
    sizes, out = Sizes(rig), []
    for name, form in case.effects:
        effect = draw_effect(rig, name, form, rng)
        wanted = float(np.exp(rng.uniform(*np.log(WANTED))))
        reached = bring_to_size(rig, sizes, effect, wanted)
        if reached is None:
            return None
        out.append((effect, *reached))
    return out


def _entry(rig: Rig, case: Case, sized: list[Sized]) -> dict[str, Any]:
    """What the table of truths says of a recording."""
    return {
        "kind": case.kind,
        "campaign": rig.rows.style,
        "disturbances": rig.levels.label,
        "sigma_m": rig.sigma_m,
        "effects": [_fact(*one) for one in sized],
    }


def _fact(effect: Effect, amplitude: float, size: Size) -> dict[str, Any]:
    times = {"step_s": effect.step_s, "period_m": effect.period_m}
    return {
        "effect": effect.name, "form": effect.form.name, "places": [] if effect.of_rig else effect.places,
        "raw_sigma": size.raw, "visible_sigma": size.visible,
        "raw_platform_sigma": size.raw_platform, "visible_platform_sigma": size.visible_platform,
        "size": float(amplitude), **{name: value for name, value in times.items() if value is not None},
    }  # fmt: skip
