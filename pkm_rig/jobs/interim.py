"""The interim test of the rig's station: its floor nests on both faces, and their certified distance."""

from __future__ import annotations

from typing import Any

from calibration.base.errors import InputError
from drivers.coordinates import StatedAccuracy
from drivers.interim_test import InterimLimits, InterimTest, KnownDistance, interim_test
from pkm_rig.report.terminal import results
from pkm_rig.rig.devices import WRONG_TARGET_AT_FIRST_M
from pkm_rig.rig.rig import Rig


def run(rig: Rig) -> InterimTest:
    """Measure the floor nests and compare; nothing moves but the telescope. InputError without nests."""
    frame, file = rig.rough_frame(), rig.file
    places_m: dict[str, tuple[float, float, float]] = {}
    for smr in rig.machine.smrs:
        if smr.on == "floor":
            e, n, h = (float(x) for x in frame.to_station(smr.position_m[None])[0])
            places_m[smr.name] = (e, n, h)
    if not places_m:
        raise InputError("machine file: no floor nest; the interim test needs at least one")
    length = file.nest_length
    known = [] if length is None else [KnownDistance((length.nests[0], length.nests[1]), length.value_m, length.u_m)]
    accuracy = file.station.accuracy
    stated = StatedAccuracy(accuracy.angle_sd_rad, accuracy.range_sd_m, 1e6 * accuracy.range_scale_u)
    rig.refresh_atmosphere()
    found = interim_test(rig.station, places_m, known, stated, InterimLimits(tolerance_m=WRONG_TARGET_AT_FIRST_M))
    rig.station.require_settings()
    return found


def as_json(found: InterimTest) -> dict[str, Any]:
    """The result for programs."""
    return {
        "station_serial": found.serial,
        "passed": found.passed,
        "two_face": {e.nest: {"across_rad": e.across_rad, "up_rad": e.up_rad} for e in found.two_face},
        "distances": [
            {"nests": list(d.nests), "error_m": d.error_m, "expanded_u_m": d.expanded_u_m} for d in found.distances
        ],
        "failures": list(found.failures),
    }


def show(found: InterimTest) -> None:
    """The result for people."""
    for face in found.two_face:
        results.print(
            f"nest {face.nest}: two-face error {face.across_rad * 1e6:+.1f} urad across,"
            f" {face.up_rad * 1e6:+.1f} urad up"
        )
    for distance in found.distances:
        results.print(
            f"{' to '.join(distance.nests)}: {distance.error_m * 1e6:+.0f} um"
            f" (U, k = 2: {distance.expanded_u_m * 1e6:.0f} um)"
        )
    results.print("passed" if found.passed else "failed")
