"""Facts of an imagined machine, to start tests from."""

from __future__ import annotations

from calibration.intervals.facts import (
    CalibrationFact,
    CheckFact,
    ErrorFigure,
    InstrumentFact,
    MachineFact,
    MachineHistory,
    Tolerance,
)

DAY_S = 86400.0
WEEK_S = 7.0 * DAY_S
START_S = 1.7e9
NAMES = ("drive_scale.left", "drive_offset.left")


def machine(**changes):
    entries = {
        "name": "m",
        "identity": "m-1",
        "parameter_names": NAMES,
        "tolerances": (Tolerance(START_S, 25e-6),),
    }
    return MachineFact(**(entries | changes))


def calibration(id_="c1", t_utc_s=START_S, **changes):
    entries = {
        "id": id_,
        "t_utc_s": t_utc_s,
        "instrument": "T1",
        "parameter_names": NAMES,
        "parameters": (1e-5, 2e-5),
        "covariance": ((1e-12, 0.0), (0.0, 4e-12)),
        "temperature_c": 21.0,
        "operating_h": 100.0,
        "as_found": ErrorFigure(20e-6, 1e-6),
        "as_left": ErrorFigure(2e-6, 1e-6),
    }
    return CalibrationFact(**(entries | changes))


def check(number=1, t_utc_s=None, **changes):
    entries = {
        "id": f"h{number}",
        "t_utc_s": START_S + number * WEEK_S if t_utc_s is None else t_utc_s,
        "calibration": "c1",
        "instrument": "T1",
        "error": ErrorFigure(3e-6, 1.5e-6),
        "watched": NAMES,
        "change": (0.0, 0.0),
        "change_u": (2e-6, 3e-6),
        "reference_u": (5e-7, 1e-6),
        "error_per_change": (0.8, 0.7),
        "independent": 1.6,
        "temperature_c": 21.0,
        "poses": 8,
        "operating_h": 100.0 + 40.0 * number,
    }
    return CheckFact(**(entries | changes))


def history(**changes):
    entries = {
        "machine": machine(),
        "instruments": (InstrumentFact("T1", "cert-1", START_S + 400.0 * DAY_S),),
        "calibrations": (calibration(),),
    }
    return MachineHistory(**(entries | changes))
