"""Effects in the choice of a check's poses: their columns against the model's own differences, and what they change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.legendre import Legendre

from calibration.intervals.check_design import CheckReadings, check_design, choose_poses
from calibration.intervals.check_effects import CURVES, with_effects
from calibration.intervals.watched import watched_changes
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.inverse import nominal_drives
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits

STATION_M = np.array([0.0, 0.3, 3.2])
SD_M = 8e-6


def visits_of(machine, xy):
    target = np.zeros((len(xy), 6))
    target[:, :2] = xy
    return Visits.at_reference_temperature(machine, nominal_drives(machine, target), target)


@pytest.fixture(scope="module")
def case():
    """A planar machine's design without and with effects, and what both are made of."""
    machine = load_machine(shipped_machine("planar4"))
    model, mounting = Model(ParameterSet.of(machine)), np.array([s.position_m for s in machine.smrs])
    rng = np.random.default_rng(14)
    reach = np.array([0.33, 0.28])
    visited, workspace = (visits_of(machine, rng.uniform(-1.0, 1.0, (n, 2)) * reach) for n in (24, 40))

    def predict(visits):
        return model.predict(np.zeros(len(model)), visits)

    moving = [i for i, s in enumerate(machine.smrs) if s.on != "floor"]
    visit, smr = np.repeat(np.arange(24), len(moving)), np.tile(moving, 24)
    poses, size = predict(visited), len(model.parameters) + 3 * len(moving)
    place = np.stack([poses.reflector_m(s, mounting[s]) for s in moving], axis=1).reshape(-1, 3)
    readings = CheckReadings(visit, smr, place, np.tile(np.eye(3) / SD_M, (len(visit), 1, 1)))
    plain = check_design(
        readings, poses, predict(workspace), mounting, watched_changes(model.parameters), station_m=STATION_M,
        range_u=(1e-4, 1e-6), prior=np.zeros((size, size)), reference=np.zeros((size, size)),
    )  # fmt: skip
    design = with_effects(plain, readings, predict, visited, workspace, mounting)
    return predict, visited, workspace, readings, mounting, plain, design


def test_their_columns_are_the_model_s_own_differences(case):
    predict, visited, workspace, readings, mounting, plain, design = case
    step, curve = 1e-6, Legendre.basis(3, domain=[workspace.drives[:, 1].min(), workspace.drives[:, 1].max()])

    def along_curve(visits):
        drives = visits.drives.copy()
        drives[:, 1] += step * curve(visits.drives[:, 1])
        return replace(visits, drives=drives)

    def warmer(visits):
        return replace(
            visits, temperatures_c={**visits.temperatures_c, "struts": visits.temperatures_c["struts"] + 2.0}
        )

    for name, change, size in (("curve_3.right", along_curve, step), ("growth.struts", warmer, 2.0)):
        column = design.watched.combination[:, design.watched.names.index(name)]
        seen, tool = np.zeros((len(readings.smr), 3)), predict(change(workspace)).tool_m() - predict(workspace).tool_m()
        for smr in np.unique(readings.smr):
            rows = readings.smr == smr
            before, after = (predict(v).reflector_m(int(smr), mounting[smr]) for v in (visited, change(visited)))
            seen[rows] = (after - before)[readings.visit[rows]]
        scale = np.abs(seen).max() / SD_M / size
        assert design.by_parameter @ column == pytest.approx(readings.whitened(seen) / size, abs=2e-3 * scale)
        assert design.workspace @ column == pytest.approx(tool.ravel() / size, abs=2e-3 * np.abs(tool).max() / size)
    effects = design.watched.names[len(plain.watched.names) :]
    assert len(effects) == 2 * len(CURVES) + 4 + 4  # curves of two drives, four sensors, four struts
    assert design.watched.names[: -len(effects)] == plain.watched.names


def test_poses_that_are_chosen_for_them_tell_more_of_them_and_no_less_of_the_rest(case):
    *_, readings, _, plain, design = case
    of_visit, own = np.repeat(readings.visit, 3), len(plain.watched.names)

    def known_m(chosen):
        some = design.rows(np.isin(of_visit, chosen))
        return some.error_per_change * some.change_u

    without, with_them = (known_m(choose_poses(one, of_visit, 6)) for one in (plain, design))
    assert with_them[own:].max() < without[own:].max()
    assert with_them[:own].max() < 1.1 * without[:own].max()
