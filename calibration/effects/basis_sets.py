"""Basis sets: columns that act on the machine through channels, with the priors of their coefficients."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.effects.columns import ColumnsByChannel, Contributions
from calibration.effects.former_names import former_name

CurvePoint = tuple[int, tuple[float, ...]]  # number of a curve, parameters on it
FLEXIBLE_SHARE = 0.3  # standard deviation of what a real part adds to the textbook's law, relative to the size


@dataclass(frozen=True)
class Departure:
    """A column of a basis set, by its position there, times a function of a coordinate, by its number.

    period_m: of what repeats along a drive, of whose phase some functions are; zero where nothing does.
    """

    column: int
    coordinate: str
    term: int
    period_m: float = 0.0


@dataclass(frozen=True)
class BasisSet:
    """One way in which an effect may act: numbers of its columns, standard deviations relative to the size.

    parameters: values of the effect's other parameters in this basis set; weight: its prior against the effect's other
    basis sets. size: weights with which the first coefficients add up to the size, where that is not what the effect
    says. For the tangent of a curve, curve: the point at which it was taken. departures: further columns, after the
    others (`calibration.effects.departures`). sign: that of the first coefficient, where mechanics has one, else 0.
    spells: in how many spells of time the main columns act, as many in each, in order: the size is that of the largest.
    courses: whether its columns are courses in time times what the place makes of them, so that several places may have
    the same coefficients, however many.
    one_way: of courses that mechanics lets go one way only, whichever, their steps (t, k) over time by their own k
    coefficients, in the order of the columns.
    """

    columns: tuple[int, ...]
    relative: tuple[float, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
    weight: float = 1.0
    curve: CurvePoint | None = None
    size: tuple[float, ...] = ()
    departures: tuple[Departure, ...] = ()
    sign: float = 0.0
    spells: int = 1
    courses: bool = False
    one_way: tuple[Array, ...] = field(default=(), compare=False)

    @property
    def main(self) -> tuple[int, ...]:
        """Numbers of the columns that are not mere departures: those whose standard deviation is the size itself."""
        return tuple(c for c, relative in zip(self.columns, self.relative, strict=True) if relative == 1.0)


class BasisSets:
    """The columns and basis sets of an effect at one place. named (k,): the form of each column, empty if it has none.

    A form is a formula with a name, whatever its parameters. Columns without one are general: smooth, rough or periodic
    functions of a coordinate, which may take any shape.
    """

    def __init__(self) -> None:
        self.contributions: list[Contributions] = []
        self.sets: list[BasisSet] = []
        self.named: list[str] = []

    def add(self, *contributions: tuple[str, Array], form: str = "") -> list[int]:
        """Columns that act through one or several channels at once, (n,) or (n, k) each. Returns their numbers.

        form: name of the formula that they are; left out for general functions.
        """
        wide = [(channel, shape[:, None] if shape.ndim == 1 else shape) for channel, shape in contributions]
        first = len(self.contributions)
        for k in range(wide[0][1].shape[1]):
            self.contributions.append(tuple((channel, shape[:, k]) for channel, shape in wide))
        self.named += [form] * wide[0][1].shape[1]
        return list(range(first, len(self.contributions)))

    def add_along(self, contributions: Sequence[tuple[str, Array]], courses: Array, *, form: str = "") -> list[int]:
        """Columns that act through channels (n,) each times the same courses (n,) or (n, k)."""
        wide = courses[:, None] if courses.ndim == 1 else courses
        return self.add(*((channel, shape[:, None] * wide) for channel, shape in contributions), form=form)

    @cached_property
    def by_channel(self) -> ColumnsByChannel:
        """All columns, once the last has been added."""
        return ColumnsByChannel.of(self.contributions)

    def add_set(
        self,
        main: Sequence[int],
        flexible: Sequence[int] = (),
        *,
        share: float = FLEXIBLE_SHARE,
        weight: float = 1.0,
        size: float | tuple[float, ...] = 1.0,
        sign: float = 0.0,
        **parameters: float,
    ) -> None:
        """A basis set of the main columns, and a second one with flexible columns of `share` times the size.

        size: weights with which the first coefficients add up to the size; -1.0 where its sign is not the first one's.
        sign: that of the first coefficient, where mechanics has only one.
        """
        weights = size if isinstance(size, tuple) else () if size == 1.0 else (size,)
        alone = BasisSet(tuple(main), (1.0,) * len(main), parameters, weight, size=weights, sign=sign)
        self.sets.append(alone)
        if flexible:
            relative = (1.0,) * len(main) + (share,) * len(flexible)
            self.sets.append(replace(alone, columns=(*main, *flexible), relative=relative))

    def keep_one_way(self, steps: Array, *, since: int) -> None:
        """The basis sets from number `since` on, of k main columns and multiples of k flexible ones, must not turn:
        steps (t, k) of each course over time by its coefficients.
        """
        for number in range(since, len(self.sets)):
            courses = len(self.sets[number].columns) // steps.shape[1]
            self.sets[number] = replace(self.sets[number], one_way=(steps,) * courses)

    def act_in_spells(self, count: int, *, since: int) -> None:
        """The main columns of the basis sets from number `since` on act in so many spells of time, as many in each."""
        self.sets[since:] = [replace(basis_set, spells=count) for basis_set in self.sets[since:]]

    def mark_as_courses(self, *, since: int) -> None:
        """The columns of the basis sets from number `since` on are courses in time (`BasisSet.courses`)."""
        self.sets[since:] = [replace(basis_set, courses=True) for basis_set in self.sets[since:]]

    def without_forms(self, names: Collection[str]) -> BasisSets:
        """The same columns; basis sets without those of some forms, and without sets that are made of them."""
        out, seen = BasisSets(), set()
        out.contributions, out.named = self.contributions, self.named
        for basis_set in self.sets:
            if any(self.named[c] in names for c in basis_set.main):
                continue
            kept = [k for k, c in enumerate(basis_set.columns) if self.named[c] not in names]
            left = replace(
                basis_set,
                columns=tuple(basis_set.columns[k] for k in kept),
                relative=tuple(basis_set.relative[k] for k in kept),
                one_way=basis_set.one_way if len(kept) == len(basis_set.columns) else (),
            )
            key = (left.columns, left.relative, tuple(left.parameters.items()), left.sign)
            if key not in seen:  # what is left of one may be another
                out.sets.append(left)
            seen.add(key)
        return out

    form = former_name("add_set")
    forms = former_name("sets")
    acts = former_name("contributions")


@dataclass(frozen=True)
class Tangent:
    """Linearisation of a curve at one point: the first column is the value, the others the derivatives (p).

    relative (1 + p,): standard deviations, relative to the size, within which the tangent is a good approximation;
    units (p,): of the parameters, in which their coefficients over the size count. size: weights with which the first
    coefficients add up to the size. value: coefficient of the first column at the point itself, the size there;
    zero: whatever the readings make most likely. step: was asked for by former versions.
    """

    contributions: tuple[Contributions, ...]
    relative: tuple[float, ...]
    units: tuple[float, ...]
    size: tuple[float, ...]
    step: Callable[[Array], Array] | None = None
    value: float = 0.0


@dataclass(frozen=True)
class Tangents:
    """Tangents of a curve at several points (m), through one channel; fields as those of `Tangent`.

    columns (m, 1 + p, v): at one reading of each group; units (m, p); size (m, 2); value (m,).
    """

    channel: str
    columns: Array
    relative: tuple[float, ...]
    units: Array
    size: Array
    value: Array

    def __getitem__(self, row: int) -> Tangent:
        """One of them."""
        contributions = tuple(((self.channel, column),) for column in self.columns[row])
        units, size = tuple(self.units[row].tolist()), tuple(self.size[row].tolist())
        return Tangent(contributions, self.relative, units, size, value=float(self.value[row]))


@dataclass(frozen=True)
class Curve:
    """A family of columns that is not linear in its parameters (p), fitted iteratively from several starts (m, p).

    The first parameter carries the size. low, high (p,): limits; spread (p,): prior standard deviations about zero,
    infinite where only the limits are known. form: its name, as that of a column. group (n,): where the columns of its
    tangents are alike among readings, as at one stand, they have one row for each group, whose number this is of each
    reading. tangents: those at several points (m, p) at once, for a curve with groups that acts through one channel;
    without it each is asked for by itself.
    """

    starts: Array
    low: Array
    high: Array
    spread: Array
    tangent: Callable[[Array], Tangent]
    form: str = ""
    group: NDArray[np.intp] | None = None
    tangents: Callable[[Array], Tangents] | None = None

    def at_readings(self, tangent: Tangent) -> tuple[Contributions, ...]:
        """The columns of one of its tangents at all readings."""
        if (group := self.group) is None:
            return tangent.contributions
        return tuple(tuple((channel, shape[group]) for channel, shape in column) for column in tangent.contributions)
