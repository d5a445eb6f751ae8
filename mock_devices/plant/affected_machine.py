"""The true machine with its effects, for many states at once: positions of reflectors and what the station sees.

Without effects it agrees with `true_machine` to round-off; it is a second path to the same physics.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mock_devices.effects.base import Array, Complex, Deviation, Effect, EffectChoice, MotionState, Site, StationSight
from mock_devices.effects.catalogue import make
from mock_devices.machine_file import MachineFile
from mock_devices.plant.elastic_batch import Equilibria, Structure, solve, start
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

    def deviation(self, state: MotionState) -> Deviation:
        """What the effects change."""
        deviation = Deviation.none(len(state), self.machine.file)
        for effect in self.effects:
            effect.act(state, deviation)
        return deviation

    def early_s(self, state: MotionState) -> Array:
        """By how much the machine is ahead in time when the station measures (n,)."""
        return np.zeros(len(state)) + sum(effect.early_s(state) for effect in self.effects)

    def equilibria(self, state: MotionState, deviation: Deviation, payload: np.ndarray) -> tuple[Equilibria, Structure]:
        """Equilibria (n,) for payload numbers (n,)."""
        file, grown = self.machine.file, self._growth(state)
        axis = np.array([slider.axis for slider in file.sliders])
        travel = self._travel(state, deviation, grown)
        base = np.empty((len(state), len(self._struts)), dtype=np.complex128)
        platform = np.empty_like(base)
        centre = np.empty((len(state), len(axis)), dtype=np.complex128)
        for a in range(len(axis)):
            mine = [i for i, strut in enumerate(self._struts) if strut.drive == a]
            middle = np.mean([self._struts[i].base_joint for i in mine]) * grown["base"]
            centre[:, a] = middle + travel[:, a]
            turn = np.exp(1j * deviation.yaw_rad[:, a])
            for i in mine:
                arm = self._struts[i].base_joint * grown["base"] - middle + deviation.base_joint_m[:, i]
                base[:, i] = centre[:, a] + arm * turn
        for i, strut in enumerate(self._struts):
            platform[:, i] = strut.platform_joint * grown["platform"] + deviation.platform_joint_m[:, i]
        soft = bool(np.any(deviation.carriage_compliance))
        structure = Structure(
            platform_joint=platform,
            base_joint=base,
            length_m=np.array([s.length_m for s in self._struts]) * grown["struts"][:, None] + deviation.length_m,
            stiffness=np.array([s.stiffness_n_per_m for s in self._struts]) * np.exp(deviation.ln_stiffness),
            drive=tuple(strut.drive for strut in self._struts),
            axis=axis,
            centre=centre,
            loads=[*self._weights(deviation, grown, payload), *deviation.loads],
            moment_nm=deviation.moment_nm,
            laws=deviation.laws,
            compliance=deviation.carriage_compliance if soft else None,
            hardening=deviation.carriage_hardening if soft else None,
        )
        first = start(structure, file.sliders[0].branch, self._first, self._other)
        return solve(structure, first), structure

    def reflector_positions(self, state: MotionState, payload: np.ndarray) -> Array:
        """All reflectors in the frame of the floor (n, smrs, 3)."""
        deviation = self.deviation(state)
        equilibria, structure = self.equilibria(state, deviation, payload)
        grown = self._growth(state)
        names = [slider.name for slider in self.machine.file.sliders]
        turn, lean = np.exp(1j * equilibria.rz_rad), np.exp(1j * deviation.frame_turn_rad)
        out = np.empty((len(state), len(self.machine.file.smrs), 3))
        for i, smr in enumerate(self.machine.file.smrs):
            x, y, z = smr.position_m
            extra = deviation.smr_m[:, i, 0] + 1j * deviation.smr_m[:, i, 1]
            height = z + deviation.smr_m[:, i, 2]
            if smr.on == "floor":
                spot = complex(x, y) + extra
            elif smr.on == "platform":
                spot = equilibria.p + turn * (complex(x, y) * grown["platform"] + extra)
                height = height + z * (grown["platform"] - 1.0)
            else:
                a = names.index(smr.on)
                spot = self._on_slider(complex(x, y), extra, a, deviation, equilibria, structure, grown)
                height = height + z * (grown["base"] - 1.0)
            if smr.on != "floor":
                spot = lean * spot + deviation.frame_shift_m
            out[:, i, 0], out[:, i, 1], out[:, i, 2] = spot.real, spot.imag, height
        return out

    def sight(self, state: MotionState, payload: np.ndarray) -> StationSight:
        """What the station sees of all reflectors, free of noise (n, smrs)."""
        places = self.reflector_positions(state, payload)
        seen = polar_series(self.view, places, state.t_s)
        for effect in self.effects:
            effect.apply_to_sight(state, seen)
        seen.hz_rad %= TWO_PI
        return seen

    def _on_slider(
        self,
        spot: complex,
        extra: Complex,
        a: int,
        deviation: Deviation,
        equilibria: Equilibria,
        structure: Structure,
        grown: dict[str, Array],
    ) -> Complex:
        mine = [strut.base_joint for strut in self._struts if strut.drive == a]
        arm = (spot - np.mean(mine)) * grown["base"] + extra
        u = equilibria.carriage[:, a]
        given = structure.axis[a] * (u[:, 0] + 1j * u[:, 1])
        return np.asarray(structure.centre[:, a] + given + arm * np.exp(1j * (deviation.yaw_rad[:, a] + u[:, 2])))

    def _growth(self, state: MotionState) -> dict[str, Array]:
        reference_c = self.machine.file.reference_temperature_c
        return {
            part: 1.0 + e.coefficient_per_k * (state.parts_c[e.sensor] - reference_c)
            for part, e in self.machine.file.expansion.items()
        }

    def _travel(self, state: MotionState, deviation: Deviation, grown: dict[str, Array]) -> Complex:
        axis = np.array([slider.axis for slider in self.machine.file.sliders])
        way = np.array(self.machine.scales) * state.q_m * grown["drives"][:, None] + deviation.travel_m
        return np.asarray(axis * (way + 1j * deviation.sideways_m))

    def _weights(
        self, deviation: Deviation, grown: dict[str, Array], payload: np.ndarray
    ) -> list[tuple[Complex, Complex]]:
        file = self.machine.file
        mass = np.array([load.mass_kg for load in self.machine.payloads])[payload]
        centre = np.array([load.centre for load in self.machine.payloads])[payload]
        return [
            (file.centre_of_mass * grown["platform"], np.full(len(mass), file.moving_mass_kg * file.gravity)),
            (
                centre * grown["platform"] + deviation.payload_shift_m,
                (mass + deviation.payload_mass_kg) * file.gravity,
            ),
        ]


def affected_machine(
    machine: TrueMachine, view: StationView, nominal: MachineFile, settings: MockSettings, *, start_s: float = 0.0
) -> AffectedMachine | None:
    """The machine with the effects and the nuisance of its settings; None without any."""
    effects = make_effects(nominal, settings, start_s=start_s)
    return AffectedMachine(machine, view, effects) if effects else None


def make_effects(nominal: MachineFile, settings: MockSettings, *, start_s: float = 0.0) -> list[Effect]:
    """What the settings switch on; raises EffectError."""
    site = site_of(nominal, settings, start_s=start_s)
    levels = {
        "ordinary_drift": settings.nuisance.drift_m,
        "ordinary_reseat": settings.nuisance.reseat_m,
        "ordinary_reversal": settings.nuisance.reversal_m,
        "ordinary_temperature": settings.nuisance.temperature_k,
    }
    ordinary = [EffectChoice(name, level) for name, level in levels.items() if level > 0.0]
    if settings.rest_friction:  # a drive that is wound up has its friction from that
        wound_up = {choice.place for choice in settings.effects if choice.name == "friction_windup"}
        stiff = [(k, slider.name) for k, slider in enumerate(nominal.sliders) if slider.name not in wound_up]
        ordinary += [EffectChoice("ordinary_friction", 1.0, place, seed=k) for k, place in stiff]
    chosen = [choice for choice in settings.effects if choice.size > 0.0]
    return [make(choice, site, settings.seed) for choice in (*ordinary, *chosen)]


def site_of(nominal: MachineFile, settings: MockSettings, *, start_s: float = 0.0) -> Site:
    """What the effects of a rig may know of it."""
    return Site(nominal, settings.station_position_m, start_s, settings.known_tables)


def motion_states(
    history: MotionHistory,
    t_s: Array,
    q_m: Array,
    velocity_m_per_s: Array,
    payload_kg: Array,
    exchanges: Array,
    thermal: Thermal,
    *,
    drives_s: Array | None = None,
) -> MotionState:
    """MotionState (n,) at which the drives stand at `q_m` (n, d); `drives_s` if they are seen at other times."""
    legs = history.legs_at(t_s if drives_s is None else drives_s)
    return MotionState(
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


def polar_series(view: StationView, places_m: Array, t_s: Array) -> StationSight:
    """Points of the machine frame (n, smrs, 3) as the drifting station sees them at times (n,)."""
    turn, shift = view.drift_series(t_s)
    points = view.drift_free_series(places_m, t_s)
    seen = points + np.cross(turn[:, None, :], points) + shift[:, None, :]
    distance = np.sqrt((seen**2).sum(axis=2))
    hz = np.arctan2(seen[..., 0], seen[..., 1]) % TWO_PI
    return StationSight(seen, hz, np.arccos(seen[..., 2] / distance), distance)
