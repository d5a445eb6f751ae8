"""Ten rigs with an effect each, measured over the real protocols, against the maker of recordings.

    python -m benchmarks.withheld.over_the_wire

Drives are moved over CAN, payloads exchanged over Modbus, reflectors measured over GeoCOM, without noise. The motions
that the drives really made become a timeline, and the code that makes recordings says what is to be seen at the same
moments. Prints the largest difference of a point; exit status 1 if it is above a nanometre.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.station.polar import PolarReading
from mock_devices.plant.atmosphere import ppm
from mock_devices.plant.base_plant import ReadingNoise
from mock_devices.plant.plant import Plant
from mock_devices.recordings.columns import points
from mock_devices.recordings.design import Design, Visit
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.recordings.timeline import Timeline
from mock_devices.rig import MockRig
from pkm_rig.rig.config import embedded_rig_path, load_rig, machine_path
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.rig import Rig
from pkm_rig.virtual.mock_rig import embedded_mock_rig

Array = NDArray[np.float64]

EFFECTS = (
    "backlash=2e-5,place=right,variant=closing",
    "friction_windup=2e-8,variant=stribeck",
    "servo_settling=2e-4,place=right,tau_s=10",
    "column_compliance=1e-8,variant=cantilever",
    "link_stiffness=0.7,place=left_lower",
    "joint_clearance=2e-5,place=right_lower,variant=soft_contact",
    "encoder_interpolation=5e-6,variant=both",
    "guide_angular=3e-5,variant=irregular",
    "screw_thermal_growth=3",
    "tracker_drift=4e-5,variant=random_walk",
)
LARGEST_M = 1.0e-9
STOPS = ((1.20, 1.10), (1.25, 1.00), (1.15, 1.10), (1.1500005, 1.10), (1.02, 1.21))
PAYLOAD_FROM = 3  # of the stops


@dataclass
class _Quiet:
    """In place of the plant's noise: none, and a note of when, where and what was measured."""

    mock: MockRig
    t_s: list[float] = field(default_factory=list)
    smr: list[int] = field(default_factory=list)
    q_m: list[list[float]] = field(default_factory=list)
    payload: list[int] = field(default_factory=list)

    def __call__(self, smr: int, t_s: float) -> ReadingNoise:
        self.t_s.append(t_s)
        self.smr.append(smr)
        self.q_m.append([drive.encoder_m(t_s) for drive in self.mock.drives])
        self.payload.append(self.mock.plant.payload)
        return ReadingNoise(0.0, 0.0, 0.0)


def difference_m(effect: str) -> float:
    """Largest distance of a measured point of one rig from what the maker of recordings says."""
    with _rig(effect) as (mock, rig):
        plant = mock.plant
        assert isinstance(plant, Plant)  # of the embedded rig
        _without_noise(plant)
        start_m = tuple(drive.encoder_m(0.0) for drive in mock.drives)
        note = _Quiet(mock)
        plant.reading_noise = note  # type: ignore[method-assign]
        readings = _measured(rig, plant)
        motions = sorted(
            ((m.start_s, a, m) for a, drive in enumerate(mock.drives) for m in drive.motions_after(-1.0)),
            key=lambda entry: entry[:2],
        )
    line = _timeline(plant, note, start_m, tuple((a, motion) for _, a, motion in motions))
    bench = SimulatedCampaign(machine_path(load_rig(embedded_rig_path())[0], embedded_rig_path()), plant.settings, line)
    sight, _, _ = bench.sight()
    rows, k = np.arange(len(line)), line.smr
    air = [
        ppm(plant.thermal.air_c(t), plant.thermal.pressure_hpa(t), humidity=plant.thermal.humidity()) for t in note.t_s
    ]
    raw = sight.distance_m[rows, k] * bench.view.range_scale + bench.view.range_constant_m
    ppm_of_readings = np.array([reading.ppm for reading in readings])
    distance = raw * (1.0 + (ppm_of_readings - np.array(air)) * 1.0e-6)
    expected = points(sight.hz_rad[rows, k], sight.v_rad[rows, k], distance)
    points_m = points(*(np.array([getattr(r, n) for r in readings]) for n in ("hz_rad", "v_rad", "slope_distance_m")))
    return float(np.linalg.norm(points_m - expected, axis=1).max())


def largest_difference_m(effects: tuple[str, ...] = EFFECTS) -> float:
    """Of all rigs."""
    return max(difference_m(effect) for effect in effects)


@contextmanager
def _rig(effect: str) -> Iterator[tuple[MockRig, Rig]]:
    file, machine = load_rig(embedded_rig_path())
    assert file.mock is not None
    file = file.model_copy(update={"mock": file.mock.model_copy(update={"effects": (effect,), "seed": 5})})
    with (
        embedded_mock_rig(file, embedded_rig_path()) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory) as rig,
    ):
        yield mock.mock, rig


def _without_noise(plant: Plant) -> None:
    """Errors of the two faces are the protocol's business; what stays is drawn already."""
    instrument = replace(plant.settings.instrument, collimation_rad=0.0, vertical_index_rad=0.0)
    plant.settings = replace(plant.settings, instrument=instrument)


def _measured(rig: Rig, plant: Plant) -> list[PolarReading]:
    """Go to every stop and measure all that is not on the floor."""
    readings = []
    rig.enable()
    for number, stop in enumerate(STOPS):
        if number == PAYLOAD_FROM:
            rig.change_payload(2)
        rig.move(np.array(stop), 0.3)
        rig.clock.sleep_s(2.0)
        for index, smr in enumerate(plant.nominal.smrs):
            if smr.on == "floor":
                continue
            polar = plant.sightings(rig.clock.now_s())[index].polar
            rig.station.point_and_aim(polar.hz_rad, polar.v_rad)
            readings += rig.station.measure(1)
        rig.clock.sleep_s(0.5)  # the next motion does not begin at the very moment of a reading
    return readings


def _timeline(plant: Plant, note: _Quiet, start_m: tuple[float, ...], motions: tuple) -> Timeline:  # type: ignore[type-arg]
    n = len(note.t_s)
    design = Design((Visit(0j, (1, 1)),), tuple(smr.name for smr in plant.nominal.smrs), start_s=0.0)
    payload = np.array(note.payload, dtype=np.intp)
    exchanges = np.concatenate([[0.0], np.cumsum(np.diff(payload) != 0)])
    zero = np.zeros(n, dtype=np.intp)
    return Timeline(
        design=design,
        machine=plant.nominal,
        start_m=start_m,
        motions=motions,
        t_s=np.array(note.t_s),
        smr=np.array(note.smr, dtype=np.intp),
        visit=zero,
        check=zero,
        is_nest=np.zeros(n, dtype=np.bool_),
        samples=np.ones(n),
        dwell_s=np.zeros(n),
        payload=payload,
        exchanges=exchanges,
        q_m=np.array(note.q_m),
        velocity_m_per_s=np.zeros((n, len(start_m))),
    )


def main() -> int:
    """Compare all rigs."""
    largest = 0.0
    for effect in EFFECTS:
        difference = difference_m(effect)
        print(f"{effect.partition('=')[0]:24} {difference:.2e} m")
        largest = max(largest, difference)
    print(f"largest difference {largest:.2e} m, allowed {LARGEST_M:g} m")
    return 0 if largest <= LARGEST_M else 1


if __name__ == "__main__":
    sys.exit(main())
