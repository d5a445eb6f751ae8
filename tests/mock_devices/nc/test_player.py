"""The mock's control at work: where it brings its drives, when it stops, and what it refuses."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from calibration.machine.description import load_machine, shipped_machine
from mock_devices.commands import execute
from mock_devices.nc.correction import Correction, Grid
from mock_devices.nc.program import parse_program, read_program
from mock_devices.rig import MockRig
from mock_devices.settings import MockSettings
from pkm_rig.jobs.nc_program import NcChoice, write_program
from pkm_rig.rig.clock import VirtualClock
from pkm_rig.rig.config import demo_rig_path, load_rig
from pkm_rig.virtual.embedded_bus import EmbeddedBus
from pkm_rig.virtual.mock_rig import settings_of

TWO = "(payload 1: plate)\nM0\nN1\nG1 X1000 Y1200 F30000\nG4 P2\nN2\nG1 X1100 Y1150 F30000\nM0\nM2\n"


@contextmanager
def mock_of(machine, settings=None):
    clock = VirtualClock()
    settings = settings or MockSettings(seed=3, error_scale=0.0)
    try:
        with (
            MockRig(shipped_machine(machine), settings, clock, lambda: EmbeddedBus(f"nc-{machine}", clock)) as mock,
            clock.activity(),
        ):
            yield mock
    finally:
        clock.close()


def places(mock):
    t_s = mock.plant.clock.now_s()
    return [drive.encoder_m(t_s) for drive in mock.drives]


def test_it_stops_where_the_program_does_and_goes_on_when_told():
    with mock_of("planar4") as mock:
        player, clock = mock.load_program(parse_program(TWO)), mock.plant.clock
        player.start()
        clock.sleep_s(100.0)
        assert player.state == "waits for payload 1"
        player.start()
        clock.sleep_s(2.0)
        assert (player.state, player.visit) == ("running", 1)
        assert places(mock) == pytest.approx([1.0, 1.2], abs=1e-8)
        with pytest.raises(ValueError, match="the program runs"):
            player.start()
        clock.sleep_s(3.0)
        assert (player.state, player.visit) == ("waits for start", 2)
        assert places(mock) == pytest.approx([1.1, 1.15], abs=1e-8)
        player.start()
        clock.sleep_s(1.0)
        assert player.state == "ended"
        assert execute(mock, "program start N1").startswith("program: running")


def test_an_operator_waits_for_the_payload_that_a_stop_is_for():
    with mock_of("planar4") as mock:
        player, clock = mock.load_program(parse_program(TWO), operator_s=5.0), mock.plant.clock
        player.start()
        clock.sleep_s(60.0)
        assert player.state == "waits for payload 1"
        mock.plant.put_on(1)
        clock.sleep_s(30.0)
        assert player.state == "ended"


def test_its_own_correction_is_that_of_the_payload_that_is_on():
    grid = Grid((0,), (np.array([0.9, 1.3]),), np.array([1e-4, 1e-4]))
    with mock_of("planar4") as mock:
        player = mock.load_program(parse_program(TWO), {1: Correction(((grid,), ()))}, 0.5)
        mock.plant.put_on(1)
        player.start()
        mock.plant.clock.sleep_s(30.0)
        assert places(mock) == pytest.approx([1.1001, 1.15], abs=1e-8)
        mock.plant.put_on(0)
        player.start(2)
        mock.plant.clock.sleep_s(30.0)
        assert places(mock) == pytest.approx([1.1, 1.15], abs=1e-8)


def test_beyond_the_travel_it_stands_with_an_alarm():
    text = TWO.replace("Y1150", "Y9000")
    with mock_of("planar4") as mock:
        player = mock.load_program(parse_program(text), operator_s=0.5)
        mock.plant.put_on(1)
        player.start()
        mock.plant.clock.sleep_s(30.0)
        assert player.state == "alarm at N2: right: 9.0000 is beyond its travel"
        assert places(mock) == pytest.approx([1.0, 1.2], abs=1e-8)


def test_a_program_for_other_axes_is_refused_and_so_is_drive_by_drive_where_drives_must_agree():
    with mock_of("rrr3") as mock, pytest.raises(ValueError, match="moves 2 axes, rrr3 has 3"):
        mock.load_program(parse_program(TWO))
    eight = TWO.replace("X1000 Y1200", "X1 Y1 Z1 A1 B1 C1 U1 V1").replace("X1100 Y1150", "X1 Y1 Z1 A1 B1 C1 U1 V1")
    with mock_of("gough8") as mock, pytest.raises(ValueError, match="must command the tool"):
        mock.load_program(parse_program(eight))
    with mock_of("rrr3") as mock, pytest.raises(ValueError, match="without --program"):
        execute(mock, "program start")


def test_it_leads_a_machine_whose_drives_must_agree_without_straining_it(tmp_path):
    name = "gough8"
    path = demo_rig_path(name)
    file, machine = load_rig(path)
    file = file.model_copy(update={"campaign": file.campaign.model_copy(update={"calibration_poses": 6})})
    write_program(file, machine, tmp_path / "tool.ngc", NcChoice("tool", dwell_s=1.0))
    rows = np.genfromtxt(tmp_path / "tool.csv", delimiter=",", names=True)
    unit = "rad" if machine.rotary_drives else "m"
    with mock_of(name, replace(settings_of(file, path), seed=3, error_scale=0.0)) as mock:
        player = mock.load_program(read_program(tmp_path / "tool.ngc"))
        player.start(1)
        mock.plant.clock.sleep_s(0.1)
        for row in rows[:2]:
            while player.visit == row["visit"] and player.state == "running":
                before = places(mock)
                mock.plant.clock.sleep_s(0.2)
            planned = [row[f"{drive}_{unit}"] for drive in machine.drive_names]
            assert before == pytest.approx(planned, abs=3e-8)
        assert player.state == "running"
    assert load_machine(shipped_machine(name)).redundantly_actuated
