"""The linear model of two campaigns of one machine: what they have in common, and what each has of its own.

Rows (m) are the whitened coordinates of all readings, first those of the campaign before. Common to both are the
machine's parameters, its expansion coefficients, the mounting of its reflectors, the places of the floor nests, the
struts' own weight and a smooth curve of each drive. Each campaign has its own frame, range errors, payload, part
temperatures and disturbances: a station that was set up anew, or another instrument, changes no machine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.few_visits import AtFewVisits, at_few_visits
from calibration.diagnosis.linear_model import LinearModel, linearise_recording
from calibration.diagnosis.linearisation import STIFFNESS_LIMIT_SIGMA
from calibration.diagnosis.linearised_readings import LinearisedReadings, inverse_covariance_factor
from calibration.diagnosis.non_parametric import evidence_of_shifts_by_visit
from calibration.diagnosis.positioning import most_likely_positioning_m
from calibration.diagnosis.settings import VERDICT
from calibration.effects.basis_functions import cosine_basis
from calibration.instruments.setups import range_shifts
from calibration.recording.recording import Recording

COMMON = ("expansion", "mounting", "nest", "inside")
CURVE_M, CURVE_TERMS = 3.0e-6, 6  # of each drive in both campaigns: no screw is as straight as the model's
LEAST_SCATTER = 1.0  # readings that scatter less than stated are not weighed more


@dataclass(frozen=True)
class TwoCampaigns:
    """The linear model of both campaigns.

    before, after: of each alone, linearised at one machine. residual (m,); columns (m, b), each times its prior
    standard deviation; names (b,); q (m, r): 1 - q q' is the inverse covariance of the readings, without what differs
    anew (m, k) from one campaign to the next at the declared levels: seats of reflectors, temperatures of parts.
    scatter: of the readings about the fit of each campaign alone, over the stated; the rows are divided by it where it
    is larger than one. positioning_sd_m: how far drives stand off anew at each visit of either. shared: reflectors
    that both have in one place. elsewhere: what is off at few visits of either, which are left out.
    """

    before: LinearisedReadings
    after: LinearisedReadings
    residual: Array
    columns: Array
    names: tuple[str, ...]
    q: Array
    anew: Array
    scatter: tuple[float, float]
    positioning_sd_m: float
    shared: frozenset[str]
    elsewhere: tuple[AtFewVisits | None, AtFewVisits | None] = (None, None)

    @property
    def of_after(self) -> slice:
        """The rows of the campaign after."""
        return slice(self.before.residual.size, None)

    @property
    def weight_after(self) -> float:
        """Factor on whitened shifts of the campaign after, for scatter beyond the stated."""
        return 1.0 / max(self.scatter[1], LEAST_SCATTER)

    def apply(self, columns: Array) -> Array:
        """Inverse covariance times columns (m, k) or (m,)."""
        return np.asarray(columns - self.q @ (self.q.T @ columns))

    def machine_values(self, weighted_residual: Array | None = None) -> dict[str, float]:
        """Values (SI) of the machine's parameters and expansion coefficients that fit both campaigns best.

        weighted_residual (m,): inverse covariance times residual, if that is not the one without a change.
        """
        left = self.apply(self.residual) if weighted_residual is None else weighted_residual
        coefficients = self.columns.T @ left
        sigma = dict(zip(self.before.names, self.before.sigma.tolist(), strict=False))
        held = _held(self.before)
        # A strong change can drive a stiffness to any value; the point of linearisation has to remain plausible.
        soft = np.array([name.startswith("ln_stiffness") for name in self.names])
        limit = STIFFNESS_LIMIT_SIGMA
        coefficients = np.where(soft, np.clip(coefficients, -limit, limit), coefficients)
        return {
            name: float(c) * sigma[name]
            for name, c in zip(self.names, coefficients, strict=True)
            if name in held and name in sigma
        }

    def largest_rms(self, whitened: Array) -> float:
        """RMS in sigma over the moving coordinates of the readings after, of shifts (m,): the largest of the platform's
        reflectors, those on drives and those on the floor."""
        shift = whitened[self.of_after].reshape(-1, 3)
        moves = int(np.sum(self.after.machine.dof < 3))
        on = np.array([smr.on for smr in self.after.machine.smrs])[self.after.smr]
        return max(float(np.sqrt(np.sum(shift[on == part] ** 2) / (moves * np.sum(on == part)))) for part in set(on))


def linearise_pair(before: Recording, after: Recording, shared: frozenset[str]) -> TwoCampaigns:
    """Both campaigns, wrong readings and visits left out, linear about the machine that fits both best.

    Raises InputError.
    """
    alone = [_without_few_visits(linearise_recording(each)) for each in (before, after)]
    first = _joined(alone[0][0], alone[1][0], shared, (alone[0][1], alone[1][1]))
    return again_at(first, first.machine_values(), {})


def again_at(pair: TwoCampaigns, machine: Mapping[str, float], changed: Mapping[str, float]) -> TwoCampaigns:
    """The same readings, linear about other values of the machine's parameters; changed: what is added after."""
    later = {name: value + changed.get(name, 0.0) for name, value in machine.items()}
    models = []
    for linear, held in ((pair.before, machine), (pair.after, later)):
        if not isinstance(linear, LinearModel):
            raise TypeError("only recordings are linearised again")
        models.append(linearise_recording(linear.recording.take(linear.rows), judge=False, held=held))
    return _joined(models[0], models[1], pair.shared, pair.elsewhere)


