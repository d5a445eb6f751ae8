"""A plant that knows how each drive came to where it stands: for effects with a memory, and for twins."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from mock_devices.effects.base import Array, Effect, Leg, MotionState
from mock_devices.plant.affected_machine import motion_states
from mock_devices.plant.base_plant import BasePlant, Motion
from mock_devices.plant.motion_history import MotionHistory

_DIFFERENCE_S = 1.0e-3


@runtime_checkable
class MotionSource(Protocol):
    """A drive that reports its motions; effects with history need it."""

    def motions_after(self, t_s: float) -> list[Motion]:
        """All motions that began after `t_s`."""
        ...


class HistoryPlant(BasePlant):
    """The drives' motions until now, passed on to the effects that act.

    `joined_s`: motions of a drive in one direction with no longer pause between them are one leg: a drive that is led
    makes one a SYNC.
    """

    joined_s = 0.0
    _history: MotionHistory | None = None

    @property
    def metres(self) -> Array | float:
        """The unit (d,) of a drive in the motions that effects see."""
        return 1.0

    @property
    @abstractmethod
    def acting(self) -> Sequence[Effect]:
        """The effects that act."""

    @abstractmethod
    def torque_at_rest(self) -> Array:
        """Torque (d,) of each drive at rest, as a fraction of the rated torque."""

    def motion_state(self, t_s: float, drives_s: float | None = None) -> MotionState:
        """The machine's state at rig time `t_s`, with the drives as they are at `drives_s` if observed later."""
        drives_s = t_s if drives_s is None else drives_s
        history = self._history_until(drives_s)
        positions = np.array([[drive.encoder_m(drives_s) for drive in self._drives]]) * self.metres
        before = np.array([[drive.encoder_m(drives_s - _DIFFERENCE_S) for drive in self._drives]]) * self.metres
        return motion_states(
            history,
            np.array([t_s]),
            positions,
            (positions - before) / _DIFFERENCE_S,
            np.array([self.settings.payloads[self._payload].mass_kg]),
            np.array([float(self._exchanges)]),
            self.thermal,
            drives_s=np.array([drives_s]),
        )

    def legs(self, drive: int) -> list[Leg]:
        """The legs of a drive until it was last observed."""
        return [] if self._history is None else self._history.legs(drive)

    def _history_until(self, t_s: float) -> MotionHistory:
        """The drives' motions until `t_s`, passed on to the effects."""
        if self._history is None:
            first = np.array([drive.encoder_m(0.0) for drive in self._drives]) * self.metres
            self._history = MotionHistory(first.tolist(), self.acting)
        units = np.broadcast_to(self.metres, (len(self._drives),))
        for index, (drive, unit) in enumerate(zip(self._drives, units.tolist(), strict=True)):
            if not isinstance(drive, MotionSource):
                continue
            for motion in drive.motions_after(self._seen_s(index)):
                if motion.start_s <= t_s:
                    self._history.add(
                        index,
                        motion.start_s,
                        motion.end_s,
                        motion.to_m * unit,
                        motion.speed_m_per_s * unit,
                        reached_m=motion.from_m * unit,
                        joined_s=self.joined_s,
                    )
        return self._history

    def _seen_s(self, drive: int) -> float:
        """When the last motion that is known began."""
        assert self._history is not None
        return self._history.last_start_s[drive]
