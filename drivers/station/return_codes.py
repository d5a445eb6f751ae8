"""GeoCOM return codes as typed errors with a readable text."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.errors import (
    AimingFailed,
    AngleOnly,
    LockLost,
    MultipleTargets,
    NotImplementedByStation,
    SignalError,
    StationBusy,
    StationError,
    StationOff,
    TargetNotFound,
)

OK = 0
NOT_IMPLEMENTED = 5
NO_FULL_CORRECTION = 1283
ACCURACY_NOT_GUARANTEED = 1284
BUSY = 1293

COM_CANT_DECODE = 3074
COM_CANT_SEND = 3075
COM_TIMED_OUT = 3077
COM_CANT_DECODE_REQUEST = 3080
COM_PROCEDURE_UNAVAILABLE = 3081
COM_FAILED = 3085
COM_TRANSACTION_MISMATCH = 3093
COM_SERVER_CHECKSUM = 3101
COM_CLIENT_CHECKSUM = 3102

# The answer contains values although the code is not 0; the flag is recorded with the reading.
VALUES_WITH_FLAG = {
    NO_FULL_CORRECTION: "no_full_correction",
    ACCURACY_NOT_GUARANTEED: "accuracy_not_guaranteed",
}

GARBLED = frozenset({COM_CANT_DECODE, COM_TRANSACTION_MISMATCH, COM_CLIENT_CHECKSUM, 3078, 3082})

# The station could not read the request, so it did nothing: even a motion may be requested again.
NOT_EXECUTED = frozenset({COM_SERVER_CHECKSUM, COM_CANT_DECODE_REQUEST})


@dataclass(frozen=True)
class _ErrorKind:
    kind: type[StationError]
    what: str
    remedy: str


_LOOK_AT_BEAM = "look for something in the beam, a dirty reflector or one turned away"
_REPEAT = "repeat the measurement"
_TABLE: dict[int, _ErrorKind] = {
    2: _ErrorKind(StationError, "a parameter was refused", "check the setting against the station's manual"),
    3: _ErrorKind(StationError, "the function gave no valid result", _REPEAT),
    4: _ErrorKind(StationError, "a fatal error of the station", "switch the station off and on"),
    NOT_IMPLEMENTED: _ErrorKind(
        NotImplementedByStation, "the call is not implemented", "check model and options of the station"
    ),
    6: _ErrorKind(StationError, "the function did not end in time", _REPEAT),
    8: _ErrorKind(StationError, "the function was aborted", "release the station's keyboard and repeat"),
    13: _ErrorKind(StationBusy, "the system is busy", _REPEAT),
    NO_FULL_CORRECTION: _ErrorKind(
        StationError, "measured without full correction", "check level and compensator of the station"
    ),
    ACCURACY_NOT_GUARANTEED: _ErrorKind(
        StationError, "accuracy is not guaranteed", "check level, stand and vibration of the station"
    ),
    1285: _ErrorKind(AngleOnly, "angles are valid, the distance is not", _LOOK_AT_BEAM),
    1288: _ErrorKind(AngleOnly, "angles without full correction, no distance", _LOOK_AT_BEAM),
    1289: _ErrorKind(AngleOnly, "angles without guaranteed accuracy, no distance", _LOOK_AT_BEAM),
    1290: _ErrorKind(StationError, "no valid angle", "check level and compensator of the station"),
    1291: _ErrorKind(StationError, "wrong distance settings (ppm, constant)", "connect again to set them anew"),
    1292: _ErrorKind(SignalError, "the distance measurement failed", _LOOK_AT_BEAM),
    BUSY: _ErrorKind(StationBusy, "the station is busy", _REPEAT),
    1294: _ErrorKind(SignalError, "no signal from the reflector", _LOOK_AT_BEAM),
    8704: _ErrorKind(AimingFailed, "aiming did not end in time", "check that nothing blocks the telescope"),
    8705: _ErrorKind(AimingFailed, "a motor reached its end stop", "check that nothing blocks the telescope"),
    8706: _ErrorKind(AimingFailed, "an angle could not be read while turning", _REPEAT),
    8707: _ErrorKind(AimingFailed, "a motor failed", "switch the station off and on"),
    8708: _ErrorKind(AimingFailed, "the position was not reached with its accuracy", _REPEAT),
    8709: _ErrorKind(AimingFailed, "the deviation could not be measured", _REPEAT),
    8710: _ErrorKind(TargetNotFound, "no reflector in the window", _LOOK_AT_BEAM),
    8711: _ErrorKind(
        MultipleTargets, "more than one reflector in the window", "narrow the window or cover the other one"
    ),
    8712: _ErrorKind(AimingFailed, "too much light for target recognition", "shade the reflector"),
    8714: _ErrorKind(AimingFailed, "target recognition is not enabled", "connect again to enable it"),
    8716: _ErrorKind(AimingFailed, "the aiming accuracy was not reached", _REPEAT),
    8725: _ErrorKind(LockLost, "the lock on the target was lost", "aim again"),
    COM_PROCEDURE_UNAVAILABLE: _ErrorKind(
        NotImplementedByStation, "this model does not know the call", "check model and options of the station"
    ),
    9: _ErrorKind(StationError, "the station's memory is full", "switch the station off and on"),
    12: _ErrorKind(StationOff, "the station is shutting down", "check its battery and switch it on"),
    14: _ErrorKind(StationError, "a hardware fault of the station", "have the station serviced"),
    16: _ErrorKind(StationError, "the station's battery is low", "charge or change the battery"),
    18: _ErrorKind(StationOff, "the station's battery is empty", "charge or change the battery"),
    21: _ErrorKind(StationError, "the station is too hot or too cold", "let it come to its range of temperature"),
    22: _ErrorKind(StationError, "the station is tilted too far", "level the station"),
    25: _ErrorKind(StationOff, "the station sleeps", "wake it up and connect again"),
    8713: _ErrorKind(AimingFailed, "the detector of target recognition failed", "switch the station off and on"),
    8715: _ErrorKind(AimingFailed, "calibration of target recognition failed", "calibrate it by the station's menu"),
    8720: _ErrorKind(AimingFailed, "no search area is set", "connect again"),
    8724: _ErrorKind(AimingFailed, "the motors do not follow the target", "slow the motion down and aim again"),
    3107: _ErrorKind(StationOff, "the station asks for a connection first", "connect again"),
    3108: _ErrorKind(StationOff, "the station sleeps", "wake it up and connect again"),
    3109: _ErrorKind(StationOff, "the station is switched off", "switch it on and connect again"),
}


# Codes are in blocks of 256, one per subsystem: texts for those that are not listed.
_MANUAL = "look the code up in the GeoCOM manual"
_BLOCKS: dict[int, _ErrorKind] = {
    1: _ErrorKind(StationError, "the angle measurement failed", "check level and compensator of the station"),
    2: _ErrorKind(AimingFailed, "target recognition failed", _LOOK_AT_BEAM),
    3: _ErrorKind(SignalError, "the distance meter failed", _LOOK_AT_BEAM),
    5: _ErrorKind(StationError, "the measurement failed", _REPEAT),
    7: _ErrorKind(AimingFailed, "a motor failed", "check that nothing blocks the telescope"),
    12: _ErrorKind(StationError, "the station's communication failed", "check the line and connect again"),
    34: _ErrorKind(AimingFailed, "aiming failed", _REPEAT),
}


def station_error(code: int, call: str, device: str, where: str) -> StationError:
    """The typed error of a return code other than 0."""
    meaning = _TABLE.get(code) or _BLOCKS.get(code >> 8, _ErrorKind(StationError, "unexpected result", _MANUAL))
    return meaning.kind(device, f"{where}, {call}", f"{meaning.what} (GeoCOM {code})", meaning.remedy, code)
