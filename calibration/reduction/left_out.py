"""A reading that is left out because it is wrong, named for people and programs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from calibration.recording.recording import Recording

NEST, VISIT, MODEL = "nest outlier", "innovation gate", "model gate"
GIANT, DIAGNOSIS, BESIDE_CAUSES = "giant", "diagnosis gate", "beside the causes"


@dataclass(frozen=True)
class LeftOutReading:
    """One wrong reading.

    name: its uid, or file and line; of: reflector or kind of reading; size: of the deviation from what the other
    readings say, in `unit`; sigmas: the same in the reading's own standard deviations (calibration.base.outliers).
    visit: its number; t_rig_s: rig time in its middle; None where that is not known or where there are two.
    """

    name: str
    of: str
    size: float
    unit: Literal["m", "rad"]
    sigmas: float
    reason: str
    visit: int | None = None
    t_rig_s: float | None = None

    @classmethod
    def of_recording(cls, recording: Recording, row: int, size_m: float, sigmas: float, reason: str) -> LeftOutReading:
        """Of a row of a recording."""
        uid, smr = str(recording["uid"][row]), str(recording["smr"][row])
        visit, t_rig_s = int(recording["visit"][row]), float(recording["t_rig_s"][row])
        return cls(uid, smr, float(size_m), "m", float(sigmas), reason, visit, t_rig_s)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)
