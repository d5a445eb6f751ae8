"""What effects see and change: legs of the drives, states of motion, the machine's deviation, the station's sight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mock_devices.machine_file import MachineFile

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Law = Callable[[Array, Array], tuple[Array, Array]]


@dataclass
class Leg:
    """One motion of one drive and the dwell after it, until the next begins. `direction` is kept at rest."""

    start_s: float
    end_s: float
    from_m: float
    to_m: float
    speed_m_per_s: float
    direction: float
    until_s: float = float("inf")


class Temperatures(Protocol):
    """Past temperatures, for parts that lag behind them."""

    def part_series_c(self, name: str, t_s: Array) -> Array:
        """True temperature of a part at several times."""
        ...

    def air_series_c(self, t_s: Array) -> Array:
        """True temperature of the air."""
        ...

    def pressure_series_hpa(self, t_s: Array) -> Array:
        """Pressure of the air."""
        ...


@dataclass(frozen=True)
class MotionState:
    """The machine at n observations: everything (n,) or (n, drives); `leg` counts each drive's legs.

    loads_n: force of each drive in its positive direction without effects, of a plant that knows it.
    """

    t_s: Array
    q_m: Array
    leg: NDArray[np.intp]
    from_m: Array
    leg_start_s: Array
    leg_end_s: Array
    speed_m_per_s: Array
    velocity_m_per_s: Array
    direction: Array
    payload_kg: Array
    exchanges: Array
    parts_c: dict[str, Array]
    thermal: Temperatures
    loads_n: Array | None = None

    @property
    def since_s(self) -> Array:
        """Time since each drive came to rest (n, d), zero while it moves."""
        return np.maximum(self.t_s[:, None] - self.leg_end_s, 0.0)

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass
class Deviation:
    """What differs from the machine without effects, for n moments.

    travel, sideways: of a slider along its axis and across it (axis turned by +90 degrees); yaw about the middle of its
    joints. length, ln_stiffness: (n, struts). platform_joint, base_joint: complex (n, struts). frame_shift,
    frame_turn_rad: of the whole machine against the floor. payload_mass_kg: beyond the payload's own, at its centre.
    loads: forces at points of the platform. carriage_*: compliance (n, d, 3: along, across, yaw) and cubic hardening.
    smr: (n, smrs, 3) in the SMR's own frame. force_n: what the drives' torque shows besides the stated weight.
    """

    travel_m: Array
    sideways_m: Array
    yaw_rad: Array
    length_m: Array
    ln_stiffness: Array
    platform_joint_m: Complex
    base_joint_m: Complex
    smr_m: Array
    frame_shift_m: Complex
    frame_turn_rad: Array
    payload_shift_m: Complex
    payload_mass_kg: Array
    moment_nm: Array
    force_n: Array
    carriage_compliance: Array
    carriage_hardening: Array
    loads: list[tuple[Complex, Complex]] = field(default_factory=list)
    laws: dict[int, list[Law]] = field(default_factory=dict)

    @classmethod
    def none(cls, n: int, machine: MachineFile) -> Deviation:
        """No deviation."""
        d, s, m = len(machine.sliders), len(machine.struts), len(machine.smrs)

        def zero(*shape: int) -> Array:
            return np.zeros((n, *shape))

        def none(*shape: int) -> Complex:
            return np.zeros((n, *shape), dtype=np.complex128)

        return cls(
            travel_m=zero(d),
            sideways_m=zero(d),
            yaw_rad=zero(d),
            length_m=zero(s),
            ln_stiffness=zero(s),
            platform_joint_m=none(s),
            base_joint_m=none(s),
            smr_m=zero(m, 3),
            frame_shift_m=none(),
            frame_turn_rad=zero(),
            payload_shift_m=none(),
            payload_mass_kg=zero(),
            moment_nm=zero(),
            force_n=zero(d),
            carriage_compliance=zero(d, 3),
            carriage_hardening=zero(d, 3),
        )


@dataclass
class StationSight:
    """What the station sees of all SMRs, free of noise: (n, smrs); effects of the instrument change it in place.

    points_m: (n, smrs, 3) in the frame of the station.
    """

    points_m: Array
    hz_rad: Array
    v_rad: Array
    distance_m: Array
