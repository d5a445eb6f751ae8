"""All effects by name: the shipped ones, those of installed packages, and those of files that the user names.

A file is Python code of the user's own, given on the command line; nothing is loaded from a rig file or a recording.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from calibration.base.errors import InputError
from calibration.effects import control, drive_train, guides, instrument, reversal, structure, thermal
from calibration.effects.api import Effect

ENTRY_POINTS = "pkm_rig.effects"
RESERVED = ("none", "unknown")
INSIDE_GEOMETRY = ("smr_offset", "joint_spacing", "link_self_weight")
ORDER = (
    "link_thermal_growth", "column_thermal_growth", "screw_thermal_growth", "backlash", "friction_windup",
    "column_compliance", "link_stiffness", "joint_clearance", "screw_cumulative_error", "screw_periodic_error",
    "encoder_interpolation", "guide_straightness", "guide_angular", "foundation_settling", "tracker_drift",
    "refraction", "smr_reseat", "axis_coupling", "latency", "servo_settling",
)  # fmt: skip


@dataclass(frozen=True)
class Catalogue:
    """Effects that a diagnosis may name."""

    effects: tuple[Effect, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(effect.name for effect in self.effects)

    def without(self, names: Collection[str]) -> Catalogue:
        """The catalogue without some names; InputError for one that is not in it."""
        for name in names:
            if name not in self.names:
                raise InputError(f"effect '{name}' is not in the catalogue; known: {', '.join(self.names)}")
        return Catalogue(tuple(effect for effect in self.effects if effect.name not in names))


def load_catalogue(files: Sequence[Path] = (), *, without: Collection[str] = ()) -> Catalogue:
    """The shipped effects, those of installed packages (entry points `pkm_rig.effects`) and those of files.

    A file or an entry point holds `EFFECTS`, a sequence of `calibration.effects.api.Effect`. InputError in one line.
    """
    found = sorted(
        (
            e
            for module in (thermal, reversal, structure, drive_train, guides, instrument, control)
            for e in module.EFFECTS
        ),
        key=lambda e: ORDER.index(e.name),
    )
    for point in entry_points(group=ENTRY_POINTS):
        try:
            loaded = point.load()
        except (Exception, SystemExit) as error:
            raise InputError(f"entry point {point.name}: {_one_line(error)}; repair or remove its package") from error
        found += _checked(loaded, f"entry point {point.name}")
    for path in files:
        found += _checked(_effects_of(path), str(path))
    names = [effect.name for effect in found]
    for name in names:
        if names.count(name) > 1 or name in (*RESERVED, *INSIDE_GEOMETRY):
            raise InputError(f"effect '{name}' is already known; give yours another name")
    return Catalogue(tuple(found)).without(without)


def _effects_of(path: Path) -> object:
    spec = importlib.util.spec_from_file_location(f"effects_of_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InputError(f"{path}: no Python file with effects; give a file that holds EFFECTS")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look up what late annotations name
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise InputError(f"{path}: {_one_line(error)}") from error
    return getattr(module, "EFFECTS", None)


def _one_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _checked(found: object, source: str) -> list[Effect]:
    if not isinstance(found, Iterable) or not (effects := list(found)):
        raise InputError(f"{source}: holds no EFFECTS; give a tuple of calibration.effects.base.Effect")
    for effect in effects:
        if not isinstance(effect, Effect):
            raise InputError(f"{source}: EFFECTS holds {type(effect).__name__}; each must be an Effect")
    return effects
