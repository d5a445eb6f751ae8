"""What a campaign has told of its machine while it is still being measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.base.arrays import Array


@dataclass(frozen=True)
class Estimate:
    """`share_left`: geometric mean over the machine parameters of what is left of them, standard uncertainty over
    that of their prior; `field_m` (n, 3), `field_error_m` (n,): predicted error of the tool, without compensation, on a
    grid of `columns` a row.
    """

    readings: int
    share_left: float
    line: str
    field_m: Array
    field_error_m: Array
    columns: int

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "readings": self.readings,
            "share_left": self.share_left,
            "line": self.line,
            "field_m": self.field_m.tolist(),
            "field_error_m": self.field_error_m.tolist(),
            "columns": self.columns,
        }

    @classmethod
    def of_dict(cls, data: Mapping[str, Any]) -> Estimate:
        """From JSON that `as_dict` made."""
        arrays = {name: np.array(data[name], dtype=float) for name in ("field_m", "field_error_m")}
        return cls(
            int(data["readings"]), float(data["share_left"]), str(data["line"]), columns=data["columns"], **arrays
        )
