"""A twin as plain data, and back: data that are read are checked as untrusted input."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.diagnosis.twin.answers import OnsetQuestion, PeriodQuestion, RecordedAnswers, Values
from calibration.diagnosis.twin.twin_model import FittedMachine, TwinCampaign, TwinEffect, full_model
from calibration.effects.api import CurvePoint, Departure
from calibration.effects.catalogue import Catalogue
from calibration.effects.context import ARRAYS, ArrivalHistory, ReadingContext
from calibration.effects.departures import VISIT
from calibration.machine.description import Machine
from calibration.recording.header import KnownTable

FORMAT = 4  # 3 and before: no departures from an effect's form
LARGEST = 1e12  # of any number
LARGEST_PLACE_M = 1e4
LARGEST_UNKNOWN = 10.0  # m, rad, ratios, K: no machine is further from its file
NOT_A_ROTATION = 1e-6
MOST_ADDED, MOST_ANSWERS, MOST_CHANNELS, MOST_TABLES, MOST_DEPARTURES = 64, 1000, 1000, 1000, 1000
Question = TypeVar("Question", PeriodQuestion, OnsetQuestion, str)


def to_data(campaign: TwinCampaign, fitted_machine: FittedMachine, added: Sequence[TwinEffect]) -> dict[str, Any]:
    """Plain data for a JSON file."""
    context = campaign.context
    return {
        "format": FORMAT,
        "fit": _fitted_machine_data(fitted_machine),
        "linear_at": _fitted_machine_data(campaign.linearised_at),
        "added": [_twin_effect_data(effect) for effect in added],
        "smr": campaign.smr.tolist(),
        "visit": campaign.visit.tolist(),
        "rest": campaign.equilibrium_poses.tolist(),
        "history": {"arrived_s": context.history.arrived_s.tolist(), "drives": context.history.drives.tolist()},
        "moments": {name: np.asarray(getattr(context, name)).tolist() for name in ARRAYS},
        "temperatures_c": {name: t.tolist() for name, t in context.temperatures_c.items()},
        "start_s": context.start_s,
        "breaks_s": list(context.breaks_s),
        "known_tables": [table.model_dump(mode="json") for table in context.known_tables],
    }


def _fitted_machine_data(fitted: FittedMachine) -> dict[str, Any]:
    frame = {"rotation": fitted.frame.rotation.tolist(), "translation_m": fitted.frame.translation_m.tolist()}
    return {"values": fitted.values.tolist(), "frame": frame, "mounted_m": fitted.mounted_m.tolist()}


def _twin_effect_data(added: TwinEffect) -> dict[str, Any]:
    answers = added.answers
    return {
        "effect": added.effect,
        "place": added.place,
        "columns": list(added.columns),
        "curve": None if added.curve is None else [added.curve[0], *added.curve[1]],
        "departures": [[one.column, one.coordinate, one.term, one.period_m] for one in added.departures],
        "coefficients": list(added.coefficients),
        "column_rms": list(added.column_rms),
        "periods_m": [list(values) for values in answers.periods_m.values()],
        "periods_asked": [[*question, *over] for *question, over in answers.periods_m],
        "onsets_s": [list(values) for values in answers.onsets_s.values()],
        "onsets_asked": [list(question) for question in answers.onsets_s],
        "strength_onsets_s": [list(values) for values in answers.strength_onsets_s.values()],
        "strength_onsets_asked": list(answers.strength_onsets_s),
    }


def from_data(
    machine: Machine, data: Mapping[str, Any], catalogue: Catalogue
) -> tuple[TwinCampaign, FittedMachine, tuple[TwinEffect, ...]]:
    """The arguments of `to_data`. Raises InputError, in one line, if the data are invalid."""
    try:
        if data["format"] != FORMAT:
            raise ValueError(f"format {str(data['format'])[:20]!r} is not known")
        context = _reading_context(machine, data)
        rows = _rows(machine, data, context)
        campaign = TwinCampaign(machine, context, *rows, _fitted_machine(machine, data["linear_at"]))
        fitted_machine = _fitted_machine(machine, data["fit"])
        entries = data["added"]
        if not isinstance(entries, list) or len(entries) > MOST_ADDED:
            raise ValueError(f"'added' is not a list of up to {MOST_ADDED} effects")
        return campaign, fitted_machine, tuple(_twin_effect(campaign, entry, catalogue) for entry in entries)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError) as error:
        line = " ".join(str(error).split())[:200]
        raise InputError(f"twin: {type(error).__name__}: {line}; make it again with diagnose --add") from None


def _float_array(what: str, values: Any, *shape: int | None, largest: float = LARGEST) -> Array:
    """An array of a shape, in which None stands for any length but zero."""
    out = np.array(values)
    if out.dtype.kind not in "iuf":
        raise ValueError(f"'{what}' must hold numbers only")
    if out.ndim != len(shape) or any(n != (k or n) for n, k in zip(out.shape, shape, strict=True)) or not out.size:
        raise ValueError(f"'{what}' has the wrong shape")
    out = out.astype(np.float64)
    if not np.all(np.abs(out) <= largest):
        raise ValueError(f"'{what}' holds a number that is not finite or far too large")
    return out


def _index_array(what: str, values: Any, least: int, end: int) -> NDArray[np.intp]:
    """Whole numbers from least, below end."""
    out = _float_array(what, values, None)
    if np.any(out != np.round(out)) or np.any(out < least) or np.any(out >= end):
        raise ValueError(f"'{what}' must hold whole numbers from {least} to {end - 1} only")
    return out.astype(np.intp)


def _reading_context(machine: Machine, data: Mapping[str, Any]) -> ReadingContext:
    d, history, arrays_data = len(machine.drive_names), data["history"], data["moments"]
    n = len(_float_array("t_s", arrays_data["t_s"], None))
    widths: dict[str, tuple[int, ...]] = {"payload_com_m": (3,)}
    widths |= dict.fromkeys(("drives", "direction", "velocity_m_per_s", "torque", "following_error_m"), (d,))
    arrays_data = {"following_error_m": np.zeros((n, d)).tolist(), **arrays_data}  # files of older versions have none
    arrived = _float_array("arrived_s", history["arrived_s"], None)
    arrays: dict[str, Any] = {name: _float_array(name, arrays_data[name], n, *widths.get(name, ())) for name in ARRAYS}
    arrays["arrival"] = _index_array("arrival", arrays_data["arrival"], 0, len(arrived))
    temperatures = {str(name): _float_array(str(name), t, n) for name, t in data["temperatures_c"].items()}
    for sensor in ("air", *machine.sensors.values()):
        if sensor not in temperatures:
            raise ValueError(f"no temperatures of '{sensor}'")
    start_s = float(_float_array("start_s", [data["start_s"]], 1)[0])
    drives = _float_array("history", history["drives"], len(arrived), d)
    breaks = data.get("breaks_s")  # of former versions none
    return ReadingContext(
        history=ArrivalHistory(arrived, drives),
        temperatures_c=temperatures,
        start_s=start_s,
        breaks_s=tuple(_float_array("breaks_s", breaks, None).tolist()) if breaks else (),
        known_tables=_known_tables(machine, data["known_tables"]),
        **arrays,
    )


def _known_tables(machine: Machine, data: Any) -> tuple[KnownTable, ...]:
    if not isinstance(data, list) or len(data) > MOST_TABLES:
        raise ValueError(f"'known_tables' is not a list of up to {MOST_TABLES} tables")
    tables = tuple(KnownTable.model_validate(entry) for entry in data)
    if any({table.drive, table.partner or table.drive} - set(machine.drive_names) for table in tables):
        raise ValueError("'known_tables' names a drive that the machine does not have")
    return tables


def _rows(
    machine: Machine, data: Mapping[str, Any], context: ReadingContext
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Reflector and visit of each reading, poses of the visits."""
    poses = _float_array("rest", data["rest"], None, 6, largest=LARGEST_PLACE_M)
    smr = _index_array("smr", data["smr"], 0, len(machine.smrs))
    visit = _index_array("visit", data["visit"], -1, len(poses))
    on_floor = np.array([s.on == "floor" for s in machine.smrs])
    if len(smr) != len(context) or len(visit) != len(context) or np.any(on_floor[smr] != (visit < 0)):
        raise ValueError("'smr' and 'visit' do not match the readings of 'moments'")
    if len(np.unique(visit[visit >= 0])) != len(poses):
        raise ValueError("'rest' does not fit the visits")
    return smr, visit, poses


