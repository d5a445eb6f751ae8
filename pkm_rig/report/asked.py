"""What a campaign under way asks of whoever operates it, as one thing to do: for the terminal and for the page."""

from __future__ import annotations

from dataclasses import dataclass

from pkm_rig.rig.live import Snapshot

PUT_RIGHT = {  # guards that a rig may lack, in the words of somebody at the machine
    "guard closed": "Close the door of the guard",
    "emergency stop released": "Release the emergency stop",
    "drive power on": "Switch the power of the drives on",
    "air pressure": "Restore the air pressure",
    "local release": "Turn the key of the local release on",
}


@dataclass(frozen=True)
class Asked:
    """The one thing to do next, what it is for, and whether going on is what is left to do."""

    action: str
    why: str
    goes_on: bool


def asked_of(seen: Snapshot, press: str) -> Asked | None:
    """What is asked for now, None where nothing is; `press`: what has the campaign go on, as in `press Enter`."""
    request = seen.request
    if request is None:
        return None
    if request.kind == "payload":
        action = f"Exchange the payload: put {request.of} on" if request.of else "Take the payload off"
        return Asked(action, request.text, goes_on=False)
    missing = [guard.name for guard in seen.guards if guard.light == "bad" and guard.value in ("open", "off")]
    if missing:
        action = PUT_RIGHT.get(missing[0], f"Put right at the machine: {missing[0]}")
        return Asked(action, request.text, goes_on=False)
    if request.kind == "reflector":
        return Asked(
            f"Clean reflector {request.of}, see that nothing stands in its beam, then {press}",
            request.text,
            goes_on=True,
        )
    return Asked(f"See that nobody is at the machine, then {press}", request.text, goes_on=True)