def _without_few_visits(linear: LinearModel) -> tuple[LinearModel, AtFewVisits | None]:
    """A campaign without the few visits at which alone something is elsewhere, as no change of the machine is; what it
    is. Not where shifts at all visits explain more: a law that the model lacks is at its largest at few visits, too."""
    likelihood = MarginalLikelihood.of(linear.standing_off(most_likely_positioning_m(linear)))
    found = at_few_visits(likelihood)
    of_all = evidence_of_shifts_by_visit(likelihood, [found.channel])
    if found.log_evidence <= VERDICT.detection_threshold + max(of_all, 0.0):
        return linear, None
    rest = linear.recording.take(linear.rows[~np.isin(linear.visit_number, found.visits)])
    try:
        return linearise_recording(rest, judge=False), found
    except InputError:  # too few are left
        return linear, None


def _held(linear: LinearisedReadings) -> frozenset[str]:
    """Names of the unknowns that both campaigns are linearised at: the machine's own."""
    parameters = {p.name for p in linear.poses.model.parameters.parameters}
    return frozenset(name for name in linear.names if name in parameters or name.startswith("expansion."))


def _joined(
    before: LinearModel,
    after: LinearModel,
    shared: frozenset[str],
    elsewhere: tuple[AtFewVisits | None, AtFewVisits | None],
) -> TwoCampaigns:
    # A machine that does not repeat does so neither before nor after: what one campaign alone has is a change.
    positioning_sd_m = min(most_likely_positioning_m(before), most_likely_positioning_m(after))
    before, after = (linear.standing_off(positioning_sd_m) for linear in (before, after))
    scatter = scatter_of(before), scatter_of(after)
    parts = [_with_more(before), _with_more(after)]
    sizes = before.residual.size, after.residual.size
    anew = _anew(after, shared)
    anew = np.concatenate([np.zeros((sizes[0], anew.shape[1])), anew / max(scatter[1], LEAST_SCATTER)])
    common = [name for name in parts[0] if name in parts[1] and _is_common(name, before, shared)]
    weights = [1.0 / max(each, LEAST_SCATTER) for each in scatter]
    names, columns = joint_columns(parts, common, weights)
    residual = np.concatenate([weights[0] * before.residual.ravel(), weights[1] * after.residual.ravel()])
    q = inverse_covariance_factor(columns[:, None, :])[:, 0]
    return TwoCampaigns(before, after, residual, columns, names, q, anew, scatter, positioning_sd_m, shared, elsewhere)


def joint_columns(
    parts: Sequence[Mapping[str, Array]], common: Sequence[str], weights: Sequence[float]
) -> tuple[tuple[str, ...], Array]:
    """Names (b,) and columns (m, b) of both campaigns, those in common first; parts: each one's columns by name.

    weights: of the rows of each.
    """
    own = [[name for name in part if name not in set(common)] for part in parts]
    sizes = [len(next(iter(part.values()))) for part in parts]
    names = [*common, *(f"before: {name}" for name in own[0]), *(f"after: {name}" for name in own[1])]
    columns = np.zeros((sum(sizes), len(names)))
    start = len(common)
    for part, of_part, rows, weight in zip(
        parts, own, (slice(0, sizes[0]), slice(sizes[0], None)), weights, strict=True
    ):
        columns[rows, : len(common)] = weight * np.stack([part[name] for name in common], axis=1)
        if of_part:
            columns[rows, start : start + len(of_part)] = weight * np.stack([part[name] for name in of_part], axis=1)
        start += len(of_part)
    return tuple(names), columns


