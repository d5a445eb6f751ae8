"""A virtual clock, the example machine, plants and buses."""

from __future__ import annotations

import itertools
from pathlib import Path

import can
import pytest

from mock_devices.machine_file import read_machine_file
from mock_devices.plant.plant import Plant
from mock_devices.settings import MockSettings
from pkm_rig.rig.clock import VirtualClock
from pkm_rig.virtual.embedded_bus import EmbeddedBus
from tests.mock_devices.standing import StandingPlant

_channels = itertools.count()


@pytest.fixture
def clock():
    clock = VirtualClock()
    with clock.activity():  # the test itself: time passes only while it sleeps or a server does for it
        yield clock
    clock.close()


@pytest.fixture(scope="session")
def machine_path():
    return Path(__file__).parents[2] / "calibration" / "machine" / "data" / "planar4.toml"


@pytest.fixture(scope="session")
def machine_file(machine_path):
    return read_machine_file(machine_path)


@pytest.fixture
def make_plant(machine_path, clock):
    def make(**settings):
        return StandingPlant(Plant(machine_path, MockSettings(**settings), clock))

    return make


@pytest.fixture
def standing(make_plant):
    return make_plant(seed=3)


@pytest.fixture
def plant(standing):
    return standing.plant


@pytest.fixture
def bus_factory(clock):
    """Buses on one line of its own; shut down at the end if nobody did."""
    channel = f"test-{next(_channels)}"
    made: list[can.BusABC] = []

    def make():
        made.append(EmbeddedBus(channel, clock))
        return made[-1]

    yield make
    for bus in made:
        bus.shutdown()
