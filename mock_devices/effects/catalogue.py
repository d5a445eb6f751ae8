"""All effects by name, and how a choice of one becomes physics."""

from __future__ import annotations

import math
from collections.abc import Collection
from difflib import get_close_matches

import numpy as np

from mock_devices.effects import (
    control,
    drive_scale,
    drive_train,
    expansion,
    foundation,
    friction_windup,
    geometry,
    guides,
    instrument,
    interpolation,
    ordinary_disturbances,
    outside,
    outside_bearings_hoses,
    outside_contacts,
    outside_counters,
    outside_faces_gears,
    outside_final,
    outside_further,
    outside_hooks_floors,
    outside_magnets_ways,
    outside_memories,
    outside_motions,
    outside_parts,
    outside_published,
    outside_station,
    payload,
    reseat,
    reversal,
    servo_settling,
    structure,
    tables_left_on,
    thermal,
)
from mock_devices.effects.base import Effect, EffectArguments, EffectChoice, EffectSpec, Site, names_of
from mock_devices.machine_file import MachineFile
from mock_devices.seeds import generator

SPECS: dict[str, EffectSpec] = {
    spec.name: spec
    for module in (
        thermal,
        reversal,
        friction_windup,
        structure,
        geometry,
        drive_train,
        interpolation,
        guides,
        foundation,
        instrument,
        reseat,
        control,
        servo_settling,
        expansion,
        payload,
        tables_left_on,
        drive_scale,
        outside,
        outside_published,
        outside_parts,
        outside_motions,
        outside_further,
        outside_station,
        outside_bearings_hoses,
        outside_contacts,
        outside_memories,
        outside_counters,
        outside_magnets_ways,
        outside_hooks_floors,
        outside_faces_gears,
        outside_final,
        ordinary_disturbances,
    )
    for spec in module.EFFECTS
}
CATALOGUE = tuple(name for name, spec in SPECS.items() if spec.kind == "catalogue")
GEOMETRY = tuple(name for name, spec in SPECS.items() if spec.kind == "geometry")
OUTSIDE = tuple(name for name, spec in SPECS.items() if spec.kind == "outside" and not spec.final_only)
OUTSIDE_FINAL = tuple(name for name, spec in SPECS.items() if spec.kind == "outside" and spec.final_only)


class EffectError(ValueError):
    """An effect that does not exist or a value that cannot be; one line."""


def spec_of(name: str) -> EffectSpec:
    """The entry of a name; raises EffectError."""
    try:
        return SPECS[name]
    except KeyError:
        near = get_close_matches(name, SPECS, n=1)
        meant = f"is '{near[0]}' meant? " if near else ""
        raise EffectError(f"unknown effect '{name}'; {meant}docs/reference/mock-effects.md has all") from None


def check(choice: EffectChoice, machine: MachineFile, *, any_size: bool = False) -> EffectSpec:
    """The entry of a choice if all it says can be; raises EffectError. Size zero is allowed: no effect."""
    spec = spec_of(choice.name)
    places = names_of(machine, spec.place)
    if choice.place and choice.place not in places:
        raise EffectError(f"effect {spec.name}: no {spec.place} '{choice.place}'; known: {', '.join(places)}")
    if choice.variant and choice.variant not in spec.variants:
        raise EffectError(f"effect {spec.name}: no variant '{choice.variant}'; known: {', '.join(spec.variants)}")
    known = {parameter.name: parameter for parameter in spec.others}
    for name, value in ((spec.size.name, choice.size), *choice.parameters):
        parameter = spec.size if name == spec.size.name else known.get(name)
        if parameter is None:
            raise EffectError(f"effect {spec.name}: no parameter '{name}'; known: {', '.join(known) or 'none'}")
        free = parameter is spec.size and (any_size or value == 0.0)
        if not math.isfinite(value) or value < 0.0 or not (free or parameter.low <= value <= parameter.high):
            raise EffectError(
                f"effect {spec.name}: {name} = {value:g} is out of range {parameter.low:g} to {parameter.high:g}"
            )
    return spec


def make(choice: EffectChoice, site: Site, seed: int) -> Effect:
    """The physics of a choice on a rig. Sizes beyond the plausible range are allowed here: scaling may need them."""
    spec = check(choice, site.machine, any_size=True)
    places = list(names_of(site.machine, spec.place))
    values = {parameter.name: parameter.typical for parameter in spec.parameters} | dict(choice.parameters)
    values[spec.size.name] = choice.size
    values = {parameter.name: values[parameter.name] for parameter in spec.parameters}  # the size first
    rng = generator(seed, f"effect {spec.name}", choice.seed)
    place = places.index(choice.place) if choice.place else 0
    return spec.make(EffectArguments(site, place, choice.variant or spec.variants[0], values, rng))


def draw(
    name: str, machine: MachineFile, rng: np.random.Generator, *, final: bool | None = None, duration_s: float = 3600.0,
    among: Collection[str] = (),
) -> EffectChoice:  # fmt: skip
    """A choice with place, variant and all parameters but the size drawn within their ranges; the size in its middle.

    `final` wants the final variant, or any but it; None draws from all, or from those `among` these alone. What sets in
    does so well within `duration_s`. Raises EffectError where no variant is left.
    """
    spec = spec_of(name)
    variants = spec.variants if final is None else (spec.final,) if final else tuple(
        v for v in spec.variants if v != spec.final
    )  # fmt: skip
    variants = tuple(v for v in variants if not among or v in among)
    if not variants:
        raise EffectError(f"effect {name}: none of its variants is among {', '.join(among)}")
    others = []
    for p in spec.others:
        if p.name == "onset_s":
            others.append((p.name, float(min(p.high, duration_s * rng.uniform(0.15, 0.7)))))
        elif p.low > 0.0:
            others.append((p.name, float(np.exp(rng.uniform(math.log(p.low), math.log(p.high))))))
        else:
            others.append((p.name, float(rng.uniform(p.low, p.high))))
    places = list(names_of(machine, spec.place))
    return EffectChoice(
        name,
        spec.size.middle,
        places[int(rng.integers(len(places)))],
        variants[int(rng.integers(len(variants)))],
        tuple(others),
        int(rng.integers(2**31)),
    )


def parse(text: str, machine: MachineFile) -> EffectChoice:
    """A choice from `NAME=VALUE[,place=...][,variant=...][,seed=N][,parameter=value...]`; raises EffectError."""
    head, *rest = text.split(",")
    name, separator, value = head.partition("=")
    spec = spec_of(name.strip())
    if not separator:
        raise EffectError(f"effect {spec.name}: give its {spec.size.name}: {spec.name}={spec.size.typical:g}")
    words = {"place": "", "variant": ""}
    seed, numbers = 0, []
    for part in rest:
        key, separator, word = (x.strip() for x in part.partition("="))
        if not separator:
            raise EffectError(f"effect {spec.name}: '{part.strip()}' is not KEY=VALUE")
        if key in words:
            words[key] = word
        elif key == "seed":
            seed = _whole(spec.name, key, word)
        else:
            numbers.append((key, _number(spec.name, key, word)))
    size = _number(spec.name, spec.size.name, value)
    choice = EffectChoice(spec.name, size, words["place"], words["variant"], tuple(numbers), seed)
    check(choice, machine)
    return choice


def _whole(effect: str, key: str, text: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) <= 10):
        raise EffectError(f"effect {effect}: {key} = '{text}' is not a whole number")
    return int(text)


def _number(effect: str, key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise EffectError(f"effect {effect}: {key} = '{text.strip()}' is not a number") from None