def _is_common(name: str, linear: LinearModel, shared: frozenset[str]) -> bool:
    kind, _, of = name.partition(".")
    if kind in ("mounting", "nest"):
        return of.rpartition(".")[0] in shared
    return kind in (*COMMON, "curve") or name in {p.name for p in linear.poses.model.parameters.parameters}


def scatter_of(linear: LinearisedReadings) -> float:
    """Birge's ratio of one campaign: root of chi-squared over degrees of freedom of the readings about their fit."""
    left = linear.apply(linear.residual)
    freedom = left.size - float(np.sum(linear.q**2))
    return float(np.sqrt(np.sum(left**2) / max(freedom, 1.0)))


def _with_more(linear: LinearModel) -> dict[str, Array]:
    """All columns (m,) of one campaign by name: its own and each drive's curve."""
    out = {name: linear.columns[:, :, k].ravel() for k, name in enumerate(linear.names)}
    for name, shift_m in range_shifts(linear.sight_m).items():
        if name in out:  # alone, a campaign takes what its ranges do to the nests for their places
            on_floor = np.where(linear.on_floor[:, None], shift_m, 0.0) * linear.sigma[linear.names.index(name)]
            out[name] = out[name] + np.einsum("nij,nj->ni", linear.whiten, on_floor).ravel()
    channels, machine = Channels(linear), linear.machine
    for a, drive in enumerate(machine.drive_names):
        curve = curve_of_drive(machine.travel[a], linear.context.drives[:, a], CURVE_TERMS) * CURVE_M
        for k, column in enumerate(_columns(linear, channels.shift_m(f"travel.{drive}"), curve)):
            out[f"curve.{drive}.{k}"] = column
    return out


def _anew(linear: LinearModel, shared: frozenset[str]) -> Array:
    """Columns (m, k) of what differs from the campaign before, at the declared levels: both campaigns drew it."""
    channels, machine, levels = Channels(linear), linear.machine, linear.recording.file.nuisance
    one, out = np.ones((len(linear.smr), 1)), [np.zeros((linear.residual.size, 0))]
    warmer, reseated = np.sqrt(2.0) * levels.temperature_k, np.sqrt(2.0) * levels.reseat_m
    for i, strut in enumerate(machine.strut_names):
        grown = warmer * machine.expansion_per_k["struts"] * machine.nominal.length_m[i]
        out += [c[:, None] for c in _columns(linear, channels.shift_m(f"length.{strut}"), one * grown)]
    for a, drive in enumerate(machine.drive_names):
        grown_m = warmer * machine.expansion_per_k["drives"] * linear.context.drives[:, a : a + 1]
        out += [c[:, None] for c in _columns(linear, channels.shift_m(f"travel.{drive}"), grown_m)]
    for i in sorted(set(linear.smr.tolist())):
        if machine.smrs[i].name in shared:
            shifts = reflector_shifts_m(linear, i)
            out += [c[:, None] for shift in shifts for c in _columns(linear, shift, one * reseated)]
    return np.concatenate(out, axis=1)


def curve_of_drive(travel: Array, at: Array, terms: int) -> Array:
    """Smooth functions (n, k) of a drive's coordinate (n,) over its whole travel (2,), total RMS one."""
    ends = np.concatenate([travel, np.clip(at, *travel)])
    return cosine_basis(ends, terms, roughness=1.5)[2:]


def reflector_shifts_m(linear: LinearisedReadings, smr: int) -> list[Array]:
    """Shifts (n, 3), machine's frame, of the readings of one reflector by each coordinate of its place on its part."""
    rows: NDArray[np.intp] = np.flatnonzero(linear.smr == smr)
    turn = np.broadcast_to(np.eye(3), (len(rows), 3, 3))
    if linear.machine.smrs[smr].on == "platform":
        turn = linear.poses.equilibrium.rotation[linear.visit[rows]]
    out = []
    for axis in range(3):
        shift = np.zeros((len(linear.smr), 3))
        shift[rows] = turn[:, :, axis]
        out.append(shift)
    return out


def _columns(linear: LinearModel, shift_m: Array, shapes: Array) -> list[Array]:
    """Columns (m,) of shifts (n, 3) per unit of a channel times functions (n, k) of the readings."""
    response = linear.whiten_shift(shift_m)
    return [(response * shape[:, None]).ravel() for shape in shapes.T]