def _fitted_machine(machine: Machine, data: Mapping[str, Any]) -> FittedMachine:
    values = _float_array("values", data["values"], len(full_model(machine)), largest=LARGEST_UNKNOWN)
    rotation = _float_array("rotation", data["frame"]["rotation"], 3, 3)
    if np.any(np.abs(rotation @ rotation.T - np.eye(3)) > NOT_A_ROTATION) or np.linalg.det(rotation) < 0.0:
        raise ValueError("'rotation' is not a rotation matrix")
    frame = Frame(rotation, _float_array("translation_m", data["frame"]["translation_m"], 3))
    return FittedMachine(values, frame, _float_array("mounted_m", data["mounted_m"], len(machine.smrs), 3))


def _twin_effect(campaign: TwinCampaign, data: Mapping[str, Any], catalogue: Catalogue) -> TwinEffect:
    name, place = data["effect"], data["place"]
    effect = next((e for e in catalogue.effects if e.name == name), None)
    if effect is None:
        raise InputError(f"twin: unknown effect {str(name)[:60]!r}; name its file with --effects")
    if type(place) is not int or not 0 <= place < len(effect.places(campaign.machine)):
        raise ValueError(f"'{effect.name}' has no such place")
    columns = tuple(int(c) for c in _index_array("columns", data["columns"], 0, 1000))
    departures = _departures(data["departures"], len(columns))
    count = len(columns) + len(departures)
    coefficients = tuple(_float_array("coefficients", data["coefficients"], count).tolist())
    curve = _curve(data["curve"])
    periods_m, onsets_s = _values(data["periods_m"], 1e-9), _values(data["onsets_s"], -LARGEST)
    strength_onsets_s = _values(data.get("strength_onsets_s", []), -LARGEST)  # former versions had none

    drives = len(campaign.machine.drive_names)
    answers = RecordedAnswers(
        _by_question([_period_question(asked, drives) for asked in data["periods_asked"]], periods_m),
        _by_question([_onset_question(asked) for asked in data["onsets_asked"]], onsets_s),
        _by_question(_column_names(data.get("strength_onsets_asked", [])), strength_onsets_s),
    )
    column_rms = tuple(_float_array("column_rms", data["column_rms"], count).tolist())
    return TwinEffect(effect.name, place, columns, curve, departures, coefficients, answers, column_rms)


