"""The set-ups of a station tied to the first: one least-squares fit of rigid motions to all common points.

Points are eliminated in closed form, those of one group together, so that the fit has six unknowns for each later
set-up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.instruments.setups import Setups, range_shifts, shift_by_motion
from calibration.reduction.common_points import CommonPoints

LEAST_OFF_LINE_M = 0.05  # root of the sum of squares of the points' distances from the line that fits them best
MOST_MISS_M = 2.0e-3  # of a common point after the motion: more is another point
LOOSE = 1.0e-2  # m and rad: standard deviation of a motion that the nests alone do not determine
STEPS = 5

Motions = dict[float, tuple[Array, Array]]  # rotation (3, 3) and translation (3,) to the first, by set-up


def require_common_points(setups: Sequence[float], groups: Sequence[CommonPoints]) -> None:
    """InputError, which says what to measure, if a set-up has not three points, not in a line, with the others.

    setups: numbers; the first is the one that the others are tied to, directly or through one another.
    """
    _rough_motions(setups, groups, {})


def tie_setups(
    setups: Sequence[float], groups: Sequence[CommonPoints], machine_to_first: Array, known: Setups | None = None
) -> Setups:
    """The motions of all set-ups to the first, with their errors, by least squares over the common points.

    machine_to_first (3, 3): rotation from the machine's frame to the first set-up's, roughly. known: set-ups that were
    tied before, which keep their motions. Raises InputError as `require_common_points`, and where a point is not the
    one that it is taken for.
    """
    before: Motions = {}
    if known is not None:
        before = {float(n): (known.rotation[k], known.translation_m[k]) for k, n in enumerate(known.numbers)}
    rough = _rough_motions(setups, groups, before)
    out = replace(
        Setups.single(),
        numbers=np.array(setups, dtype=np.intp),
        rotation=np.array([rough[n][0] for n in setups]),
        translation_m=np.array([rough[n][1] for n in setups]),
    )
    free = np.repeat([n not in before for n in setups[1:]], 6) if before else np.ones(6 * (len(out) - 1), dtype=bool)
    for _ in range(STEPS):
        information, gradient, _ = _normal_equations(out, groups, machine_to_first)
        step = np.zeros(len(free))
        step[free] = -np.linalg.solve(information[np.ix_(free, free)], gradient[free])
        out = out.without_error(-step, out.error_covariance)
    information, _, by_range = _normal_equations(out, groups, machine_to_first)
    inverse = np.linalg.inv(information[np.ix_(free, free)])
    covariance, slopes = np.zeros_like(information), np.zeros_like(by_range)
    covariance[np.ix_(free, free)], slopes[free] = inverse, -inverse @ by_range[free]
    if known is not None and not np.all(free):
        follows = np.eye(len(free))[:, ~free]
        follows[free] = -inverse @ information[np.ix_(free, ~free)]
        covariance += follows @ known.error_covariance @ follows.T
    return replace(out, error_mean=np.zeros(len(free)), error_covariance=covariance, error_by_range=slopes)


def known_from_nests(setups: Setups, nests: Sequence[CommonPoints]) -> Setups:
    """The same motions with what the nests alone say of their errors: for a fit that has all other readings itself."""
    information, gradient, by_range = _normal_equations(setups, nests, np.eye(3))
    covariance = np.asarray(np.linalg.inv(information + np.eye(len(information)) / LOOSE**2), dtype=np.float64)
    return replace(
        setups,
        error_mean=covariance @ gradient,
        error_covariance=covariance,
        error_by_range=-covariance @ by_range,
    )


def _normal_equations(
    setups: Setups, groups: Sequence[CommonPoints], machine_to_first: Array
) -> tuple[Array, Array, Array]:
    """Information (m, m), gradient (m,) of half the weighted squares by the motions, and the gradient's derivatives
    (m, 3) with errors of the ranges; the points eliminated."""
    size = 6 * (len(setups) - 1)
    information, right = np.zeros((size, size)), np.zeros((size, 4))
    for group in groups:
        setup = setups.rows(group.setup)
        seen = setups.to_first(group.position_m, setup)
        by_motion = shift_by_motion(seen, setup, len(setups)).reshape(-1, size)
        shifts = range_shifts(seen - setups.translation_m[setup]).values()
        off = np.stack([seen - group.expected_m @ machine_to_first.T, *shifts], axis=2).reshape(-1, 4)
        turn = block_diag(*setups.rotation[setup])
        by_point = np.kron(np.eye(len(group.names))[group.point], np.eye(3))
        weight = np.linalg.inv(turn @ group.covariance_m2 @ turn.T)
        on_points = weight @ by_point
        weight = weight - on_points @ np.linalg.solve(by_point.T @ on_points, on_points.T)
        information += by_motion.T @ weight @ by_motion
        right += by_motion.T @ weight @ off
    return information, right[:, 0], right[:, 1:]


def _rough_motions(setups: Sequence[float], groups: Sequence[CommonPoints], known: Motions) -> Motions:
    """The motions by equal weights; InputError where the common points do not determine them or do not fit."""
    motions: Motions = {setups[0]: (np.eye(3), np.zeros(3)), **known}
    while missing := [number for number in setups if number not in motions]:
        for number in missing:
            common = _common_with(number, motions, groups)
            here, there = (np.array([pair[k] for pair in common.values()]).reshape(-1, 3) for k in (0, 1))
            if _determine_motion(here):
                motions[number] = _rigid_motion(here, there)
                _require_fit(number, tuple(common), here, there, motions[number])
                break
        else:
            raise InputError(_what_to_measure(missing[0], motions, groups))
    return motions


def _common_with(number: float, motions: Motions, groups: Sequence[CommonPoints]) -> dict[str, tuple[Array, Array]]:
    """Points that a set-up has in common with those that are tied: in its frame and in the first one's, by name."""
    out = {}
    for group in groups:
        tied = np.isin(group.setup, list(motions))
        for index, name in enumerate(group.names):
            own = (group.point == index) & (group.setup == number)
            others = np.flatnonzero((group.point == index) & tied)
            if np.any(own) and others.size:
                places = [motions[group.setup[i]][0] @ group.position_m[i] + motions[group.setup[i]][1] for i in others]
                out[name] = group.position_m[own].mean(axis=0), np.mean(places, axis=0)
    return out


