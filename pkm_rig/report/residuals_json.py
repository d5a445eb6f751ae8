"""What the fit leaves of its readings, by reflector."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.identification.calibration import Calibration


def residuals_json(calibration: Calibration) -> list[dict[str, Any]]:
    """Each reflector: number of readings, RMS, mean and largest residual in standard deviations, over coordinates."""
    observations, white = calibration.reduction.calibration(), calibration.fit.residuals[0]
    smrs = calibration.reduction.recording.machine.smrs
    rows = [(index, observations.smr == index) for index in sorted(set(observations.smr.tolist()))]
    return [
        {
            "reflector": smrs[index].name,
            "on": smrs[index].on,
            "readings": int(np.count_nonzero(of)),
            "rms_sigma": float(np.sqrt(np.mean(white[of] ** 2))),
            "mean_sigma": float(np.linalg.norm(white[of].mean(axis=0))),
            "largest_sigma": float(np.max(np.abs(white[of]))),
        }
        for index, of in rows
    ]
