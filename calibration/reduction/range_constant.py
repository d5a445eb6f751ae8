"""The constant error of a station's ranges, from the certified distance of two nests."""

from __future__ import annotations

import numpy as np

from calibration.instruments import station_geometry
from calibration.recording.recording import Recording


def range_constant_of(recording: Recording) -> tuple[float, float]:
    """The range constant, to be subtracted from ranges, and its standard uncertainty, in m.

    From the certified distance of two nests, at every check in which both were measured, and the station's certificate;
    zero and the certificate's uncertainty without such a distance. All set-ups have one constant.
    """
    accuracy = recording.file.station.accuracy
    scale_u = accuracy.range_scale_u * float(np.mean(np.linalg.norm(recording.positions_m, axis=1)))
    length = recording.file.nest_length
    nests = recording.rows("nests")
    names = np.asarray(nests["smr"])
    prior = float(np.hypot(accuracy.range_constant_u_m, scale_u))
    if length is None or not all(np.any(names == n) for n in length.nests):
        return 0.0, prior
    common = np.intersect1d(
        nests["nest_check"][names == length.nests[0]], nests["nest_check"][names == length.nests[1]]
    )
    mean, cov = [], []
    for nest in length.nests:
        rows = [np.flatnonzero((names == nest) & (nests["nest_check"] == c)) for c in common]
        mean.append(np.array([nests.positions_m[r].mean(axis=0) for r in rows]))
        cov.append(np.array([nests.covariances_m2[r].mean(axis=0) / len(r) for r in rows]))
    return station_geometry.range_constant(mean[0], mean[1], cov[0], cov[1], length.to_certified_length(), prior)