def _period_of(periods: list[Any]) -> float:
    if not periods:
        return 0.0
    (period_m,) = periods
    if type(period_m) not in (int, float) or not 0.0 <= period_m < math.inf:
        raise ValueError("'departures' has no period that a phase could be of")
    return float(period_m)


def _departures(data: Any, columns: int) -> tuple[Departure, ...]:
    if not isinstance(data, list) or len(data) > MOST_DEPARTURES:
        raise ValueError(f"'departures' is not a list of up to {MOST_DEPARTURES}")
    out = []
    for column, coordinate, term, *periods in data:  # former versions had no periods
        if type(column) is not int or not 0 <= column < columns or type(term) is not int or term < 0:
            raise ValueError("'departures' names no column of the effect")
        if not isinstance(coordinate, str) or coordinate == VISIT:
            raise ValueError("'departures' names no coordinate")
        out.append(Departure(column, coordinate, term, _period_of(periods)))
    return tuple(out)


def _curve(data: Any) -> CurvePoint | None:
    if data is None:
        return None
    number, *parameters = data
    if type(number) is not int or number < 0:
        raise ValueError("'curve' does not begin with its number")
    return number, tuple(_float_array("curve", parameters, None).tolist())


def _values(answers: Any, least: float) -> list[Values]:
    """The answers to a list of questions, each value at least so large."""
    if not isinstance(answers, list) or len(answers) > MOST_ANSWERS:
        raise ValueError("periods or onsets are no list of answers")
    out = [tuple(_float_array("answers", answer, None).tolist()) if answer != [] else () for answer in answers]
    if any(value < least for answer in out for value in answer):
        raise ValueError("a period is not a length")
    return out


def _by_question(questions: Sequence[Question], answers: Sequence[Values]) -> dict[Question, Values]:
    if len(questions) != len(answers):
        raise ValueError("there are not as many answers as questions")
    return dict(zip(questions, answers, strict=True))


def _period_question(asked: Any, drives: int) -> PeriodQuestion:
    """Drive, limits and, if not over its own coordinate, the weight of each drive's."""
    drive, *numbers = asked
    if type(drive) is not int:
        raise ValueError("'periods_asked' does not begin with the number of a drive")
    count = 2 if len(numbers) == 2 else 2 + drives
    shortest_m, longest_m, *over = _float_array("periods_asked", numbers, count).tolist()
    return drive, shortest_m, longest_m, tuple(over)


def _column_names(asked: Any) -> list[str]:
    if not isinstance(asked, list) or not all(isinstance(name, str) for name in asked):
        raise ValueError("'strength_onsets_asked' must hold names of columns only")
    return asked


def _onset_question(asked: Any) -> OnsetQuestion:
    if not isinstance(asked, list) or len(asked) > MOST_CHANNELS or not all(isinstance(c, str) for c in asked):
        raise ValueError("'onsets_asked' must hold names of channels only")
    return tuple(asked)
