"""Pairs of campaigns: drawn machines, what changed on them or not, and all that differs without being a change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.comparison import planar, spatial
from benchmarks.comparison.change import Array, Change, Curve, both
from benchmarks.comparison.visible import VisibleScale, derivatives, even, rms, straight
from benchmarks.structures.functions import scaled, smooth
from calibration.machine.description import Machine
from calibration.recording.recording import Recording
from mock_devices.known_tables import draw_known_tables
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.settings import DisturbanceLevels, InstrumentProfile

NOTHING = "nothing"
FAMILIES = ("planar4", "planar4", "planar4", "stewart6", "delta6")  # of five fives of pairs
OF_FIVE = (NOTHING, NOTHING, "", "", "")
STRUCTURE = {
    "drive_offset": "drive_offset",
    "drive_scale": "drive_scale",
    "column": "column",
    "strut_length": "strut",
    "strut_stiffness": "strut",
    "screw_curve": "screw_curve",
    "nest_platform": "nest",
    "nest_floor": "nest",
}
VISIBLE = (1.0, 8.0)  # sigma, log-uniform
MOST = {"drive_scale": 1.0e-3, "strut_stiffness": 1.6}  # of what a part may change by
MOST_M = 2.0e-3
FIRST = 2.0e-5  # with which a size is tried first, m
DESIGNS = 4
DECLARED_WITHIN = 0.35  # log-normal: how far the declared levels are from the true ones
CURVE_M = 4.0e-6  # largest RMS of a screw's error that both campaigns have
MOST_DRAWS = 60
EXCEEDS = 3.0
STATIONS = ("as before", "set up anew", "other instrument")
OTHER_INSTRUMENTS = (
    InstrumentProfile(angle_sd_rad=1.5e-6, range_sd_m=5.0e-5, drift_m=5.0e-6),
    InstrumentProfile(angle_sd_rad=4.0e-6, range_sd_m=2.0e-4, range_constant_u_m=2.0e-4),
)


@dataclass(frozen=True)
class Pair:
    """Two recordings, and what is true of them (plain data)."""

    before: Recording
    after: Recording
    truth: dict[str, Any]


def make_pair(seed: int, number: int) -> Pair:
    """One pair, by its number alone."""
    rng = np.random.default_rng([seed, number])
    family = FAMILIES[number // len(OF_FIVE) % len(FAMILIES)]
    nothing = bool(OF_FIVE[number % len(OF_FIVE)])
    for _ in range(MOST_DRAWS):
        made = _Drawing(family, rng).pair(nothing)
        if made is not None:
            return replace(made, truth={"family": family, **made.truth})
    raise RuntimeError(f"comparison: {MOST_DRAWS} draws gave no pair {number} of seed {seed}; take another seed")


class _Drawing:
    """One attempt at a pair."""

    def __init__(self, family: str, rng: np.random.Generator) -> None:
        self.family, self.rng = family, rng
        self.planar = family == planar.NAME
        self.machine: Machine = planar.nominal()[1] if self.planar else spatial.machine_of(family)[1]
        self.machine_seed = int(rng.integers(2**31))
        self.levels = DisturbanceLevels(
            drift_m=rng.uniform(1e-6, 5e-6),
            reseat_m=rng.uniform(1e-6, 3e-6),
            reversal_m=rng.uniform(0.5e-6, 2e-6),
            temperature_k=rng.uniform(0.01, 0.03),
        )
        self.station = str(rng.choice(STATIONS))
        self.tables = self.planar and rng.random() < 0.15
        self.always = Change(
            travel={
                a: _curve(rng, self.machine.travel[a], float(rng.uniform(0.0, CURVE_M)))
                for a in range(len(self.machine.drive_names))
            }
        )

    def pair(self, nothing: bool) -> Pair | None:
        """Recordings and truth; None where the change that was drawn cannot be seen or cannot be."""
        rng = self.rng
        designs = int(rng.integers(DESIGNS)), int(rng.integers(DESIGNS))
        seeds, stations = rng.integers(2**31, size=2).tolist(), rng.integers(2**31, size=2).tolist()
        if self.station == STATIONS[0]:
            stations[1] = stations[0]
        campaigns = [self.campaign(k, designs[k], seeds[k], stations[k]) for k in range(2)]
        truth: dict[str, Any] = {
            "kind": NOTHING, "structure": NOTHING, "place": "", "visible": 0.0, "station": self.station,
            "tables": bool(self.tables), "same_design": designs[0] == designs[1],
        }  # fmt: skip
        change = Change()
        if not nothing:
            drawn = self.change(campaigns, designs)
            if drawn is None:
                return None
            change, found = drawn
            truth |= found
        before = self.recorded(campaigns[0](both(self.always, self.reseated())), "first")
        try:
            after = self.recorded(campaigns[1](both(both(self.always, self.reseated()), change)), "second")
        except (NoEquilibrium, ArithmeticError):
            return None
        return Pair(before, after, truth)

    def campaign(self, number: int, design: int, seed: int, station: int) -> Callable[[Change], Any]:
        """A campaign, once it is known what has changed before it."""
        rng = self.rng
        shop_c = float(rng.uniform(-3.0, 3.0)) if number else 0.0
        if not self.planar:
            at = spatial.Circumstances(seed, station, design, shop_c)
            return lambda change: spatial.SpatialCampaign(self.family, self.machine_seed, at, self.levels, change)
        moved, turned = rng.uniform(-0.4, 0.4, 3), float(rng.uniform(-0.1, 0.1))
        place, heading, instrument = (0.0, 0.3, 3.2), 0.0, InstrumentProfile()
        if number and self.station != STATIONS[0]:
            place, heading = (float(moved[0]), 0.3 + float(moved[1]), 3.2 + float(moved[2])), turned
        if number and self.station == STATIONS[2]:
            instrument = OTHER_INSTRUMENTS[int(rng.integers(len(OTHER_INSTRUMENTS)))]
        tables = draw_known_tables(planar.nominal()[0], rng) if self.tables else ()
        flat = planar.Circumstances(
            seed, station, design, instrument, place, heading, shop_c, tables, bool(number and self.tables)
        )
        return lambda change: planar.PlanarCampaign(self.machine_seed, flat, self.levels, change)

    def reseated(self) -> Change:
        """Every reflector was put into its nest anew."""
        shifts = self.levels.reseat_m * self.rng.standard_normal((len(self.machine.smrs), 3))
        return Change(smr_m={i: (x, y, z) for i, (x, y, z) in enumerate(shifts.tolist())})

    def recorded(self, campaign: Any, name: str) -> Recording:
        """The recording, whose levels are declared nearly as they are."""
        recording: Recording = campaign.recording(name)
        off = np.exp(DECLARED_WITHIN * self.rng.standard_normal(4)).tolist()
        levels = recording.file.nuisance
        declared = {
            key: getattr(levels, key) * factor for key, factor in zip(type(levels).model_fields, off, strict=True)
        }
        file = recording.file.model_copy(update={"nuisance": type(levels)(**declared)})
        return replace(recording, file=file)

    def change(self, campaigns: list[Callable[[Change], Any]], designs: tuple[int, int]) -> Any:
        """A change that is seen as drawn, and what is true of it; None if it would have to be larger than can be."""
        rng = self.rng
        kinds = [k for k in STRUCTURE if k != "column" or "slider" in self.machine.drive_kinds]
        kind = str(rng.choice(kinds))
        place, unit, rows_of = self.unit(kind)
        still = campaigns[0](Change()), campaigns[1](Change())
        scale = VisibleScale(still, self.errors(designs), self.stands(still), (1.0e-4, 1.0e-6))
        smr, samples = (still[1].timeline.smr, still[1].timeline.samples) if self.planar else (
            still[1].design.smr, still[1].design.samples
        )  # fmt: skip
        rows = still[1].platform if rows_of is None else smr == rows_of
        moving = int(np.sum(self.machine.dof < 3))
        wanted = float(np.exp(rng.uniform(*np.log(VISIBLE))))
        size, reached = FIRST if kind not in MOST else 0.1 * MOST[kind], 0.0
        for _ in range(3):
            try:
                reached = rms(scale.left(unit.times(size)), rows, samples, moving)
            except (NoEquilibrium, ArithmeticError):
                return None
            if not reached > 0.0 or abs(reached - wanted) < 0.02 * wanted:
                break
            size *= wanted / reached
            if size > MOST.get(kind, MOST_M):
                return None
        change = unit.times(size)
        if reached < VISIBLE[0] or _within_reseating(change, self.levels):
            return None
        found = {
            "kind": kind, "structure": STRUCTURE[kind], "place": place, "visible": reached, "size": size,
            "value": _value(kind, change),
        }  # fmt: skip
        return change, found

    def errors(self, designs: tuple[int, int]) -> tuple[Array, Array]:
        """Derivatives of both designs on a reference machine."""
        out = []
        for number in designs:
            if self.planar:
                at = planar.Circumstances(1, 1, number)
                reference: Any = planar.PlanarCampaign(1, at, DisturbanceLevels(), Change())
            else:
                spot = spatial.Circumstances(1, 1, number)
                reference = spatial.SpatialCampaign(self.family, 1, spot, DisturbanceLevels(), Change())
            out.append(derivatives((self.family, number), self.machine, reference))
        return out[0], out[1]

    def stands(self, campaigns: tuple[Any, Any]) -> tuple[Array, Array]:
        """Where the stations are, in the machine's frame."""
        views = [c.view if self.planar else c for c in campaigns]
        first, second = (-v.rotation.T @ v.translation_m for v in views)
        return first, second

    def unit(self, kind: str) -> tuple[str, Change, int | None]:
        """A change of unit size: its place, itself, and the reflector at which it is seen (None: the platform's)."""
        rng, machine = self.rng, self.machine
        a, i = int(rng.integers(len(machine.drive_names))), int(rng.integers(len(machine.strut_names)))
        sign = float(rng.choice([-1.0, 1.0]))
        drive, strut = machine.drive_names[a], machine.strut_names[i]
        of_parts: dict[str, Callable[[], tuple[str, Change]]] = {
            "drive_offset": lambda: (drive, Change(travel={a: even(sign)})),
            "drive_scale": lambda: (drive, Change(travel={a: straight(sign)})),
            "screw_curve": lambda: (drive, Change(travel={a: _curve(rng, machine.travel[a], 1.0)})),
            "strut_length": lambda: (strut, Change(length_m={i: sign})),
            "strut_stiffness": lambda: (strut, Change(ln_stiffness={i: sign})),
            "column": lambda: (drive, self.column(a)),
        }
        if kind in of_parts:
            return *of_parts[kind](), None
        on = "platform" if kind == "nest_platform" else "floor"
        smr = int(rng.choice([k for k, one in enumerate(machine.smrs) if one.on == on]))
        x, y, z = (rng.standard_normal(3) * np.array([1.0, 1.0, 0.2 if machine.planar else 1.0])).tolist()
        return machine.smrs[smr].name, Change(smr_m={smr: (x, y, z)}), None if on == "platform" else smr

    def column(self, a: int) -> Change:
        """A column that was knocked: it stands elsewhere, leans, or both."""
        rng, axis = self.rng, self.machine.nominal.axis[a]
        way = int(rng.integers(3))
        shift, tilt = rng.standard_normal(3), rng.standard_normal(3)
        if self.machine.planar:
            shift, tilt = np.array([shift[0], shift[1], 0.0]), np.array([0.0, 0.0, tilt[2]])
        shift, tilt = shift - axis * (axis @ shift), tilt - axis * (axis @ tilt)
        out = Change()
        if way != 1:
            x, y, z = shift.tolist()
            out = both(out, Change(column_shift_m={a: (x, y, z)}))
        if way != 0:
            x, y, z = tilt.tolist()
            out = both(out, Change(column_tilt_rad={a: (x, y, z)}))
        return out


