"""Effects and disturbances that act on a machine in space: what they change of it at one moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mock_devices.effects.base import Array, Deviation, Effect, MotionState
from mock_devices.effects.in_space import arms_m, check_in_space, require_only_scalars, view_of
from mock_devices.effects.ordinary_disturbances import OrdinaryTemperature
from mock_devices.effects.stated_values import Payload
from mock_devices.machine_file import MachineFile
from mock_devices.plant.affected_machine import make_effects
from mock_devices.plant.spatial_machine import Departure
from mock_devices.settings import MockSettings
from mock_devices.spatial_file import SpatialMachine


@dataclass(frozen=True)
class SpatialEffects:
    """Effects of a machine, the view that they have of it, and the unit (d,) of drives in their motions."""

    effects: tuple[Effect, ...]
    view: MachineFile
    metres: Array
    turns: Array  # (d,) whether a drive is a crank

    @classmethod
    def of(cls, file: SpatialMachine, settings: MockSettings, *, start_s: float = 0.0) -> SpatialEffects:
        """What the settings switch on; raises EffectError for what the machine cannot have."""
        view = view_of(file)
        for choice in settings.effects:
            check_in_space(choice, file)
        turns = np.array([float(drive.kind == "crank") for drive in file.drives])
        return cls(tuple(make_effects(view, settings, start_s=start_s)), view, arms_m(file), turns)

    def early_s(self, state: MotionState) -> float:
        """By how much the machine is ahead in time when the station measures."""
        return float(sum(np.sum(np.broadcast_to(effect.early_s(state), (1,))) for effect in self.effects))

    def departure(self, state: MotionState) -> Departure:
        """What they change at one state (of one row).

        The drives' loads follow from the weight itself, so that a payload's share of them is not added once more; the
        angle of a crank does not grow with the temperature.
        """
        total = Deviation.none(1, self.view)
        for effect in self.effects:
            travel, force = total.travel_m.copy(), total.force_n.copy()
            effect.act(state, total)
            if isinstance(effect, Payload):
                total.force_n = force
            if isinstance(effect, OrdinaryTemperature):
                total.travel_m = np.where(self.turns > 0.0, travel, total.travel_m)
        require_only_scalars(total)
        shift = complex(total.payload_shift_m[0])
        return Departure(
            travel=total.travel_m[0] / self.metres,
            length_m=total.length_m[0],
            ln_stiffness=total.ln_stiffness[0],
            smr_m=total.smr_m[0],
            payload_kg=float(total.payload_mass_kg[0]),
            payload_shift_m=np.array([shift.real, shift.imag, 0.0]),
            force_n=total.force_n[0],
        )
