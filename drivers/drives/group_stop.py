"""Stopping all drives together, and remembering that they were stopped until the stop is cleared."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial

from drivers.can.can_line import CanLine
from drivers.drives import cia402
from drivers.drives.drive_records import Emergency
from drivers.drives.servo_drive import ServoDrive
from drivers.errors import DeviceError, Stopped


class GroupStop:
    """The quick stop of all drives of a group, from any thread; controlwords that move go through here.

    Once a stop is remembered no controlword is sent before `clear`. During `stopping_on_failure` an EMCY of one drive
    stops all at once, and a frame of another master does at any time.
    """

    def __init__(self, drives: Sequence[ServoDrive], line: CanLine) -> None:
        self.reason: str | None = None
        self.requested: str | None = None  # a stop along the path under way, which ends in the quick stop
        self._drives, self._line = tuple(drives), line
        self._command_lock = threading.Lock()
        self._guilty: ServoDrive | None = None  # the drive whose EMCY has stopped the present motion
        self._moving = False
        for drive in self._drives:
            drive.messages.on_emergency = partial(self._on_emergency, drive)
        line.on_other_master = self._stop_at_once

    def stop(self, reason: str) -> None:
        """Send the quick stop twice, so that one lost frame does not matter, and remember the first reason.

        A drive that cannot be reached does not prevent the stop of the others; the first such failure is raised
        afterwards (ConnectionFailed).
        """
        if self.reason is None:
            self.reason = reason
        failures: list[DeviceError] = []
        with self._command_lock:
            for drive in (*self._drives, *self._drives):
                try:
                    drive.quick_stop()
                except DeviceError as error:
                    failures.append(error)
        if failures:
            raise failures[0]

    def clear(self) -> None:
        """Allow controlwords again."""
        self.reason = self.requested = None

    def raise_if_stopped(self) -> None:
        """Raise OtherMaster, DriveFault for the drive whose EMCY has stopped the present motion, or Stopped."""
        self._line.require_only_master()
        guilty = self._guilty
        if guilty is not None and self._moving:
            raise guilty.fault("its emergency has stopped all drives")
        if self.reason is not None:
            raise Stopped("drives", self._line.name, f"stopped: {self.reason}", "remove the cause, then clear the stop")

    def send(self, drive: ServoDrive, controlword: int) -> None:
        """Send a controlword to one drive. Raises Stopped, DriveFault, ConnectionFailed."""
        with self._command_lock:
            self.raise_if_stopped()
            drive.send_controlword(controlword)

    def send_all(self, controlword: int) -> None:
        """Send a controlword to all drives, back to back. Raises Stopped, DriveFault, ConnectionFailed."""
        with self._command_lock:
            self.raise_if_stopped()
            for drive in self._drives:
                drive.send_controlword(controlword)

    def disable_voltage(self) -> None:
        """Take the power off all drives, stopped or not, without waiting for it."""
        with self._command_lock:
            for drive in self._drives:
                drive.send_controlword(cia402.DISABLE_VOLTAGE)

    @contextmanager
    def stopping_on_failure(self) -> Iterator[None]:
        """A motion: whatever ends it early stops all drives."""
        self._guilty, self._moving = None, True
        try:
            yield
        except BaseException as error:
            with suppress(DeviceError):
                self.stop(str(error) or type(error).__name__)
            raise
        finally:
            self._moving = False

    def _on_emergency(self, drive: ServoDrive, emergency: Emergency) -> None:
        if self._moving and emergency.is_error:
            if self.reason is None:
                self._guilty = drive
            self._stop_at_once(f"{drive.name} ({drive.where}): {emergency}")

    def _stop_at_once(self, reason: str) -> None:
        """Runs in the line's receiving thread: only remember the stop, then send it.

        Remembered first: a thread that polls the drives meanwhile must not send what would enable one of them again.
        """
        if self.reason is None:
            self.reason = reason
        with self._command_lock:
            for drive in self._drives:
                with suppress(DeviceError):
                    drive.quick_stop()
