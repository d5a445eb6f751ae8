"""A reading that is left out because it is wrong, named for people and programs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

NEST, VISIT, MODEL = "nest outlier", "innovation gate", "model gate"


@dataclass(frozen=True)
class LeftOutReading:
    """One wrong reading.

    name: its uid, or file and line; of: reflector or kind of reading; size: of the deviation from what the other
    readings say, in `unit`; sigmas: the same in the reading's own standard deviations (calibration.base.outliers).
    """

    name: str
    of: str
    size: float
    unit: Literal["m", "rad"]
    sigmas: float
    reason: str

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)
