"""Where the platform hangs on its elastic struts, and where its reflectors are then; many readings at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution, Departures
from benchmarks.other_simulator.machine import ON_FLOOR, ON_PLATFORM, Geometry, Indices, Machine, rotations_of
from benchmarks.other_simulator.state import Conditions, Equilibrium

Array = NDArray[np.float64]
Poses = tuple[Array, Array]  # positions (r, 3) and rotations (r, 3, 3)
Load = tuple[Callable[[Equilibrium, float], Contribution], int | None, float]  # what, at which place, how much

NEWTON_ROUNDS, LOAD_ROUNDS, NEWTON_ROUNDS_OF_LOAD = 6, 14, 4
CLOSE_M = 1e-10
LEG_WEIGHT_N, CARRIAGE_KG = 60.0, 45.0


@dataclass(frozen=True)
class _Parts:
    """The machine's parts at r readings, as warm and as displaced as they are, in the machine frame."""

    growth: dict[str, Array]  # (r,), factor of lengths by group
    travel: Array  # (r, d)
    axes: Array  # (d, 3)
    lengths: Array  # (r, s)
    stiffness: Array  # (r, s)
    joints: Array  # (r, s, 3), of the platform, in its frame
    bases: Array  # (r, s, 3), at zero travel
    centres: Array  # (r, d, 3), of the bases of each drive
    ends: Array  # (r, s, 3), of the struts, away from the platform


def hang(
    machine: Machine, geometry: Geometry, conditions: Conditions, departures: Departures,
    start: Poses | None = None, rounds: int = NEWTON_ROUNDS,
) -> Equilibrium:  # fmt: skip
    """The poses at which weights, forces and the struts' pull balance, by Newton's method from `start`.

    The struts' pull does not enter the stiffness by which it steps: it converges less fast, to the same poses.
    """
    parts = _parts(machine, geometry, conditions, departures)
    payload = conditions.payload_kg + departures.payload_kg
    payload_centre = conditions.payload_centre_m + departures.payload_centre_m
    own_weight = machine.moving_mass_kg * machine.gravity_m_per_s2
    payload_weight = payload[:, None] * machine.gravity_m_per_s2
    force = own_weight + payload_weight + departures.force_n
    positions, rotations = start if start is not None else (conditions.positions_m, conditions.rotations)
    for _ in range(rounds):
        arms = np.einsum("rij,rsj->rsi", rotations, parts.joints)
        ways = positions[:, None] + arms - parts.ends
        distances = np.linalg.norm(ways, axis=2)
        directions = ways / distances[..., None]
        tension = parts.stiffness * (distances - parts.lengths)
        jacobian = np.concatenate([directions, np.cross(arms, directions)], 2)[:, :, machine.free]
        own_lever = np.einsum("rij,j->ri", rotations, machine.centre_of_mass_m)
        payload_lever = np.einsum("rij,rj->ri", rotations, payload_centre)
        moment = np.cross(own_lever, own_weight) + np.cross(payload_lever, payload_weight) + departures.moment_nm
        pull = np.einsum("rs,rsd->rd", tension, jacobian)
        unbalanced = pull - np.concatenate([force, moment], 1)[:, machine.free]
        matrix = np.einsum("rsd,rs,rse->rde", jacobian, parts.stiffness, jacobian)
        step = np.zeros((len(positions), 6))
        step[:, machine.free] = -np.linalg.solve(matrix, unbalanced[..., None])[..., 0]
        positions = positions + step[:, :3]
        rotations = rotations_of(step[:, 3:]) @ rotations
        if np.abs(step[:, :3]).max() < CLOSE_M:
            break
    return _equilibrium(machine, parts, (positions, rotations), tension, directions)


def _parts(machine: Machine, geometry: Geometry, conditions: Conditions, departures: Departures) -> _Parts:
    of_strut = machine.drive_of_strut
    growth = {
        group: 1 + (per_k + departures.expansion_per_k[group]) * (conditions.part_c[group] - machine.reference_c)
        for group, per_k in conditions.expansion_per_k.items()
    }
    travel = conditions.drives_m * geometry.drive_scale * growth["drives"][:, None] + departures.drives_m
    lengths = geometry.strut_length_m * (growth["struts"][:, None] + conditions.strut_strain) + departures.struts_m
    bases = geometry.base_joint_m * growth["base"][:, None, None]
    centres = np.stack([bases[:, of_strut == drive].mean(1) for drive in range(len(machine.drives))], 1)
    axes = _tilted_axes(machine, geometry)
    ends = bases
    if machine.legs:
        lengths = lengths + travel[:, of_strut]
    else:
        ends = bases + (travel[:, :, None] * axes)[:, of_strut]
    turned = np.cross(departures.carriages_rad[:, of_strut], bases - centres[:, of_strut])
    return _Parts(
        growth=growth,
        travel=travel,
        axes=axes,
        lengths=lengths,
        stiffness=np.exp(geometry.ln_stiffness + departures.ln_stiffnesses),
        joints=geometry.platform_joint_m * growth["platform"][:, None, None] + departures.joints_m,
        bases=bases,
        centres=centres,
        ends=ends + departures.carriages_m[:, of_strut] + turned,
    )


