"""A twin as plain data, and back: whatever comes in is checked as hostile input."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.diagnosis.twin.twin_model import Added, Campaign, Fit, whole_model
from calibration.effects.api import OnCurve
from calibration.effects.catalogue import Catalogue
from calibration.effects.context import ARRAYS, History, Moments
from calibration.machine.description import Machine

FORMAT = 2
LARGEST = 1e12  # of any number
LARGEST_PLACE_M = 1e4
LARGEST_UNKNOWN = 10.0  # m, rad, ratios, K: no machine is further from its file
NOT_A_ROTATION = 1e-6
MOST_ADDED, MOST_ANSWERS = 16, 1000


def to_data(campaign: Campaign, fit: Fit, added: Sequence[Added]) -> dict[str, Any]:
    """Plain data for a JSON file."""
    m = campaign.moments
    return {
        "format": FORMAT,
        "fit": _fit_data(fit),
        "linear_at": _fit_data(campaign.at),
        "added": [
            {
                "effect": a.effect,
                "place": a.place,
                "columns": list(a.columns),
                "curve": None if a.curve is None else [a.curve[0], *a.curve[1]],
                "coefficients": list(a.coefficients),
                "periods_m": [list(p) for p in a.periods_m],
                "onsets_s": [list(o) for o in a.onsets_s],
            }
            for a in added
        ],
        "smr": campaign.smr.tolist(),
        "visit": campaign.visit.tolist(),
        "rest": campaign.rest.tolist(),
        "history": {"arrived_s": m.history.arrived_s.tolist(), "drives": m.history.drives.tolist()},
        "moments": {name: np.asarray(getattr(m, name)).tolist() for name in ARRAYS},
        "temperatures_c": {name: t.tolist() for name, t in m.temperatures_c.items()},
        "start_s": m.start_s,
    }


def _fit_data(fit: Fit) -> dict[str, Any]:
    frame = {"rotation": fit.frame.rotation.tolist(), "translation_m": fit.frame.translation_m.tolist()}
    return {"values": fit.values.tolist(), "frame": frame, "mounted_m": fit.mounted_m.tolist()}


def from_data(
    machine: Machine, data: Mapping[str, Any], catalogue: Catalogue
) -> tuple[Campaign, Fit, tuple[Added, ...]]:
    """What `to_data` was given. InputError in one line where it is not fit."""
    try:
        if data["format"] != FORMAT:
            raise ValueError(f"format {str(data['format'])[:20]!r} is not known")
        moments = _moments(machine, data)
        campaign = Campaign(machine, moments, *_rows(machine, data, moments), _fit(machine, data["linear_at"]))
        fit = _fit(machine, data["fit"])
        entries = data["added"]
        if not isinstance(entries, list) or len(entries) > MOST_ADDED:
            raise ValueError(f"'added' is not a list of up to {MOST_ADDED} effects")
        return campaign, fit, tuple(_added(machine, entry, catalogue) for entry in entries)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError) as error:
        line = " ".join(str(error).split())[:200]
        raise InputError(f"twin: {type(error).__name__}: {line}; make it again with diagnose --add") from None


def _numbers(what: str, values: Any, *shape: int | None, largest: float = LARGEST) -> Array:
    """An array of a shape, None for any length but none at all."""
    out = np.array(values)
    if out.dtype.kind not in "iuf":
        raise ValueError(f"'{what}' holds something else than numbers")
    if out.ndim != len(shape) or any(n != (k or n) for n, k in zip(out.shape, shape, strict=True)) or not out.size:
        raise ValueError(f"'{what}' has the wrong shape")
    out = out.astype(np.float64)
    if not np.all(np.abs(out) <= largest):
        raise ValueError(f"'{what}' holds a number that is not finite or far too large")
    return out


def _counts(what: str, values: Any, least: int, end: int) -> NDArray[np.intp]:
    """Whole numbers from least, below end."""
    out = _numbers(what, values, None)
    if np.any(out != np.round(out)) or np.any(out < least) or np.any(out >= end):
        raise ValueError(f"'{what}' holds something else than whole numbers from {least} to {end - 1}")
    return out.astype(np.intp)


def _moments(machine: Machine, data: Mapping[str, Any]) -> Moments:
    d, history, told = len(machine.drive_names), data["history"], data["moments"]
    n = len(_numbers("t_s", told["t_s"], None))
    wide: dict[str, tuple[int, ...]] = {"payload_com_m": (3,)}
    wide |= dict.fromkeys(("drives", "direction", "velocity_m_per_s", "torque"), (d,))
    arrived = _numbers("arrived_s", history["arrived_s"], None)
    arrays: dict[str, Any] = {name: _numbers(name, told[name], n, *wide.get(name, ())) for name in ARRAYS}
    arrays["arrival"] = _counts("arrival", told["arrival"], 0, len(arrived))
    temperatures = {str(name): _numbers(str(name), t, n) for name, t in data["temperatures_c"].items()}
    for sensor in ("air", *machine.sensors.values()):
        if sensor not in temperatures:
            raise ValueError(f"no temperatures of '{sensor}'")
    start_s = float(_numbers("start_s", [data["start_s"]], 1)[0])
    drives = _numbers("history", history["drives"], len(arrived), d)
    return Moments(history=History(arrived, drives), temperatures_c=temperatures, start_s=start_s, **arrays)


def _rows(
    machine: Machine, data: Mapping[str, Any], moments: Moments
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Reflector and visit of each reading, poses of the visits."""
    rest = _numbers("rest", data["rest"], None, 6, largest=LARGEST_PLACE_M)
    smr = _counts("smr", data["smr"], 0, len(machine.smrs))
    visit = _counts("visit", data["visit"], -1, len(rest))
    on_floor = np.array([s.on == "floor" for s in machine.smrs])
    if len(smr) != len(moments) or len(visit) != len(moments) or np.any(on_floor[smr] != (visit < 0)):
        raise ValueError("'smr' and 'visit' do not fit the moments")
    if len(np.unique(visit[visit >= 0])) != len(rest):
        raise ValueError("'rest' does not fit the visits")
    return smr, visit, rest


