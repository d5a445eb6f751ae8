"""Makes one case: draws a structure, gives it the wanted size on a fresh machine and writes the campaign down.

Drawn are a channel (where it acts), a coordinate, a memory and a random function. Neither the mock's effects nor the
catalogue of the diagnosis are imported, here or in the modules of this package that are used here: what is shared is
the plain machine's mechanics, its station, its weather and its ordinary disturbances.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.structures.acting import OF_DRIVE, OF_STRUT, UNITS, Acting, name_of, places
from benchmarks.structures.coordinates import (
    GRATING_M,
    LAG_ELSE_S,
    LAG_S,
    PLAY,
    SCREW_M,
    Readings,
    lagging,
    within_play,
)
from benchmarks.structures.functions import periodic, positive, scaled, smooth
from benchmarks.structures.kinds import ACCUMULATION, KNOWN, LAG, OUTSIDE, Kind, names_of
from benchmarks.structures.kinds import PLAY as PLAY_MEMORY
from benchmarks.withheld.cases import PROFILES
from benchmarks.withheld.designs import FEW, MACHINE, Designs, Drawn
from benchmarks.withheld.sizes import raw_of
from mock_devices.machine_file import MachineFile
from mock_devices.plant.affected_machine import make_effects
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.plant.thermal import SENSORS
from mock_devices.recordings.maker import MockRecording, SimulatedCampaign

Array = NDArray[np.float64]

KNOWN_CASE, OUTSIDE_CASE, NULL_CASE = "known", "outside", "null"
TURNS = (KNOWN_CASE, OUTSIDE_CASE, KNOWN_CASE, NULL_CASE, KNOWN_CASE, OUTSIDE_CASE)
RAW = (3.0, 5.0, 8.0)  # sigma
VISIBLE = 1.0  # sigma, once the calibration has absorbed what it can
EXCEEDS = 3.0  # raw size over that of the rig's ordinary disturbances
SMALL, SMALL_SHARE = "small", 0.6
MOST_DRAWS = 24
_CLOSE, _STEPS = 0.01, 6


class NoCase(RuntimeError):
    """No draw gave a case; one line."""


@dataclass(frozen=True)
class Structure:
    """A drawn structure: shifts (r, d) of unit root mean square at every reading of the design it was drawn on."""

    kind: Kind
    place: int
    shifts: Array
    direction_rad: float
    axis: tuple[float, float, float]

    def acting(self, machine: MachineFile, size: float) -> Acting:
        """With a size, in the unit of its channel."""
        return Acting(machine, self.kind[0], self.place, size * self.shifts, self.direction_rad, self.axis)


@dataclass(frozen=True)
class Case:
    """A recording and what is true of it (plain data)."""

    recording: MockRecording
    truth: dict[str, Any]


class StructuredCampaign(SimulatedCampaign):
    """A campaign on a machine with its ordinary disturbances and a structure."""

    def __init__(self, drawn: Drawn, seed: int, profile: str, acting: Acting | None) -> None:
        super().__init__(MACHINE, drawn.settings(seed, PROFILES[profile]), drawn.timeline)
        self._acting = acting

    def sight(self, effects: list[Any] | None = None) -> Any:
        """What the station sees; with the structure unless others are given."""
        if effects is None:
            effects = list(make_effects(self.nominal, self.settings, start_s=self.start_s))
            effects += [self._acting] if self._acting is not None else []
        return super().sight(effects)


class Generator:
    """Makes the cases of a seed, each by its number alone."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        # Designs are those of rich campaigns: what a campaign cannot show would say nothing of a diagnosis.
        self._designs = Designs(zlib.crc32(f"structures {seed}".encode()), FEW)

    def case(self, number: int) -> Case:
        """One case; raises NoCase."""
        rng = np.random.default_rng([self.seed, number])
        turn = TURNS[number % len(TURNS)]
        drawn = self._designs.one("rich", rng)
        for _ in range(MOST_DRAWS):
            made = self._draw(turn, drawn, rng)
            if made is not None:
                return replace(made, truth={"key": f"s{self.seed}-{number}", **made.truth})
        raise NoCase(f"structures: {MOST_DRAWS} draws gave no case {number} of seed {self.seed}; take another seed")

    def _draw(self, turn: str, drawn: Drawn, rng: np.random.Generator) -> Case | None:
        seed = int(rng.integers(2**31))
        profile = SMALL if rng.random() < SMALL_SHARE else str(rng.choice(list(PROFILES)))
        raw = float(rng.choice(RAW))
        plain = drawn.bench(seed, PROFILES[profile])
        if turn == NULL_CASE:
            truth = {"kind": turn, "names": [], "raw": 0.0, "visible": 0.0, "profile": profile}
            return Case(StructuredCampaign(drawn, seed, profile, None).record(), truth)
        if raw_of(plain, plain.points_m() - plain.points_m([])) * EXCEEDS > raw:
            profile = SMALL
        kind = draw_kind(turn, rng)
        structure = draw_structure(kind, Readings.of(plain), plain.nominal, rng)
        size = None if structure is None else _size(plain, structure, raw)
        if structure is None or size is None:
            return None
        acting = structure.acting(plain.nominal, size)
        try:
            visible = drawn.visible.visible_size_of_change(_change_m(plain, acting) @ plain.view.rotation)
            if visible < VISIBLE:
                return None
            recording = StructuredCampaign(drawn, seed, profile, acting).record()
        except NoEquilibrium:
            return None
        truth = {
            "kind": turn, "channel": kind[0], "coordinate": kind[1], "memory": kind[2],
            "place": name_of(kind[0], structure.place, plain.nominal), "names": list(names_of(kind)), "size": size,
            "raw": raw, "visible": visible, "profile": profile,
        }  # fmt: skip
        return Case(recording, truth)


