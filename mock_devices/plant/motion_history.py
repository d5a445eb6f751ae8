"""How each drive came to its position: its legs, for effects with history."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mock_devices.effects.base import Array, Effect, Leg


class MotionHistory:
    """The legs of all drives, in order of time; effects receive each one when the next begins."""

    def __init__(self, positions_m: Sequence[float], effects: Sequence[Effect], start_s: float = 0.0) -> None:
        self._effects = tuple(effects)
        self._legs = [[Leg(start_s, start_s, q, q, 0.0, 0.0)] for q in positions_m]
        self.last_start_s = [start_s] * len(
            self._legs
        )  # of the last motion of each drive, which a leg may have several of

    def legs(self, drive: int) -> list[Leg]:
        """The legs of a drive; the first is its rest before any motion."""
        return self._legs[drive]

    def add(self, drive: int, start_s: float, end_s: float, to_m: float, speed_m_per_s: float, *,
            reached_m: float | None = None, joined_s: float = 0.0) -> None:  # fmt: skip
        """A motion begins. One under way ends there, at `reached_m`, if this one comes before its end.

        One that goes on in the same direction within `joined_s` of the last one's end belongs to its leg.
        """
        legs = self._legs[drive]
        last = legs[-1]
        self.last_start_s[drive] = start_s
        if (
            joined_s
            and len(legs) > 1
            and start_s - last.end_s < joined_s
            and (to_m - last.to_m) * last.direction >= 0.0
        ):
            last.to_m, last.end_s, last.speed_m_per_s = to_m, end_s, max(last.speed_m_per_s, speed_m_per_s)
            return
        if start_s < last.end_s and reached_m is not None:
            last.to_m, last.end_s = reached_m, start_s
        last.until_s = start_s
        for effect in self._effects:
            effect.record_leg(drive, last)
        way = to_m - last.to_m
        direction = float(np.sign(way)) if way else last.direction
        legs.append(Leg(start_s, end_s, last.to_m, to_m, speed_m_per_s, direction))

    def legs_at(self, t_s: Array) -> dict[str, Array]:
        """The leg of each drive at times (n,), and its numbers: (n, d) each, by the names of `MotionState`."""
        columns: dict[str, list[Array]] = {
            name: [] for name in ("leg", "from_m", "leg_start_s", "leg_end_s", "speed_m_per_s", "direction")
        }
        for legs in self._legs:
            if len(t_s) == 1:  # the latest ones are asked for most
                k = len(legs) - 1
                while k > 0 and legs[k].start_s > t_s[0]:
                    k -= 1
                index = np.array([k])
                used = [legs[k]]
                pick = np.zeros(1, dtype=np.intp)
            else:
                starts = np.array([leg.start_s for leg in legs])
                index = np.maximum(np.searchsorted(starts, t_s, side="right") - 1, 0)
                used, pick = legs, index
            columns["leg"].append(index)
            for name, values in (
                ("from_m", [leg.from_m for leg in used]),
                ("leg_start_s", [leg.start_s for leg in used]),
                ("leg_end_s", [leg.end_s for leg in used]),
                ("speed_m_per_s", [leg.speed_m_per_s for leg in used]),
                ("direction", [leg.direction for leg in used]),
            ):
                columns[name].append(np.array(values)[pick])
        return {name: np.stack(parts, axis=1) for name, parts in columns.items()}
