"""Errors of the devices. Each reads as one line: what is wrong, where, and what to do about it."""

from __future__ import annotations


class DeviceError(Exception):
    """Something is wrong with a device or with the way to it.

    `device` is its name in the rig, `where` the port, node or register, `what` the fault and
    `remedy` what a person can do.
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
    """The device cannot be reached, or the line to it has broken."""


class IdentityMismatch(DeviceError):
    """Another device answers than the one that is configured, or its units are others."""


class ProtocolError(DeviceError):
    """An answer cannot be understood: garbled, of the wrong kind or out of range."""


class NoAnswer(DeviceError):
    """A request was not answered within the host's time-out."""


class SettingsChanged(ProtocolError):
    """The station has other settings than it was given: what it has measured since they were compared is void."""


class NotExecuted(ProtocolError):
    """The station could not read a request, so it has done nothing."""


class StationError(DeviceError):
    """The station carried a request out with another result than success. `code` is GeoCOM's."""

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
    """The station follows no reflector any more."""


class WrongTarget(DeviceError):
    """Another reflector was found than the one that was aimed at, or something stands in the beam."""


class NotImplementedByStation(StationError):
    """The station does not know this call."""


class StationOff(StationError):
    """The station sleeps or is switched off."""


class NotSettled(DeviceError):
    """Readings did not become steady within the allowed rig time."""


class DriveFault(DeviceError):
    """A drive is in fault, or dropped out of operation."""


class NotReferenced(DriveFault):
    """A drive has lost its reference: its positions mean nothing before it is homed."""


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
    """The PLC refuses, or a register's value cannot be right."""


class InterlockOpen(DeviceError):
    """An interlock is open."""


class StaleData(DeviceError):
    """A heartbeat stands still: values are old, so nothing may be concluded from them."""


class Stopped(DeviceError):
    """The drives were stopped together and wait for the stop to be cleared."""
