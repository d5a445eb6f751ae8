"""A twin that is served: it is told what its drives do as a recording of them would say."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.machine.description import load_machine, shipped_machine
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits
from pkm_rig.virtual.twin_rig import PAST_ROWS, InstantState, RunningTwin

MACHINE = load_machine(shipped_machine("planar4"))


class Nominal:
    """The nominal machine: reflectors of the platform at its equilibrium. Keeps what it was asked last."""

    def places_m(self, moments, rows):
        self.asked = moments
        model = Model(ParameterSet.of(MACHINE))
        target = np.zeros((len(moments), 6))
        visits = Visits(moments.drives, target, moments.payload_kg, moments.payload_com_m, moments.temperatures_c)
        rest = model.predict(np.zeros(len(model)), visits).equilibrium
        places = np.stack([rest.position_m + rest.rotation @ s.position_m for s in MACHINE.smrs], axis=1)
        return places[rows]


def look(t_s, drives_m, *, arrived_s, moving=False, speed=0.3, payload_kg=0.0):
    return InstantState(
        t_s=t_s,
        drives_m=np.array(drives_m),
        velocity_m_per_s=np.zeros(2),
        direction=np.array([1.0, -1.0]),
        torque=np.full(2, 0.1),
        highest_speed_since=lambda _t: speed,
        arrived_s=arrived_s,
        moving=moving,
        payload_kg=payload_kg,
        payload_com_m=(0.0, -0.2, 0.0),
        exchanges=0,
    )


@pytest.fixture
def live():
    nominal = Nominal()
    return nominal, RunningTwin(nominal, ("struts", "base", "columns", "platform"), lambda name, t: 20.0 + 1e-4 * t)


def test_arrivals_are_stops_at_which_something_was_measured(live):
    nominal, twin = live
    twin.places_m(look(100.0, (1.1, 1.1), arrived_s=50.0))
    twin.places_m(look(110.0, (1.2, 1.1), arrived_s=112.0, moving=True))
    assert len(nominal.asked.history.drives) == 1
    twin.places_m(look(114.0, (1.2, 1.1), arrived_s=112.0, speed=0.2))
    twin.places_m(look(117.0, (1.2, 1.1), arrived_s=112.0, speed=9.0))
    asked = nominal.asked
    np.testing.assert_allclose(asked.history.drives, [[1.1, 1.1], [1.2, 1.1]])
    np.testing.assert_allclose(asked.history.arrived_s, [50.0, 112.0])
    assert (asked.dwell_s[-1], asked.speed_m_per_s[-1], asked.elapsed_s[-1]) == (5.0, 0.2, 17.0)
    np.testing.assert_allclose(asked.former[-1], [1.1, 1.1])


def test_earlier_temperatures_are_told_with_their_times(live):
    nominal, twin = live
    twin.places_m(look(1000.0, (1.1, 1.1), arrived_s=50.0))
    twin.places_m(look(5000.0, (1.1, 1.1), arrived_s=50.0))
    asked = nominal.asked
    assert len(asked) == PAST_ROWS + 1
    assert (asked.t_s[0], asked.t_s[-1]) == (1000.0, 5000.0)
    assert np.all(np.diff(asked.t_s) > 0.0)
    np.testing.assert_allclose(asked.temperatures_c["struts"], 20.0 + 1e-4 * asked.t_s)
    assert set(asked.temperatures_c) == {"air", "struts", "base", "columns", "platform"}


def test_places_are_those_of_now(live):
    _, twin = live
    home = twin.places_m(look(100.0, (1.1, 1.1), arrived_s=50.0))
    there = twin.places_m(look(120.0, (1.2, 1.2), arrived_s=115.0))
    loaded = twin.places_m(look(130.0, (1.2, 1.2), arrived_s=115.0, payload_kg=400.0))
    assert home.shape == (len(MACHINE.smrs), 3)
    platform = [i for i, s in enumerate(MACHINE.smrs) if s.on == "platform"]
    np.testing.assert_allclose((there - home)[platform, 1], 0.1, atol=1e-4)
    assert np.all(np.abs(loaded - there)[platform, 1] > 1e-7)
