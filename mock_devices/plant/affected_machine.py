"""The true machine with its effects, for many moments at once: where reflectors are and what the station sees.

Without effects it stands where `true_machine` says, to round-off; it is a second path to the same physics.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mock_devices.effects.base import Array, Complex, Departure, Effect, EffectChoice, Moments, Sight, Site
from mock_devices.effects.catalogue import make
from mock_devices.machine_file import MachineFile
from mock_devices.plant.elastic_batch import Rest, Structure, solve, start
from mock_devices.plant.motion_history import MotionHistory
from mock_devices.plant.optics import TWO_PI, StationView
from mock_devices.plant.thermal import SENSORS, Thermal
from mock_devices.plant.true_machine import TrueMachine
from mock_devices.settings import MockSettings


class AffectedMachine:
    """A true machine, the station in front of it, and effects."""

    def __init__(self, machine: TrueMachine, view: StationView, effects: Sequence[Effect] = ()) -> None:
        self.machine, self.view, self.effects = machine, view, tuple(effects)
        self._struts = machine.file.struts
        self._first = next(i for i, strut in enumerate(self._struts) if strut.drive == 0)
        self._other = next(i for i, strut in enumerate(self._struts) if strut.drive != 0)

    def departure(self, m: Moments) -> Departure:
        """What the effects change."""
        departure = Departure.none(len(m), self.machine.file)
        for effect in self.effects:
            effect.act(m, departure)
        return departure

    def early_s(self, m: Moments) -> Array:
        """By how much the machine has gone on when the station looks (n,)."""
        return np.zeros(len(m)) + sum(effect.early_s(m) for effect in self.effects)

    def rest(self, m: Moments, d: Departure, payload: np.ndarray) -> tuple[Rest, Structure]:
        """Equilibria (n,) for payload numbers (n,)."""
        file, grown = self.machine.file, self._growth(m)
        axis = np.array([slider.axis for slider in file.sliders])
        travel = self._travel(m, d, grown)
        base = np.empty((len(m), len(self._struts)), dtype=np.complex128)
        platform = np.empty_like(base)
        centre = np.empty((len(m), len(axis)), dtype=np.complex128)
        for a in range(len(axis)):
            mine = [i for i, strut in enumerate(self._struts) if strut.drive == a]
            middle = np.mean([self._struts[i].base_joint for i in mine]) * grown["base"]
            centre[:, a] = middle + travel[:, a]
            turn = np.exp(1j * d.yaw_rad[:, a])
            for i in mine:
                arm = self._struts[i].base_joint * grown["base"] - middle + d.base_joint_m[:, i]
                base[:, i] = centre[:, a] + arm * turn
        for i, strut in enumerate(self._struts):
            platform[:, i] = strut.platform_joint * grown["platform"] + d.platform_joint_m[:, i]
        soft = bool(np.any(d.carriage_compliance))
        structure = Structure(
            platform,
            base,
            np.array([s.length_m for s in self._struts]) * grown["struts"][:, None] + d.length_m,
            np.array([s.stiffness_n_per_m for s in self._struts]) * np.exp(d.ln_stiffness),
            tuple(strut.drive for strut in self._struts),
            axis,
            centre,
            [*self._weights(d, grown, payload), *d.loads],
            d.moment_nm,
            d.laws,
            d.carriage_compliance if soft else None,
            d.carriage_hardening if soft else None,
        )
        first = start(structure, file.sliders[0].branch, self._first, self._other)
        return solve(structure, first), structure

    def places(self, m: Moments, payload: np.ndarray) -> Array:
        """All reflectors in the frame of the floor (n, smrs, 3)."""
        d = self.departure(m)
        rest, structure = self.rest(m, d, payload)
        grown = self._growth(m)
        names = [slider.name for slider in self.machine.file.sliders]
        turn, lean = np.exp(1j * rest.rz_rad), np.exp(1j * d.frame_turn_rad)
        out = np.empty((len(m), len(self.machine.file.smrs), 3))
        for i, smr in enumerate(self.machine.file.smrs):
            x, y, z = smr.position_m
            extra = d.smr_m[:, i, 0] + 1j * d.smr_m[:, i, 1]
            height = z + d.smr_m[:, i, 2]
            if smr.on == "floor":
                spot = complex(x, y) + extra
            elif smr.on == "platform":
                spot = rest.p + turn * (complex(x, y) * grown["platform"] + extra)
                height = height + z * (grown["platform"] - 1.0)
            else:
                a = names.index(smr.on)
                spot = self._on_slider(complex(x, y), extra, a, d, rest, structure, grown)
                height = height + z * (grown["base"] - 1.0)
            if smr.on != "floor":
                spot = lean * spot + d.frame_shift_m
            out[:, i, 0], out[:, i, 1], out[:, i, 2] = spot.real, spot.imag, height
        return out

    def sight(self, m: Moments, payload: np.ndarray) -> Sight:
        """What the station sees of all reflectors, free of noise (n, smrs)."""
        places = self.places(m, payload)
        seen = polar_series(self.view, places, m.t_s)
        for effect in self.effects:
            effect.sight(m, seen)
        seen.hz_rad %= TWO_PI
        return seen

    def _on_slider(
        self,
        spot: complex,
        extra: Complex,
        a: int,
        d: Departure,
        rest: Rest,
        structure: Structure,
        grown: dict[str, Array],
    ) -> Complex:
        mine = [strut.base_joint for strut in self._struts if strut.drive == a]
        arm = (spot - np.mean(mine)) * grown["base"] + extra
        u = rest.carriage[:, a]
        given = structure.axis[a] * (u[:, 0] + 1j * u[:, 1])
        return np.asarray(structure.centre[:, a] + given + arm * np.exp(1j * (d.yaw_rad[:, a] + u[:, 2])))

    def _growth(self, m: Moments) -> dict[str, Array]:
        reference_c = self.machine.file.reference_temperature_c
        return {
            part: 1.0 + e.coefficient_per_k * (m.parts_c[e.sensor] - reference_c)
            for part, e in self.machine.file.expansion.items()
        }

    def _travel(self, m: Moments, d: Departure, grown: dict[str, Array]) -> Complex:
        axis = np.array([slider.axis for slider in self.machine.file.sliders])
        way = np.array(self.machine.scales) * m.q_m * grown["drives"][:, None] + d.travel_m
        return np.asarray(axis * (way + 1j * d.sideways_m))

    def _weights(self, d: Departure, grown: dict[str, Array], payload: np.ndarray) -> list[tuple[Complex, Complex]]:
        file = self.machine.file
        mass = np.array([load.mass_kg for load in self.machine.payloads])[payload]
        centre = np.array([load.centre for load in self.machine.payloads])[payload]
        return [
            (file.centre_of_mass * grown["platform"], np.full(len(mass), file.moving_mass_kg * file.gravity)),
            (centre * grown["platform"] + d.payload_shift_m, mass * file.gravity),
        ]


def affected_machine(
    machine: TrueMachine, view: StationView, nominal: MachineFile, settings: MockSettings, *, start_s: float = 0.0
) -> AffectedMachine | None:
    """The machine with the effects and the nuisance of its settings; None without any."""
    effects = effects_of(nominal, settings, start_s=start_s)
    return AffectedMachine(machine, view, effects) if effects else None


def effects_of(nominal: MachineFile, settings: MockSettings, *, start_s: float = 0.0) -> list[Effect]:
    """What the settings switch on; raises EffectError."""
    site = Site(nominal, settings.station_position_m, start_s)
    levels = {
        "ordinary_drift": settings.nuisance.drift_m,
        "ordinary_reseat": settings.nuisance.reseat_m,
        "ordinary_reversal": settings.nuisance.reversal_m,
        "ordinary_temperature": settings.nuisance.temperature_k,
    }
    ordinary = [EffectChoice(name, level) for name, level in levels.items() if level > 0.0]
    chosen = [choice for choice in settings.effects if choice.size > 0.0]
    return [make(choice, site, settings.seed) for choice in (*ordinary, *chosen)]


def moments(
    history: MotionHistory,
    t_s: Array,
    q_m: Array,
    velocity_m_per_s: Array,
    payload_kg: Array,
    exchanges: Array,
    thermal: Thermal,
    *,
    drives_s: Array | None = None,
) -> Moments:
    """Moments (n,) at which the drives stand at `q_m` (n, d); `drives_s` if they are seen at other times."""
    legs = history.at(t_s if drives_s is None else drives_s)
    return Moments(
        t_s=t_s,
        q_m=q_m,
        leg=legs["leg"].astype(np.intp),
        from_m=legs["from_m"],
        leg_start_s=legs["leg_start_s"],
        leg_end_s=legs["leg_end_s"],
        speed_m_per_s=legs["speed_m_per_s"],
        velocity_m_per_s=velocity_m_per_s,
        direction=legs["direction"],
        payload_kg=payload_kg,
        exchanges=exchanges,
        parts_c={name: thermal.part_series_c(name, t_s) for name in SENSORS},
        thermal=thermal,
    )


def heavy_tailed(normal: Array, degrees: float, rng: np.random.Generator) -> Array:
    """Student's t of unit variance from unit normal values (..., k): one common divisor a reading; 0 leaves them."""
    if not degrees:
        return normal
    spread = rng.chisquare(degrees, normal.shape[:-1])[..., None]
    return np.asarray(normal * np.sqrt((degrees - 2.0) / spread))


def polar_series(view: StationView, places_m: Array, t_s: Array) -> Sight:
    """Points of the machine frame (n, smrs, 3) as the drifting station sees them at times (n,)."""
    turn, shift = view.drift_series(t_s)
    points = places_m @ view.rotation.T + view.translation_m
    seen = points + np.cross(turn[:, None, :], points) + shift[:, None, :]
    distance = np.sqrt((seen**2).sum(axis=2))
    hz = np.arctan2(seen[..., 0], seen[..., 1]) % TWO_PI
    return Sight(seen, hz, np.arccos(seen[..., 2] / distance), distance)
