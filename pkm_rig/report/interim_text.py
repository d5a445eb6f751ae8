"""The result of an interim test, for people and for programs."""

from __future__ import annotations

from typing import Any

from drivers.station.interim_test import InterimTest
from pkm_rig.report.terminal import results


def interim_test_json(result: InterimTest, *, simulated: bool) -> dict[str, Any]:
    """The result for programs."""
    return {
        "station_serial": result.serial,
        "simulated": simulated,
        "passed": result.passed,
        "two_face": {e.nest: {"across_rad": e.across_rad, "up_rad": e.up_rad} for e in result.two_face},
        "distances": [
            {"nests": list(d.nests), "error_m": d.error_m, "expanded_u_m": d.expanded_u_m} for d in result.distances
        ],
        "failures": list(result.failures),
    }


def print_interim_test(result: InterimTest) -> None:
    """The result for people."""
    for face in result.two_face:
        results.print(
            f"nest {face.nest}: two-face error {face.across_rad * 1e6:+.1f} urad across,"
            f" {face.up_rad * 1e6:+.1f} urad up"
        )
    for distance in result.distances:
        results.print(
            f"{' to '.join(distance.nests)}: {distance.error_m * 1e6:+.0f} um"
            f" (U, k = 2: {distance.expanded_u_m * 1e6:.0f} um)"
        )
    results.print("passed" if result.passed else "failed")
