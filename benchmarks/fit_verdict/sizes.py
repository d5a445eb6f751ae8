"""Raw sizes that diagnoses have stated beside the true ones: by them the constants of their uncertainty are fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calibration.diagnosis.cause_size import absorbed_share, relative_u_of_form
from calibration.diagnosis.result import Diagnosis
from calibration.diagnosis.settings import VerdictSettings

Array = NDArray[np.float64]
TAILS = 4.0  # degrees of freedom: a size that is far off says little of how far sizes usually are


@dataclass(frozen=True)
class KeptSizes:
    """Of effects (n) that were named right, at one place: by what share of the stated size the true one is off it, the
    share of its standard uncertainty that comes from the fit, and the share of it that the calibration absorbs."""

    off: Array
    u_of_fit: Array
    absorbed: Array

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, Any]]) -> KeptSizes:
        """Of rows with `size`, as `kept_size` gives it."""
        sizes = [row["size"] for row in rows if row["size"] is not None]
        return cls(*(np.array([size[key] for size in sizes]) for key in ("off", "u_of_fit", "absorbed")))

    def __len__(self) -> int:
        return len(self.off)

    def standard_uncertainties(self, settings: VerdictSettings) -> Array:
        """Shares (n,) of the stated size, as a diagnosis with these settings states them."""
        return np.asarray(np.hypot(self.u_of_fit, relative_u_of_form(self.absorbed, settings)))

    def log_scores(self, settings: VerdictSettings) -> Array:
        """Log density (n,) of the deviations."""
        return np.asarray(stats.t.logpdf(self.off, TAILS, scale=self.standard_uncertainties(settings)))

    def covered(self, settings: VerdictSettings) -> NDArray[np.bool_]:
        """Cases (n,) whose true size is within U (k = 2)."""
        return np.asarray(np.abs(self.off) <= 2.0 * self.standard_uncertainties(settings))


def kept_size(diagnosis: Diagnosis, raw: Mapping[str, float]) -> dict[str, float] | None:
    """What is kept of the size of a diagnosis; raw: true ones in sigma by effect. None where the verdict is none of
    these, or acts at several places."""
    found = next((effect for effect in diagnosis.effects if effect.effect == diagnosis.verdict), None)
    if (
        found is None
        or found.effect not in raw
        or len(found.places) != 1
        or not found.raw_sigma
        or not found.size.value
    ):
        return None
    absorbed = absorbed_share(found.raw_sigma, found.visible_sigma)
    of_fit = np.sqrt(max((found.size.u / found.size.value) ** 2 - float(relative_u_of_form(absorbed)) ** 2, 0.0))
    return {"off": raw[found.effect] / found.raw_sigma - 1.0, "u_of_fit": float(of_fit), "absorbed": absorbed}
