"""What a campaign that is still being measured has told so far, computed in a process of its own.

`python -m pkm_rig.jobs.running_estimate OUT CAMPAIGN` prints one JSON object; with low priority, and only reading, so
that whoever measures and supervises is not kept waiting.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.calibration import Calibration, identify_recording
from calibration.identification.prediction import predict_poses
from calibration.machine.inverse import nominal_drives
from calibration.recording.recording import Recording
from pkm_rig.errors import StoreError
from pkm_rig.results.estimate import Estimate
from pkm_rig.store.store import open_existing_store

NICE = 10
PER_AXIS = 9


def estimate_so_far(recording: Recording) -> Estimate:
    """Identify what there is of a campaign. InputError while that is too little."""
    identified = identify_recording(recording, baselines=False)
    fit = identified.fit
    sigma = fit.model.parameters.sigma
    share = float(np.exp(np.mean(np.log(fit.theta_u / sigma))))
    known = int(np.sum(fit.theta_u < 0.5 * sigma))
    field_m, error_m = _error_field(identified)
    line = (
        f"after {len(recording)} readings: {known} of {len(sigma)} parameters are known to less than half their "
        f"tolerance; readings scatter {np.sqrt(fit.chi2_per_dof):.2f} times as much as is stated of them; predicted "
        f"error of the tool {np.sqrt(np.mean(error_m**2)) * 1e6:.0f} um RMS"
    )
    return Estimate(len(recording), share, line, field_m, error_m, PER_AXIS)


def _error_field(identified: Calibration) -> tuple[Array, Array]:
    recording = identified.reduction.recording
    machine = recording.machine
    axes = [np.linspace(low, high, PER_AXIS) for low, high in machine.workspace[:2]]
    target = np.repeat(machine.workspace.mean(axis=1)[None], PER_AXIS**2, axis=0)
    target[:, :2] = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    temperatures = {name: float(values[-1]) for name, values in recording.temperatures_c().items()}
    at = identified.operating_conditions(0, temperatures).at_poses(nominal_drives(machine, target), target)
    pose = predict_poses(identified.fit, identified.report, at)
    error = identified.report.tool_error(pose, target)[0]
    return target[:, :3], np.linalg.norm(error, axis=1)


def main(out: str, campaign: str) -> None:
    """Print the estimate of a stored campaign, or nothing where there is none yet."""
    os.nice(NICE)
    try:
        with open_existing_store(Path(out)) as store:
            recording = store.recording(campaign)
        print(json.dumps(estimate_so_far(recording).as_dict(), allow_nan=False))
    except (InputError, StoreError, ValueError, np.linalg.LinAlgError):
        return


if __name__ == "__main__":
    main(*sys.argv[1:3])