def _within_reseating(change: Change, levels: DisturbanceLevels) -> bool:
    """Whether a reflector has moved less than three times what putting it back moves it: then it is a nuisance."""
    moved = [float(np.linalg.norm(shift[:2])) for shift in change.smr_m.values()]
    return any(m < EXCEEDS * np.sqrt(2.0) * levels.reseat_m for m in moved)


def _value(kind: str, change: Change) -> float | None:
    """The number of a change that has one number, in SI units."""
    if kind in ("drive_offset", "drive_scale"):
        (curve,) = change.travel.values()
        return float(curve(np.ones(1))[0])
    if kind in ("strut_length", "strut_stiffness"):
        (value,) = (*change.length_m.values(), *change.ln_stiffness.values())
        return value
    return None


def _curve(rng: np.random.Generator, travel: Array, rms_m: float) -> Curve:
    """A random smooth curve over a drive's travel, without offset and slope, of a root mean square."""
    draw, grid = smooth(rng), np.linspace(*travel, 200)
    values = draw(scaled(grid))
    line = np.polyfit(grid, values, 1)
    factor = rms_m / float(np.sqrt(np.mean((values - np.polyval(line, grid)) ** 2)))
    low, high = travel.tolist()
    return lambda q: factor * (draw((2.0 * q - low - high) / (high - low)) - np.polyval(line, q))
