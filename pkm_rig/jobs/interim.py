"""The interim test of the rig's station: its floor nests on both faces, and their certified distance."""

from __future__ import annotations

from calibration.base.errors import InputError
from drivers.errors import DeviceError
from drivers.station.coordinates import StatedAccuracy
from drivers.station.interim_test import InterimLimits, InterimTest, KnownDistance, interim_test
from pkm_rig.rig.devices import INITIAL_SEARCH_WINDOW_RAD, INITIAL_TARGET_TOLERANCE_M
from pkm_rig.rig.rig import Rig


def run_interim_test(rig: Rig) -> InterimTest:
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
    known_distances = (
        [] if length is None else [KnownDistance((length.nests[0], length.nests[1]), length.value_m, length.u_m)]
    )
    accuracy = file.station.accuracy
    stated = StatedAccuracy(accuracy.angle_sd_rad, accuracy.range_sd_m, 1e6 * accuracy.range_scale_u)
    rig.refresh_atmosphere()
    limits = InterimLimits(tolerance_m=INITIAL_TARGET_TOLERANCE_M, window_rad=INITIAL_SEARCH_WINDOW_RAD)
    test_result = interim_test(rig.station, places_m, known_distances, stated, limits)
    rig.station.require_settings()
    return test_result


def require_station(rig: Rig) -> None:
    """Raise DeviceError unless station and nests pass the interim test."""
    if not run_interim_test(rig).passed:
        raise DeviceError(
            rig.station.name,
            "interim test",
            "it failed",
            "see `pkm-rig interim-test`; secure nests and station, or have it adjusted, then check again",
        )
