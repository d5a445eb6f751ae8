"""pygeocom as a client of the mock station: identity, distance mode, atmosphere, turning, aiming, measuring."""

from __future__ import annotations

import contextlib
import io
import json
import math
import sys
from collections.abc import Callable
from typing import Any


def say(check: str, ok: bool, detail: object = "") -> None:
    """One line for the caller."""
    print(json.dumps({"check": check, "ok": bool(ok), "detail": str(detail)}), flush=True)


def main() -> None:
    """Talk to the station at the port given, where one reflector is seen in the direction given."""
    from geocom.enums import EDMMeasurementMode  # noqa: PLC0415  there only where the peer was fetched
    from geocom.TotalStation import TotalStation  # noqa: PLC0415

    port, hz, v = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
    with contextlib.redirect_stdout(io.StringIO()):
        station: Any = TotalStation(port, baudrate=115200)

    def quiet(work: Callable[..., Any], *arguments: Any) -> Any:
        with contextlib.redirect_stdout(io.StringIO()):
            return work(*arguments)

    say("identity", quiet(station.get_instrument_number) == 990001, quiet(station.get_instrument_name))
    mode = list(EDMMeasurementMode)[2]
    quiet(station.set_edm_mode, mode)
    say("distance mode set and read back", quiet(station.get_edm_mode) == mode, mode)
    air = quiet(station.get_atm_correction)
    quiet(station.set_atm_correction, air)
    say("atmosphere read and set", True, air)
    turned = quiet(station.request, f"%R1Q,9027:{hz},{v},0,0,0")
    say("turned", turned[0].value == 0, turned[0])
    aimed = quiet(station.request, "%R1Q,9037:0.05,0.05,0")
    say("aimed", aimed[0].value == 0, aimed[0])
    quiet(station.request, "%R1Q,2008:1,1")
    measured = quiet(station.request, "%R1Q,2108:5000,1")
    distance_m = float(measured[3])
    say("measured", measured[0].value == 0 and 1.0 < distance_m < 5.0 and math.isfinite(distance_m), distance_m)
    refused = quiet(station.request, "%R1Q,107:99")
    say("a bad parameter is refused", refused[0].value == 2, refused[0])


if __name__ == "__main__":
    main()
