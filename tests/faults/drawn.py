"""Faults drawn from a seed, for the test suite; `make faults` tries them all."""

from __future__ import annotations

import numpy as np

from mock_devices.faults import FAULTS, Fault

SEED = 5
EACH = 50
# How many operations an untouched short campaign has, as `make faults` counts them.
OPERATIONS = {
    **dict.fromkeys((name for name, kind in FAULTS.items() if kind.site == "serial"), 66),
    **dict.fromkeys((name for name, kind in FAULTS.items() if kind.site == "modbus"), 113),
    **dict.fromkeys(("can-lost-frame", "can-bus-off", "can-peer-dead"), 1336),
    "can-other-master": 650,
    "tracker-beam-break": 14,
    "tracker-no-target": 10,
    "tracker-wrong-nest": 10,
    "tracker-drift": 14,
    "tracker-busy": 66,
    "sdo-abort": 405,
    "sdo-toggle": 28,
    "drive-heartbeat": 30,
    "drive-emergency": 73,
    "drive-reboot": 66,
    "time-step": 174,
    "time-step-back": 174,
}


def drawn(*sites: str) -> list[Fault]:
    """Fifty faults of some sites, each at an operation of its own."""
    names = [name for name, kind in FAULTS.items() if kind.site in sites]
    random = np.random.default_rng([SEED, *(ord(letter) for site in sites for letter in site)])
    values: dict[tuple[str, int], Fault] = {}
    while len(values) < EACH:
        name = names[int(random.integers(len(names)))]
        at = int(random.integers(1, OPERATIONS[name] + 1))
        values.setdefault((name, at), Fault(name, at))
    return list(values.values())
