"""Makes one case: draws what is wrong with a fresh machine, carries the campaign out, keeps the truth beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.withheld.cases import DECLARED, PROFILES, Slot
from benchmarks.withheld.designs import MACHINE, Designs, Drawn
from benchmarks.withheld.gross_readings import with_gross_readings
from benchmarks.withheld.sizes import noise_free, raw_of
from mock_devices.effects import CATALOGUE, SPECS, EffectChoice, EffectError, draw
from mock_devices.effects.base import names_of
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.recordings.effect_size import SizeScale
from mock_devices.recordings.maker import MockRecording, SimulatedCampaign

Array = NDArray[np.float64]

SMALL = "small"
SMALL_SHARE = 0.6
EXCEEDS = 3.0  # a case that is to be found exceeds the nuisance by so much (docs/reference/definitions.md)
ELIGIBLE_RAW, ELIGIBLE_VISIBLE = 2.98, 0.5
MOST_DRAWS = 16
MOST_GROSS = 6
ALL_PLACES, ALIKE, EQUAL = 0.5, 0.6, 0.5  # shares of the effects that have several places
LEAST_SHARE = 0.4  # of the size at one of several places
STYLES = {"platform_only": "platform", "next": "poor"}
PERIODIC = {"screw_periodic_error": "period_m", "encoder_interpolation": "pitch_m"}
TIMES_A_PERIOD = {  # how often an error repeats within the period of what errs
    "screw_periodic_error/universal_joint": 2,
    "screw_periodic_error/torque_ripple": 6,
    "encoder_interpolation/amplitude": 2,
    "encoder_interpolation/shadow_gratings": 4,
    "encoder_interpolation/self_images": 4,
    "encoder_interpolation/few_bits": 16,
    "encoder_interpolation/twisted_grating": 2,
    "encoder_interpolation/lifted_head": 2,
}


@dataclass(frozen=True)
class Case:
    """A case with its truth.

    recording: what is diagnosed; clean: the same without gross readings. truth: plain data; noise_free_m (r, 3): the
    readings of the plant without noise, station's frame; change_m (r, 3): shifts by the effects, machine's axes.
    """

    slot: Slot
    drawn: Drawn
    bench: SimulatedCampaign
    recording: MockRecording
    clean: MockRecording
    truth: dict[str, Any]
    noise_free_m: Array
    change_m: Array
    without: tuple[str, ...]

    def changes_by_effect(self) -> list[tuple[str, str, Array]]:
        """Name, place ('' for the rig) and change (r, 3) of the readings, machine's axes, of each effect alone.

        An effect at several places is one at each of them: what a form explains at one is asked for at one.
        """
        choices = self.bench.settings.effects
        if len(choices) == 1:
            return [(choices[0].name, place_of(choices[0]), self.change_m)]
        alone = SizeScale(self.bench)
        return [(choice.name, place_of(choice), alone.change_m(choice)) for choice in choices]


def make_case(slot: Slot, rng: np.random.Generator, designs: Designs, *, final: bool | None) -> Case:
    """Draw and carry out one case. `final` as in `mock_devices.effects.draw`."""
    drawn = designs.one(slot.style or STYLES.get(slot.kind, "rich"), rng)
    # What a poor design cannot show is sized on a rich one.
    sized = designs.one("rich", rng) if slot.kind == "next" else drawn
    for _ in range(MOST_DRAWS):
        seed = int(rng.integers(2**31))
        profile, scale, nuisance_raw = _rig(slot, rng, sized, seed)
        effects = _effects(slot, rng, sized, scale, final=final)
        if effects is None:
            if slot.style:  # what cannot be at all on this design, as a payload's effect without payload
                drawn = sized = designs.one("rich", rng)
            continue
        choices, facts = effects
        try:
            return _carry_out(slot, rng, drawn, sized, choices, facts, (seed, profile, nuisance_raw))
        except NoEquilibrium:  # two effects together can be too much
            continue
    raise EffectError(f"case {slot.key}: {MOST_DRAWS} draws gave nothing that the machine can stand")


def _rig(slot: Slot, rng: np.random.Generator, drawn: Drawn, seed: int) -> tuple[str, SizeScale, float]:
    """Profile, sizes and the nuisance's own raw size of a fresh rig; a loud nuisance is not given to a small effect."""
    profile = slot.profile
    if not profile:
        profile = SMALL if rng.random() < SMALL_SHARE else str(rng.choice(list(PROFILES)))
    for name in (profile, SMALL):
        bench = drawn.bench(seed, PROFILES[name])
        loud = raw_of(bench, bench.points_m() - bench.points_m([]))
        if not slot.raw or loud * EXCEEDS <= min(slot.raw):
            break
    return name, SizeScale(bench), loud


