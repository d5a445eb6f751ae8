"""In place of the drives where a control moves the machine: nothing is commanded, stopped or read."""

from __future__ import annotations

from collections.abc import Sequence

from calibration.base.arrays import Array
from drivers.can.can_line import CanLine
from drivers.drives.drive_group import DriveGroup, RestLimits
from drivers.drives.servo_drive import DriveSample
from pkm_rig.rig.clock import RigClock


class _NoLine(CanLine):
    """The control's own bus, which we are not on."""

    def __init__(self) -> None:
        self.name = "the control's own bus"

    def require_only_master(self) -> None:
        """Nobody of ours is master there."""

    def send_heartbeat(self, _node_id: int) -> None:
        """Nobody watches us."""

    def close(self) -> None:
        """Nothing is open."""


class UnreadDrives(DriveGroup):
    """A group without a drive. What it samples is what the program commands at the present visit, not what drives say.

    Whoever would move or home drives gets RuntimeError: no job does where a control moves the machine.
    """

    def __init__(self, clock: RigClock) -> None:
        self.drives = ()
        self.only_led = False
        self.rest = RestLimits()
        self.line = _NoLine()
        self._rig_clock = clock
        self._commanded: tuple[float, ...] = ()

    def stand_at(self, drives: Array) -> None:
        """The program commands these drive coordinates (d,) at the present visit."""
        self._commanded = tuple(float(q) for q in drives)

    @property
    def stop_reason(self) -> str | None:
        """The control stops its machine, not we."""
        return None

    def stop_all(self, reason: str) -> None:
        """Nothing: safety and stops are the control's."""

    def clear_stop(self) -> None:
        """Nothing was stopped."""

    def enable(self) -> None:
        """The control powers its drives."""

    def disable(self) -> None:
        """The control takes the power off its drives."""

    def sample(self) -> list[DriveSample]:
        """What is commanded at the present visit, as a sample of each drive at rest."""
        t_s = self._rig_clock.now_s()
        return [DriveSample(0, q, q, 0.0, 0.0, 0.0, t_s, 0.0) for q in self._commanded]

    def move_to(
        self,
        positions_m: Sequence[float],
        velocity_m_per_s: float,
        acceleration_m_per_s2: float | None = None,
        *,
        limit_s: float | None = None,
    ) -> list[DriveSample]:
        """RuntimeError: the control moves."""
        raise RuntimeError("a control moves this machine")
