"""All effects by name: the shipped ones, those of installed packages, and those of files that the user names.

Such a file is the user's own Python code, named on the command line; no code is ever loaded because a rig file or a
recording asks for it.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from calibration.base.errors import InputError
from calibration.effects import (
    control,
    drive_scale,
    drive_train,
    expansion,
    guides,
    instrument,
    payload,
    reversal,
    structure,
    tables_left_on,
    thermal,
)
from calibration.effects.api import Effect
from calibration.effects.varying_strength import with_varying_strength

FAMILIES = (
    thermal, reversal, structure, drive_train, guides, instrument, control, expansion, payload, tables_left_on,
    drive_scale,
)  # fmt: skip
ENTRY_POINTS = "pkm_rig.effects"
RESERVED = ("none", "unknown")
INSIDE_GEOMETRY = ("smr_offset", "joint_spacing", "link_self_weight")


@dataclass(frozen=True)
class Catalogue:
    """Effects that a diagnosis may name."""

    effects: tuple[Effect, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(effect.name for effect in self.effects)

    def effect(self, name: str) -> Effect:
        """An effect by its name. Raises InputError for a name that is not in the catalogue."""
        for effect in self.effects:
            if effect.name == name:
                return effect
        raise InputError(f"effect '{name}' is not in the catalogue; known: {', '.join(self.names)}")

    def without(self, names: Collection[str]) -> Catalogue:
        """The catalogue without some names. Raises InputError for a name that is not in it."""
        for name in names:
            self.effect(name)
        return Catalogue(tuple(effect for effect in self.effects if effect.name not in names))

    def without_forms(self, names: Collection[str]) -> Catalogue:
        """The catalogue without some forms, each named EFFECT/FORM. Raises InputError for an effect that is not in it.

        A form that its effect does not have on a recording, and a textbook's, are ignored.
        """
        by_effect: dict[str, set[str]] = {}
        for name in names:
            effect, _, form = name.partition("/")
            by_effect.setdefault(self.effect(effect).name, set()).add(form)
        return Catalogue(tuple(effect.without_forms(by_effect.get(effect.name, ())) for effect in self.effects))


def load_catalogue(files: Sequence[Path] = (), *, without: Collection[str] = ()) -> Catalogue:
    """The shipped effects in their order, then those of installed packages (entry points `pkm_rig.effects`) and files.

    A file or an entry point holds `EFFECTS`, a sequence of `calibration.effects.api.Effect`. Raises InputError, in one
    line, for a source that cannot be loaded, a name that is taken, and a name in `without` that is not known.
    """
    effects = sorted((effect for family in FAMILIES for effect in family.EFFECTS), key=lambda effect: effect.order)
    for point in entry_points(group=ENTRY_POINTS):
        try:
            loaded = point.load()
        except (Exception, SystemExit) as error:
            raise InputError(f"entry point {point.name}: {_one_line(error)}; repair or remove its package") from error
        effects += _require_effects(loaded, f"entry point {point.name}")
    for path in files:
        effects += _require_effects(_load_effects(path), str(path))
    names = [effect.name for effect in effects]
    for name in names:
        if names.count(name) > 1 or name in (*RESERVED, *INSIDE_GEOMETRY):
            raise InputError(f"effect '{name}' is already known; give yours another name")
    return Catalogue(tuple(with_varying_strength(effect) for effect in effects)).without(without)


def _load_effects(path: Path) -> object:
    spec = importlib.util.spec_from_file_location(f"effects_of_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InputError(f"{path}: no Python file with effects; give a file that holds EFFECTS")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses resolve their annotations there
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise InputError(f"{path}: {_one_line(error)}") from error
    return getattr(module, "EFFECTS", None)


def _one_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _require_effects(loaded: object, source: str) -> list[Effect]:
    if not isinstance(loaded, Iterable) or not (effects := list(loaded)):
        raise InputError(f"{source}: holds no EFFECTS; give a tuple of calibration.effects.api.Effect")
    for effect in effects:
        if not isinstance(effect, Effect):
            raise InputError(f"{source}: EFFECTS holds {type(effect).__name__}; each must be an Effect")
    return effects