def _equilibrium(machine: Machine, parts: _Parts, poses: Poses, tension: Array, directions: Array) -> Equilibrium:
    """With what the struts do to the carriages."""
    forces, moments = np.zeros_like(parts.centres), np.zeros_like(parts.centres)
    for strut, drive in enumerate(machine.drive_of_strut):
        pull = tension[:, strut, None] * directions[:, strut]
        forces[:, drive] += pull
        moments[:, drive] += np.cross(parts.bases[:, strut] - parts.centres[:, drive], pull)
    return Equilibrium(
        positions_m=poses[0],
        rotations=poses[1],
        tension_n=tension,
        directions=directions,
        carriage_force_n=forces,
        carriage_moment_nm=moments,
        travel_m=parts.travel,
        axes=parts.axes,
        centres_m=parts.centres,
        growth=parts.growth,
    )


def settle(
    machine: Machine, geometry: Geometry, conditions: Conditions, departures: Departures,
    loads: Sequence[Load] = (), start: Poses | None = None,
) -> tuple[Equilibrium, Departures]:  # fmt: skip
    """The equilibrium with effects that depend on its own forces, by a damped fixed point; and all that departs."""
    state = hang(machine, geometry, conditions, departures, start)
    together, former = departures, None
    for _ in range(LOAD_ROUNDS if loads else 0):
        yielding = Departures.none(machine, len(conditions.drives_m))
        for under_load, place, amplitude in loads:
            yielding.add(under_load(state, amplitude), place, 1.0)
        if former is not None:
            yielding.damp(former)
        former = yielding
        together = departures.plus(yielding)
        where = state.positions_m, state.rotations
        state = hang(machine, geometry, conditions, together, where, NEWTON_ROUNDS_OF_LOAD)
    return state, together


def points_m(machine: Machine, geometry: Geometry, read: Indices, state: Equilibrium, departures: Departures) -> Array:
    """Where the reflector that each reading is of stands (r, 3), in the machine frame; read (r,): its number."""
    out = np.zeros((len(read), 3))
    places, carriers = geometry.smr_position_m[read], machine.carriers[read]
    on = carriers == ON_PLATFORM
    grown = places[on] * state.growth["platform"][on, None]
    out[on] = state.positions_m[on] + np.einsum("rij,rj->ri", state.rotations[on], grown)
    for drive, axis in enumerate(state.axes):
        on = carriers == drive
        if on.any():
            along = state.travel_m[on, drive, None] * axis
            place = places[on] * state.growth["base"][on, None] + along
            arm = place - (state.centres_m[on, drive] + along)
            turned = np.cross(departures.carriages_rad[on, drive], arm)
            out[on] = place + departures.carriages_m[on, drive] + turned
    on = carriers == ON_FLOOR
    out[on] = places[on]
    return out + departures.points_m


def drive_loads_n(machine: Machine, state: Equilibrium) -> Array:
    """What each drive holds (r, d): along its slide the struts' pull and the carriage's weight, or the leg's push."""
    if machine.legs:
        return -state.tension_n + LEG_WEIGHT_N
    weight = CARRIAGE_KG * 9.8 * (machine.axes @ machine.up)
    return np.asarray(-np.einsum("rdi,di->rd", state.carriage_force_n, machine.axes) + weight)


def _tilted_axes(machine: Machine, geometry: Geometry) -> Array:
    """True axes (d, 3); those of legs stay zero."""
    if machine.legs:
        return machine.axes
    tilts = geometry.axis_tilt_rad
    out = (
        machine.axes
        + tilts[:, :1] * np.cross(machine.sideways, machine.axes)
        + tilts[:, 1:] * np.cross(machine.normals, machine.axes)
    )
    return np.asarray(out / np.linalg.norm(out, axis=1)[:, None])
