"""Compensation tables that are active though the drives say that they are off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mock_devices.effects.base import (
    ONSET,
    Array,
    Deviation,
    Effect,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
)
from mock_devices.effects.followers import PlaceMemory
from mock_devices.known_tables import KnownTable, draw_known_tables

FULL_PAYLOAD_KG = 400.0
TABLES_K = 2.0
RAMPS_S = (5.0, 15.0)  # time constant with which a correction is added
COARSE = (0.4, 0.9)  # step of rounded entries over the largest one
HOLDS = (0.45, 0.8)  # largest entry that is stored as it is, over the largest one
FED_M_PER_S = 0.5  # speed at which a whole correction is fed forward
MOVED_M = (0.08, 0.2)  # how far a zero was moved after the tables were taken


class TablesLeftOn(Effect):
    """Tables of one generation are active though the drives say that they are off; `weight_ratio` 1 is the whole table.

    The tables are those on record for the rig, or drawn ones without any on record. `bidirectional`: tables apart for
    each direction of travel, as in FANUC A-77810E, "Bidirectional Pitch Error Compensation Function" (1999).
    `pulses`: a control that does not interpolate gives out a correction where the drive passes a node and holds it up
    to the next: stored pitch error compensation in FANUC B-63943EN-1, "Connection Manual (Function)" (2003).
    `by_temperature`: tables for a warm machine, weighted by how much warmer than the reference the columns are: errors
    over place and temperature in M. A. Donmez, D. S. Blomquist, R. J. Hocken, C. R. Liu, M. M. Barash, "A General
    Methodology for Machine Tool Accuracy Enhancement by Error Compensation" (1986). The size is that of TABLES_K.
    `multiplied`: tables against sag, multiplied by a table over the other axis, from nothing at its lower end to twice
    the size at its upper one: Siemens, "SINUMERIK 840D sl/828D: Extended Functions" (2013).
    `moved_zero`: the zero of every drive was moved after the tables had been taken, as happens when an encoder is
    exchanged, and they correct beside the place that they are for: numerical compensation in ISO/TR 16907, "Machine
    Tools: Numerical Compensation of Geometric Errors" (2015).
    `both_generations`: new tables, taken without any, were entered beside the old ones, which another part of the
    control still adds, so that every drive is corrected twice: levels of compensation in ISO/TR 16907 (2015).
    `ramped`: a computer beside the control adds the corrections by small steps, so that they are still those of former
    places when a drive stops: J. Ni, "CNC Machine Accuracy Enhancement Through Real-Time Error Compensation" (1997). It
    lags behind by its own axis, and follows the other one at once.
    `counted_from_above`: somebody entered the nodes of every drive from its upper end, and each correction acts at the
    mirrored place: slips of those who map one order to another in D. A. Norman, "The Psychology of Everyday Things"
    (1988).
    `by_payload`: tables of the loaded machine, added in proportion to the payload that is entered: errors by load among
    those in R. Ramesh, M. A. Mannan, A. N. Poo, "Error Compensation in Machine Tools — A Review" (2000). The size is
    that of FULL_PAYLOAD_KG.
    `swapped_drives`: somebody entered the table of every drive for the next one, which it then corrects over that one's
    own coordinate, and over the one after it: slips in J. Reason, "Human Error" (1990).
    `rounded_entries`: the control stores entries in few bits, so that each is rounded to a coarse step and small ones
    are gone: J. H. Wilkinson, "Rounding Errors in Algebraic Processes" (1963). The step is a share of the largest entry
    of all.
    `feed_forward`: a control that feeds forward what it expects adds each drive's corrections in proportion to the
    speed with which that came, and keeps them at rest: M. Tomizuka, "Zero Phase Error Tracking Algorithm for Digital
    Control" (1987). The size is that at FED_M_PER_S.
    `overflowing_entries`: the control stores entries in fewer bits than some of them need, which run over and come out
    at the other end of the range, with the other sign: D. E. Knuth, "The Art of Computer Programming", vol. 2 (1969).
    `lost_signs`: the control stores entries without their signs, so that all of them come out with the same one: W.
    Buchholz, "Planning a Computer System" (1962).
    """

    def setup(self) -> None:
        """Which generation, which drive of variant `one_drive`, and how far zeros were moved."""
        tables = self.site.known_tables or draw_known_tables(self.site.machine, self.rng)
        generations = sorted({table.generation for table in tables})
        first = int(self.rng.integers(len(generations)))
        self.active = self._of(tables, generations[first])
        self.backward = self._of(tables, generations[(first + 1) % len(generations)])
        drives = len(self.site.machine.sliders)
        self.drive = int(self.rng.integers(drives))
        self.moved_m = self.rng.uniform(*MOVED_M, drives) * self.rng.choice([-1.0, 1.0], drives)
        self.ramps_s = float(self.rng.uniform(*RAMPS_S))
        self.coarse = float(self.rng.uniform(*COARSE))
        if self.variant == "rounded_entries":
            self.active = self._rounded(self.active)
        self.holds = float(self.rng.spawn(1)[0].uniform(*HOLDS))
        if self.variant == "overflowing_entries":
            self.active = self._overflowed(self.active)
        self.sign = float(self.rng.spawn(1)[0].choice([-1.0, 1.0]))
        if self.variant == "lost_signs":
            self.active = {name: _with_sign(table, self.sign) for name, table in self.active.items()}
        self._added = [PlaceMemory(self._along_own(a), self.ramps_s) for a in range(drives)]

    def _of(self, tables: tuple[KnownTable, ...], generation: int) -> dict[str, KnownTable]:
        return {table.drive: table for table in tables if table.generation == generation}

    def _rounded(self, tables: dict[str, KnownTable]) -> dict[str, KnownTable]:
        """Tables whose entries are whole steps."""
        step_m = self.coarse * _most_m(tables)
        return {
            name: replace(
                table,
                corrections_m=tuple(tuple(step_m * round(x / step_m) for x in row) for row in table.corrections_m),
            )
            for name, table in tables.items()
        }

    def _overflowed(self, tables: dict[str, KnownTable]) -> dict[str, KnownTable]:
        """Tables whose entries have run over from one end of the range to the other."""
        end_m = self.holds * _most_m(tables)
        return {
            name: replace(
                table,
                corrections_m=tuple(
                    tuple((x + end_m) % (2.0 * end_m) - end_m for x in row) for row in table.corrections_m
                ),
            )
            for name, table in tables.items()
        }

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the corrections follow their drive."""
        if self.variant == "ramped":
            self._added[drive].record(leg)

    def _along_own(self, a: int) -> Callable[[Array], Array]:
        """The correction of a drive over its own coordinate, the other one in the middle of its nodes."""
        table = self.active.get(self.site.machine.sliders[a].name)
        if table is None:
            return np.zeros_like
        partner_m = float(np.mean(table.partner_m)) if table.partner else 0.0
        return lambda q_m: table.correction_m(q_m, np.full_like(q_m, partner_m))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Correct the commands."""
        on = np.full(len(state), self.size)
        if self.variant == "switched":
            on = on * (state.t_s - self.site.start_s >= self.values["onset_s"])
        elif self.variant == "by_payload":
            on = on * state.payload_kg / FULL_PAYLOAD_KG
        elif self.variant == "by_temperature":
            machine = self.site.machine
            warmer_k = state.parts_c[machine.expansion["drives"].sensor] - machine.reference_temperature_c
            on = on * warmer_k / TABLES_K
        for a in range(len(self.site.machine.sliders)):
            if self.variant == "one_drive" and a != self.drive:
                continue
            correction_m = self._correction_m(self.active, state, a)
            if self.variant == "ramped":
                correction_m = correction_m + self._added[a].at(state, a) - self._along_own(a)(state.q_m[:, a])
            if self.variant == "bidirectional":
                backward = self._correction_m(self.backward, state, a)
                correction_m = np.where(state.direction[:, a] < 0.0, backward, correction_m)
            if self.variant == "both_generations":
                correction_m = correction_m + self._correction_m(self.backward, state, a)
            if self.variant == "multiplied":
                b = (a + 1) % len(self.site.machine.sliders)
                middle, half = self.site.drive_range_m(b)
                correction_m = correction_m * (1.0 + (state.q_m[:, b] - middle) / half)
            if self.variant == "feed_forward":
                correction_m = correction_m * state.speed_m_per_s[:, a] / FED_M_PER_S
            deviation.travel_m[:, a] += on * correction_m

    def _correction_m(self, tables: dict[str, KnownTable], state: MotionState, a: int) -> Array:
        names = [slider.name for slider in self.site.machine.sliders]
        given = (a + 1) % len(names) if self.variant == "swapped_drives" else a
        table = tables.get(names[given])
        if table is None:
            return np.zeros(len(state))
        partner = (
            state.q_m[:, (names.index(table.partner) + a - given) % len(names)]
            if table.partner
            else np.zeros(len(state))
        )
        own = state.q_m[:, a]
        if self.variant == "moved_zero":
            own = own + self.moved_m[a]
        elif self.variant == "counted_from_above":
            own = table.own_m[0] + table.own_m[-1] - own
        if self.variant == "pulses":
            own, partner = _passed(table.own_m, own), _passed(table.partner_m, partner)
        return table.correction_m(own, partner)


def _most_m(tables: dict[str, KnownTable]) -> float:
    """The largest entry of all tables of a generation, or next to nothing."""
    return max(1.0e-12, *(float(np.abs(np.array(table.corrections_m)).max()) for table in tables.values()))


def _with_sign(table: KnownTable, sign: float) -> KnownTable:
    """A table whose entries all have one sign."""
    return replace(table, corrections_m=tuple(tuple(sign * abs(x) for x in row) for row in table.corrections_m))


def _passed(nodes_m: tuple[float, ...], at_m: Array) -> Array:
    """The node at or below each position (n,), the first one below all of them; positions without nodes stay."""
    if not nodes_m:
        return at_m
    nodes = np.array(nodes_m)
    return np.asarray(nodes[np.maximum(np.searchsorted(nodes, at_m, side="right") - 1, 0)])


EFFECTS = (
    EffectSpec(
        name="tables_left_on",
        kind="catalogue",
        place="rig",
        size=EffectParameter("weight_ratio", 0.02, 1.0, 10.0, "weight of the tables, 1 is the whole correction"),
        variants=(
            "whole",
            "one_drive",
            "switched",
            "bidirectional",
            "pulses",
            "by_temperature",
            "multiplied",
            "moved_zero",
            "both_generations",
            "ramped",
            "counted_from_above",
            "by_payload",
            "swapped_drives",
            "rounded_entries",
            "feed_forward",
            "overflowing_entries",
            "lost_signs",
        ),
        final="lost_signs",
        reveals="both drives' coordinates, known tables, by variant dwell, speed, payload, SMRs on the sliders",
        make=TablesLeftOn,
        others=(ONSET,),
    ),
)