def _determine_motion(points_m: Array) -> bool:
    if len(points_m) < 3:
        return False
    return bool(np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)[1] > LEAST_OFF_LINE_M)


def _rigid_motion(here: Array, there: Array) -> tuple[Array, Array]:
    """Rotation and translation that bring points (n, 3) closest to others (Kabsch 1976)."""
    u, _, vt = np.linalg.svd((there - there.mean(axis=0)).T @ (here - here.mean(axis=0)))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return rotation, there.mean(axis=0) - rotation @ here.mean(axis=0)


def _require_fit(number: float, names: Sequence[str], here: Array, there: Array, motion: tuple[Array, Array]) -> None:
    miss = np.linalg.norm(here @ motion[0].T + motion[1] - there, axis=1)
    if np.max(miss) > MOST_MISS_M:
        raise InputError(
            f"set-up {number:g}: {names[int(np.argmax(miss))]} lies {np.max(miss) * 1e3:.0f} mm from where the set-ups "
            "before had it; check which reflector is which, and whether it was moved"
        )


def _what_to_measure(number: float, motions: Motions, groups: Sequence[CommonPoints]) -> str:
    common = sorted(_common_with(number, motions, groups))
    known = {
        name for g in groups for i, name in enumerate(g.names) if np.any(np.isin(g.setup[g.point == i], list(motions)))
    }
    nests = [name for name in sorted(known - set(common)) if " at pose " not in name]
    have = f"only {', '.join(common)} measured before" if common else "no point was measured before"
    advice = f"nest {' and '.join(nests)}, or " if nests else ""
    return (
        f"set-up {number:g}: {have}, and its frame needs three such points that are not in a line; "
        f"measure {advice}all reflectors at a pose that was measured before"
    )
