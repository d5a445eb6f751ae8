"""The true machine: the file's machine with errors drawn within its tolerances, and where its parts stand.

Not modelled: friction, backlash and flexibility of joints, flexible platform or sliders, motion out of the
plane, straightness of the guides, hysteresis of any kind.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace

import numpy as np

from mock_devices.machine_file import MachineFile, Smr, Vector3
from mock_devices.plant.structure import Member, PlanarPose, Weight, assembled_start, equilibrium
from mock_devices.seeds import generator
from mock_devices.settings import MockSettings, Payload

_FLOOR_HALF_WIDTH_M = 3.0e-3


@dataclass(frozen=True)
class TrueMachine:
    """A machine file's machine, not nominal any more; `scales` are those of the sliders."""

    file: MachineFile
    scales: tuple[float, ...]
    payloads: tuple[Weight, ...]

    def pose(self, drives_m: tuple[float, ...], payload: int, temperatures_c: dict[str, float]) -> PlanarPose:
        """The pose at rest for encoder positions, a payload's number and the parts' temperatures."""
        grown = self._growth(temperatures_c)
        members = [self._member(i, drives_m, grown) for i in range(len(self.file.struts))]
        moving = Weight(self.file.moving_mass_kg, self.file.centre_of_mass * grown["platform"])
        load = self.payloads[payload]
        load = replace(load, centre=load.centre * grown["platform"])
        return equilibrium(members, [moving, load], self.file.gravity, self._start(members))

    def tool_point(self, pose: PlanarPose, temperatures_c: dict[str, float]) -> complex:
        """Where the tool point is, in the plane of the machine frame."""
        return pose.place(self.file.tool_point * self._growth(temperatures_c)["platform"])

    def smr_positions(
        self, pose: PlanarPose, drives_m: tuple[float, ...], temperatures_c: dict[str, float]
    ) -> list[Vector3]:
        """Where each SMR is in the machine frame, in the order of the file."""
        grown = self._growth(temperatures_c)
        names = [slider.name for slider in self.file.sliders]
        places: list[Vector3] = []
        for smr in self.file.smrs:
            x, y, z = smr.position_m
            if smr.on == "platform":
                spot, z = pose.place(complex(x, y) * grown["platform"]), z * grown["platform"]
            elif smr.on == "floor":
                spot = complex(x, y)
            else:
                spot = complex(x, y) * grown["base"] + self._travel(names.index(smr.on), drives_m, grown)
                z *= grown["base"]
            places.append((spot.real, spot.imag, z))
        return places

    def _growth(self, temperatures_c: dict[str, float]) -> dict[str, float]:
        reference_c = self.file.reference_temperature_c
        return {
            part: 1.0 + e.coefficient_per_k * (temperatures_c[e.sensor] - reference_c)
            for part, e in self.file.expansion.items()
        }

    def _travel(self, drive: int, drives_m: tuple[float, ...], grown: dict[str, float]) -> complex:
        return self.file.sliders[drive].axis * (self.scales[drive] * drives_m[drive] * grown["drives"])

    def _member(self, index: int, drives_m: tuple[float, ...], grown: dict[str, float]) -> Member:
        strut = self.file.struts[index]
        joint = strut.base_joint * grown["base"] + self._travel(strut.drive, drives_m, grown)
        return Member(
            strut.platform_joint * grown["platform"],
            joint,
            strut.length_m * grown["struts"],
            strut.stiffness_n_per_m,
        )

    def _start(self, members: list[Member]) -> PlanarPose:
        first = next(i for i, strut in enumerate(self.file.struts) if strut.drive == 0)
        other = next(i for i, strut in enumerate(self.file.struts) if strut.drive != 0)
        a, b = members[first], members[other]
        slider = self.file.sliders[0]
        centre_a, centre_b = a.slider_joint - a.platform_joint, b.slider_joint - b.platform_joint
        p = assembled_start(centre_a, centre_b, a.length_m, b.length_m, slider.axis, slider.branch)
        return PlanarPose(p, 0.0)


