"""Errors of the devices. Each reads as one line: what is wrong, where, and what to do about it."""

from __future__ import annotations


class DeviceError(Exception):
    """A device or the connection to it has failed.

    `device` is its name in the rig, `where` the port, node or register, `what` the fault and `remedy` what the user
    can do.
    """

    def __init__(self, device: str, where: str, what: str, remedy: str) -> None:
        self.device = device
        self.where = where
        self.what = what
        self.remedy = remedy
        super().__init__(device, where, what, remedy)

    def __str__(self) -> str:
        line = f"{self.device} ({self.where}): {self.what}; {self.remedy}"
        return " ".join(line.split())


class ConnectionFailed(DeviceError):
    """The device cannot be reached, or the line to it is broken."""


class OtherMaster(DeviceError):
    """Somebody else commands devices that are ours."""


class IdentityMismatch(DeviceError):
    """The device that answers, or its units, are not those configured."""


class ProtocolError(DeviceError):
    """An answer cannot be interpreted: garbled, of the wrong kind or out of range."""


class NoAnswer(DeviceError):
    """A request was not answered within the host's time-out."""


class SettingsChanged(ProtocolError):
    """The settings of the station have changed: readings since they were last compared are void."""


class NotExecuted(ProtocolError):
    """The station could not read a request, so it did nothing."""


class StationError(DeviceError):
    """The station carried out a request without success. `code` is GeoCOM's."""

    def __init__(self, device: str, where: str, what: str, remedy: str, code: int) -> None:
        super().__init__(device, where, what, remedy)
        self.code = code


class TargetNotFound(StationError):
    """No reflector in the search window."""


class MultipleTargets(StationError):
    """More than one reflector in the search window."""


class StationBusy(StationError):
    """The station is still measuring."""


class SignalError(StationError):
    """The distance meter gets no usable signal."""


class AngleOnly(StationError):
    """Angles were measured, a distance was not."""


class AimingFailed(StationError):
    """The motors or the target recognition did not reach the target."""


class LockLost(AimingFailed):
    """The station no longer follows a reflector."""


class WrongTarget(DeviceError):
    """A different reflector than intended was measured, or the beam is obstructed."""


UNSEEN = (TargetNotFound, MultipleTargets, SignalError, AngleOnly, WrongTarget)  # put right at the reflector


class NotImplementedByStation(StationError):
    """The station does not know this call."""


class StationOff(StationError):
    """The station sleeps or is switched off."""


class NotSettled(DeviceError):
    """Readings did not become steady within the allowed rig time."""


class DriveFault(DeviceError):
    """A drive is in fault, or has left operation enabled."""


class DrivesMoved(DeviceError):
    """A drive was not where it stood when the visit began."""


class NotReferenced(DriveFault):
    """A drive has lost its reference: its positions are meaningless until it is homed."""


class SdoRefused(DeviceError):
    """A drive refused to read or write an object. `abort_code` is CiA 301's."""

    def __init__(self, device: str, where: str, what: str, remedy: str, abort_code: int) -> None:
        super().__init__(device, where, what, remedy)
        self.abort_code = abort_code


class MotionTimeout(DeviceError):
    """A motion or a change of state did not end within the allowed rig time."""


class TableError(DeviceError):
    """A compensation table is damaged, not for this drive, or not the one that was expected."""


class PlcError(DeviceError):
    """The PLC refuses a request, or the value of a register is not plausible."""


class InterlockOpen(DeviceError):
    """An interlock is open."""


class StaleData(DeviceError):
    """A heartbeat has stopped: values are stale and must not be used."""


class Stopped(DeviceError):
    """The drives were stopped together; the stop must be cleared first."""