def _effects(
    slot: Slot, rng: np.random.Generator, drawn: Drawn, scale: SizeScale, *, final: bool | None
) -> tuple[tuple[EffectChoice, ...], list[dict[str, Any]]] | None:
    """Choices of the wanted raw sizes, redrawn until they can be seen where the slot is to be found."""
    wanted_visible = 1.0 if slot.kind in ("removed", "next") else ELIGIBLE_VISIBLE
    chosen: list[EffectChoice] = []
    facts: list[dict[str, Any]] = []
    for name, raw in zip(slot.effects, slot.raw, strict=True):
        best: tuple[float, tuple[EffectChoice, ...], dict[str, Any]] | None = None
        for _ in range(MOST_DRAWS):
            choices = _at_places(slot, name, drawn, rng, final=final)
            if any(_same_strut(choice, other) for choice in choices for other in chosen):
                continue
            try:
                choices = scale.scaled_together(choices, raw)
                change = scale.change_m(*choices)
            except (EffectError, NoEquilibrium):
                continue
            visible = drawn.visible.visible_size_of_change(change)
            size = SPECS[name].size
            plausible = all(size.low <= choice.size <= size.high for choice in choices)
            rank = visible if plausible else -1.0 / (1.0 + visible)
            if best is None or rank > best[0]:
                best = rank, choices, fact(*choices, drawn=drawn, raw=scale.raw_size(*choices), visible=visible)
            if plausible and (raw < ELIGIBLE_RAW or visible >= wanted_visible):
                break
        if best is None:
            return None
        chosen += best[1]
        facts.append({**best[2], "plausible": best[0] >= 0.0})
    return tuple(chosen), facts


def _at_places(
    slot: Slot, name: str, drawn: Drawn, rng: np.random.Generator, *, final: bool | None
) -> tuple[EffectChoice, ...]:
    """An effect at a drawn place, or one variant of it at several: at two or at all, alike or each with its own
    constants, at each by a share of its own."""
    machine = drawn.timeline.machine
    first = draw(name, machine, rng, final=final, duration_s=drawn.duration_s, among=slot.variants)
    if not slot.several:
        return (first,)
    places = names_of(machine, SPECS[name].place)
    count = len(places) if rng.random() < ALL_PLACES else 2
    alike, equal = rng.random() < ALIKE, rng.random() < EQUAL
    if SPECS[name].place == "smr":  # all reflectors that move alike are a platform that moves
        count, alike = 2, False
    out = []
    for k in sorted(rng.choice(len(places), count, replace=False).tolist()):
        own = first if alike else draw(
            name, machine, rng, final=None, duration_s=drawn.duration_s, among=(first.variant,)
        )  # fmt: skip
        share = 1.0 if equal else rng.uniform(LEAST_SHARE, 1.0)
        out.append(replace(own, place=places[k], size=first.size * share))
    return tuple(out)


def place_of(choice: EffectChoice) -> str:
    """Where an effect acts, '' for the rig."""
    return "" if SPECS[choice.name].place == "rig" else choice.place


def _same_strut(a: EffectChoice, b: EffectChoice) -> bool:
    """Two force laws on one strut are more than the plant can do."""
    return SPECS[a.name].place == SPECS[b.name].place == "strut" and a.place == b.place


