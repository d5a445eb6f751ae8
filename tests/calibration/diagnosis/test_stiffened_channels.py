"""How a response changes with a stiffness, against machines that are solved with both changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.machine import equilibrium
from tests.calibration.diagnosis.campaigns import Rest
from tests.calibration.diagnosis.changed_machine import MACHINES, VISITS, Case, changed_machine


@pytest.fixture(params=MACHINES)
def case(request) -> Case:
    return changed_machine(request.param)


def stiffened(case: Case, part: int, log_ratio: float) -> Rest:
    """At rest with another stiffness of a strut, or of a guide, which follow."""
    stiffness = case.rest.geometry.stiffness_n_per_m.copy()
    stiffness[part] *= np.exp(log_ratio)
    return case.rest.again(replace(case.rest.geometry, stiffness_n_per_m=stiffness))


def test_stiffened_responses(case):
    """How a response changes with a stiffness: mixed differences of machines that are solved with both changed."""
    machine = case.observed.machine
    parts = (*machine.strut_names, *machine.guide_names)
    drive, step, by = machine.drive_names[0], 1e-4, 0.1
    carrier = equilibrium.carriers_of(machine, case.rest.geometry, case.rest.drives, case.rest.at)[0]
    per_unit = carrier.travel / case.rest.drives[:, 0]
    strut = machine.strut_names[-1]

    def travelled(rest: Rest, h: float) -> np.ndarray:
        moved = rest.drives.copy()
        moved[:, 0] += h / per_unit
        return case.places(rest.again(drives=moved))

    def lengthened(rest: Rest, h: float) -> np.ndarray:
        length = rest.geometry.length_m.copy()
        length[-1] += h
        return case.places(rest.again(replace(rest.geometry, length_m=length)))

    def pushed(rest: Rest, h: float) -> np.ndarray:
        force = (np.tile([1e6 * h, 0.0, 0.0], (VISITS, 1)), np.zeros((VISITS, 3)))
        return case.places(replace(rest, at=replace(rest.at, forces=(*rest.at.forces, force))).again())

    cases = [(f"travel.{drive}", travelled, 1.0), (f"length.{strut}", lengthened, 1.0)]
    if "force.x" in case.channels.force_channels():
        cases.append(("force.x", pushed, 1e6))
    for channel, change, per in cases:
        whole = np.abs(case.channels.shift_m(channel)).max()
        for c, part in enumerate(parts):
            more, less = (stiffened(case, c, h) for h in (by, -by))
            mixed = (change(more, step) - change(more, -step)) - (change(less, step) - change(less, -step))
            expected = mixed / (4.0 * by * step * per)
            name = f"stiffened.{part}.{channel}"
            got = case.channels.shift_m(name)
            # Strains by weight turn the struts a little: a third-order term that it leaves out.
            np.testing.assert_allclose(got, expected, atol=0.02 * np.abs(expected).max() + 1e-3 * whole, err_msg=name)
        # Where nothing holds it more than it must, no part yields to another; a parallelogram's two move it together.
        if channel == "force.x" or (len(parts) > len(machine.dof) and channel.startswith("length.")):
            assert max(np.abs(case.channels.shift_m(f"stiffened.{p}.{channel}")).max() for p in parts) > 0.01 * whole
    for a, name in enumerate(machine.drive_names):
        from_middle = case.rest.drives[np.maximum(case.observed.visit, 0), a] - 0.5 * np.sum(machine.travel[a])
        expected = case.channels.shift_m(f"stiffened.{parts[0]}.travel.{name}") * from_middle[:, None]
        np.testing.assert_allclose(
            case.channels.shift_m(f"stiffened.{parts[0]}.scale.{name}"), expected, rtol=0.0, atol=1e-12
        )