def draw_kind(turn: str, rng: np.random.Generator) -> Kind:
    """A row of the tables: each effect as often, of what is outside each channel."""
    of: dict[str, list[Kind]] = {}
    for kind in KNOWN if turn == KNOWN_CASE else OUTSIDE:
        of.setdefault(KNOWN[kind][0] if turn == KNOWN_CASE else kind[0], []).append(kind)
    rows = of[str(rng.choice(list(of)))]
    return rows[int(rng.integers(len(rows)))]


def draw_structure(kind: Kind, readings: Readings, machine: MachineFile, rng: np.random.Generator) -> Structure | None:
    """A structure of a kind; None where its coordinate does not vary."""
    channel, coordinate, memory = kind
    place = int(rng.choice(places(channel, machine)))
    drives = len(machine.sliders)
    owner = int(rng.integers(drives))
    if channel in OF_DRIVE:
        owner = place
    elif channel in OF_STRUT:
        owner = machine.struts[place].drive
    part = str(rng.choice(SENSORS))
    seed = int(rng.integers(2**31))
    owners = range(drives) if channel == "drives" else (owner,)
    # One function for all drives, of the coordinate that each has.
    columns = [_values(coordinate, memory, readings, own, part, np.random.default_rng(seed)) for own in owners]
    if any(column is None for column in columns):
        return None
    shifts = np.stack([column for column in columns if column is not None], axis=1)
    size = float(np.sqrt(np.mean(shifts**2)))
    if not size > 0.0:
        return None
    axis = rng.standard_normal(3)
    x, y, z = (axis / np.linalg.norm(axis)).tolist()
    return Structure(kind, place, shifts / size, float(rng.uniform(0.0, 2.0 * np.pi)), (x, y, z))


def _values(
    coordinate: str, memory: str, readings: Readings, own: int, part: str, rng: np.random.Generator
) -> Array | None:
    """A random function (r,) of a coordinate as it is remembered; None where that does not vary."""
    signed, name = coordinate.startswith("side*"), coordinate.removeprefix("side*")
    x = _remembered(name, memory, readings, readings.coordinate(name, own, part), rng)
    if not np.ptp(x) > 0.0:
        return None
    if name in ("turn", "grating"):
        period_m = float(np.exp(rng.uniform(*np.log(SCREW_M if name == "turn" else GRATING_M))))
        return periodic(rng)(x / period_m)
    if signed:
        return np.asarray(readings.side[:, own] * positive(rng)(scaled(x)))
    if name == "velocity":  # seen at another moment: against the way that it goes, more or less of it by its speed
        return np.asarray(np.sign(readings.velocity_m_per_s[:, own]) * x * positive(rng)(scaled(x)))
    values = smooth(rng)(scaled(x))
    return np.asarray(values - values.mean())


def _remembered(name: str, memory: str, readings: Readings, x: Array, rng: np.random.Generator) -> Array:
    if memory == LAG:
        tau_s = float(np.exp(rng.uniform(*np.log(LAG_S.get(name, LAG_ELSE_S)))))
        return lagging(readings.t_s, x, tau_s)
    of_visits = readings.of_visits(x)
    if memory == PLAY_MEMORY:
        half_width = 0.5 * float(np.ptp(x)) * float(rng.uniform(*PLAY))
        return readings.at_visits(within_play(of_visits, half_width))
    if memory == ACCUMULATION:
        return readings.at_visits(np.cumsum(np.abs(np.diff(of_visits, prepend=of_visits[0]))))
    return x


def _change_m(plain: SimulatedCampaign, acting: Acting) -> Array:
    """Noise-free change of the readings (r, 3) by a structure alone, in the station's frame."""
    with_it: list[Any] = [acting]
    return np.asarray(plain.points_m(with_it) - plain.points_m([]))


def _size(plain: SimulatedCampaign, structure: Structure, raw: float) -> float | None:
    """The size that gives a raw size; None where that is more than a machine may have."""
    size, most = UNITS[structure.kind[0]]
    for _ in range(_STEPS):
        try:
            found = raw_of(plain, _change_m(plain, structure.acting(plain.nominal, size)))
        except NoEquilibrium:
            return None
        if abs(found - raw) <= _CLOSE * raw:
            return size
        if not found > 0.0:
            return None
        size *= raw / found
        if size > most:
            return None
    return None