def fact(choice: EffectChoice, *others: EffectChoice, drawn: Drawn, raw: float, visible: float) -> dict[str, Any]:
    """A true effect as plain data, with its `others` at further places; onset_s since the first reading, period_m of
    the error itself, as parameters, those of the first place."""
    spec = SPECS[choice.name]
    values = {p.name: p.typical for p in spec.others} | dict(choice.parameters)
    places = [place_of(one) for one in (choice, *others)]
    out: dict[str, Any] = {
        "effect": choice.name,
        "place": places[0] if not others else "",
        "places": [place for place in places if place],
        "variant": choice.variant,
        "final": spec.final_only or choice.variant == spec.final,
        "size_name": spec.size.name,
        "size": choice.size,
        "parameters": values,
        "seed": choice.seed,
        "raw": raw,
        "visible": visible,
    }
    timeline = drawn.timeline
    if any(other.parameters != choice.parameters for other in others):
        return out  # at each place another onset or period
    if "onset_s" in values:
        out["onset_s"] = timeline.design.start_s + values["onset_s"] - float(timeline.t_s[0])
    if parameter := PERIODIC.get(choice.name):
        out["period_m"] = values[parameter] / TIMES_A_PERIOD.get(f"{choice.name}/{choice.variant}", 1)
    return out


def _carry_out(
    slot: Slot, rng: np.random.Generator, drawn: Drawn, sized: Drawn, choices: tuple[EffectChoice, ...],
    facts: list[dict[str, Any]], rig: tuple[int, str, float],
) -> Case:  # fmt: skip
    seed, profile, nuisance_raw = rig
    settings = replace(drawn.settings(seed, PROFILES[profile]), effects=choices)
    bench = SimulatedCampaign(MACHINE, settings, drawn.timeline)
    clean = _as_declared(bench.record(), slot.declared)
    recording = _with_gross_readings(clean, rng) if slot.gross else clean
    without_effects = drawn.bench(seed, PROFILES[profile])
    change = (bench.points_m() - without_effects.points_m()) @ bench.view.rotation
    truth = {
        "key": slot.key,
        "kind": slot.kind,
        "design": drawn.name,
        "sized_on": sized.name,
        "seed": seed,
        "profile": profile,
        "nuisance": vars(PROFILES[profile]),
        "nuisance_raw": nuisance_raw,
        "declared": slot.declared,
        "gross": slot.gross,
        "wanted_raw": list(slot.raw),
        "effects": facts,
        "raw": raw_of(bench, change, turned=True),
        "visible": drawn.visible.visible_size_of_change(change),
        "eligible": bool(facts) and all(
            f["raw"] >= ELIGIBLE_RAW and f["visible"] >= ELIGIBLE_VISIBLE and f["plausible"] for f in facts
        ),
        "turn": bench.view.rotation.tolist(),
    }  # fmt: skip
    without = _without(slot, rng)
    truth["without"] = list(without)
    return Case(
        slot=slot,
        drawn=drawn,
        bench=bench,
        recording=recording,
        clean=clean,
        truth=truth,
        noise_free_m=noise_free(bench),
        change_m=change,
        without=without,
    )


def _as_declared(recording: MockRecording, declared: str) -> MockRecording:
    """The recording with levels of disturbances in its header that may not be those of its rig."""
    factor = DECLARED[declared]
    header = {key: value for key, value in recording.header.items() if key != "nuisance" or factor is not None}
    if factor is not None:
        header["nuisance"] = {name: factor * level for name, level in recording.header["nuisance"].items()}
    return replace(recording, header=header)


def _with_gross_readings(recording: MockRecording, rng: np.random.Generator) -> MockRecording:
    count = int(rng.integers(1, MOST_GROSS + 1))
    return replace(recording, columns=with_gross_readings(recording.columns, count, rng))


def _without(slot: Slot, rng: np.random.Generator) -> tuple[str, ...]:
    if slot.kind == "removed":
        return slot.effects
    if slot.decoy:
        others = [name for name in CATALOGUE if name not in slot.effects]
        return (str(rng.choice(others)),)
    return ()