def _fit(machine: Machine, data: Mapping[str, Any]) -> Fit:
    values = _numbers("values", data["values"], len(whole_model(machine)), largest=LARGEST_UNKNOWN)
    rotation = _numbers("rotation", data["frame"]["rotation"], 3, 3)
    if np.any(np.abs(rotation @ rotation.T - np.eye(3)) > NOT_A_ROTATION) or np.linalg.det(rotation) < 0.0:
        raise ValueError("'rotation' is none")
    frame = Frame(rotation, _numbers("translation_m", data["frame"]["translation_m"], 3))
    return Fit(values, frame, _numbers("mounted_m", data["mounted_m"], len(machine.smrs), 3))


def _added(machine: Machine, data: Mapping[str, Any], catalogue: Catalogue) -> Added:
    name, place, columns = data["effect"], data["place"], data["columns"]
    effect = next((e for e in catalogue.effects if e.name == name), None)
    if effect is None:
        raise InputError(f"twin: unknown effect {str(name)[:60]!r}; name its file with --effects")
    if type(place) is not int or not 0 <= place < len(effect.places(machine)):
        raise ValueError(f"'{effect.name}' has no such place")
    numbers = tuple(int(c) for c in _counts("columns", columns, 0, 1000))
    coefficients = tuple(_numbers("coefficients", data["coefficients"], len(numbers)).tolist())
    return Added(
        effect.name,
        place,
        numbers,
        _curve(data["curve"]),
        coefficients,
        _answers(data["periods_m"], 1e-9),
        _answers(data["onsets_s"], -LARGEST),
    )


def _curve(data: Any) -> OnCurve | None:
    if data is None:
        return None
    number, *at = data
    if type(number) is not int or number < 0:
        raise ValueError("'curve' does not begin with its number")
    return number, tuple(_numbers("curve", at, None).tolist())


def _answers(answers: Any, least: float) -> tuple[tuple[float, ...], ...]:
    """What was told question by question; every answer at least so large."""
    if not isinstance(answers, list) or len(answers) > MOST_ANSWERS:
        raise ValueError("periods or onsets are no list of answers")
    out = [tuple(_numbers("answers", answer, None).tolist()) if answer != [] else () for answer in answers]
    if any(value < least for answer in out for value in answer):
        raise ValueError("a period is not a length")
    return tuple(out)
