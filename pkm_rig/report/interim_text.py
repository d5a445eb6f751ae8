"""What an interim test found, for people and for programs."""

from __future__ import annotations

from typing import Any

from drivers.station.interim_test import InterimTest
from pkm_rig.report.terminal import results


def interim_test_json(found: InterimTest) -> dict[str, Any]:
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


def print_interim_test(found: InterimTest) -> None:
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