def knocked(machine: TrueMachine, slider: str, lean_rad: float, shift_m: float) -> TrueMachine:
    """The machine after a knock: a slider's column leans about its drive's zero, its joints stand farther along x."""
    number = [s.name for s in machine.file.sliders].index(slider)
    leaning, axis = machine.file.sliders, machine.file.sliders[number].axis * cmath.exp(1j * lean_rad)
    sliders = (*leaning[:number], replace(leaning[number], axis=axis), *leaning[number + 1 :])
    struts = tuple(
        replace(s, base_joint=s.base_joint + shift_m) if s.drive == number else s for s in machine.file.struts
    )
    return replace(machine, file=replace(machine.file, sliders=sliders, struts=struts))


def draw_machine(file: MachineFile, settings: MockSettings) -> TrueMachine:
    """Draw the true machine of a seed. A nest length holds to its certificate's error (first two floor SMRs)."""
    seed, scale, width = settings.seed, settings.error_scale, file.tolerances

    def uniform(purpose: str, half_width: float, count: int) -> np.ndarray:
        return half_width * generator(seed, purpose).uniform(-1.0, 1.0, count)

    n, sliders = len(file.struts), len(file.sliders)
    lengths = uniform("strut length", scale * width.strut_length_m, n)
    platform = uniform("platform joint", scale * width.platform_joint_m, 2 * n)
    base = uniform("base joint", scale * width.base_joint_m, 2 * n)
    ln_k = uniform("ln stiffness", width.ln_stiffness, n)
    struts = tuple(
        replace(
            strut,
            platform_joint=strut.platform_joint + complex(platform[2 * i], platform[2 * i + 1]),
            base_joint=strut.base_joint + complex(base[2 * i], base[2 * i + 1]),
            length_m=strut.length_m + float(lengths[i]),
            stiffness_n_per_m=strut.stiffness_n_per_m * math.exp(ln_k[i]),
        )
        for i, strut in enumerate(file.struts)
    )
    tilts = uniform("axis tilt", scale * width.axis_tilt_rad, sliders)
    tilted = tuple(
        replace(slider, axis=slider.axis * cmath.exp(1j * float(tilts[i]))) for i, slider in enumerate(file.sliders)
    )
    scales = 1.0 + uniform("drive scale", scale * width.drive_scale, sliders)
    expanding = {
        part: replace(e, coefficient_per_k=e.coefficient_per_k + float(uniform(part, e.u_per_k, 1)[0]))
        for part, e in file.expansion.items()
    }
    true_file = replace(file, struts=struts, sliders=tilted, expansion=expanding, smrs=_draw_smrs(file, settings))
    payloads = tuple(_draw_payload(i, payload, seed) for i, payload in enumerate(settings.payloads))
    return TrueMachine(true_file, tuple(float(s) for s in scales), payloads)


def _draw_smrs(file: MachineFile, settings: MockSettings) -> tuple[Smr, ...]:
    smrs = []
    for i, smr in enumerate(file.smrs):
        width_m = _FLOOR_HALF_WIDTH_M if smr.on == "floor" else file.tolerances.smr_position_m
        shift = generator(settings.seed, "smr", i).uniform(-width_m, width_m, 3)
        smrs.append(replace(smr, position_m=_add(smr.position_m, shift)))
    nests = [i for i, smr in enumerate(file.smrs) if smr.on == "floor"][:2]
    if len(nests) == 2:
        first, second = nests
        nominal = np.subtract(file.smrs[second].position_m, file.smrs[first].position_m)
        error_m = settings.certificate_sd_m * generator(settings.seed, "certificate").standard_normal()
        apart = np.subtract(smrs[second].position_m, smrs[first].position_m)
        apart *= (np.linalg.norm(nominal) + error_m) / np.linalg.norm(apart)
        smrs[second] = replace(smrs[second], position_m=_add(smrs[first].position_m, apart))
    return tuple(smrs)


def _draw_payload(index: int, payload: Payload, seed: int) -> Weight:
    mass, x, y = generator(seed, "payload", index).standard_normal(3)
    centre = complex(payload.com_m[0] + payload.u_com_m * x, payload.com_m[1] + payload.u_com_m * y)
    return Weight(payload.mass_kg + payload.u_mass_kg * float(mass), centre)


def _add(position_m: Vector3, shift: np.ndarray) -> Vector3:
    x, y, z = (float(a + b) for a, b in zip(position_m, shift, strict=True))
    return x, y, z
