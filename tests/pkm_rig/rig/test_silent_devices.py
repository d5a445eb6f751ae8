"""A device that says nothing any more: how long it takes until the drives stand and the command ends.

Rig time is virtual; the time-outs of answers are host time and short here. The limits of real rigs are their multiples.
"""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from drivers.errors import DeviceError, NoAnswer
from mock_devices.faults import Fault, FaultPlan
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.plans import visits
from pkm_rig.rig.runner import describe_campaign, open_runner
from pkm_rig.rig.schedule import Block, calibration_blocks
from pkm_rig.store.store import Store, now_text
from pkm_rig.virtual.mock_rig import embedded_mock_rig
from tests.pkm_rig.conftest import short_rig_file

GUARD_S = 0.5
FAR = np.array([1.5, 1.5])
SPEED_M_PER_S = 0.02
STATUS_AFTER_S = 15.0
WATCHDOG_S, BEAT_S, BRAKE_S = 1.5, 0.25, 0.1


@contextmanager
def _rig(faults=None):
    file, machine = short_rig_file()
    with (
        embedded_mock_rig(file, embedded_rig_path(), faults=faults or FaultPlan()) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory, guard_s=GUARD_S) as rig,
    ):
        rig.enable()
        yield mock.mock, rig


def _stood_s(mock, since_s):
    """Rig time since then at which the last drive came to stand."""
    for drive in mock.drives:
        drive.axis.refresh()
    return max(drive.axis.motion.end_s for drive in mock.drives) - since_s


def test_a_silent_line_of_the_drives():
    plan = FaultPlan()
    with _rig(plan) as (mock, rig):
        silent_s = []

        def fall_silent():
            silent_s.append(rig.clock.now_s())
            plan.arm([Fault("can-peer-dead", 1)])

        rig.clock.call_at(rig.clock.now_s() + 1.0, fall_silent)
        with pytest.raises(DeviceError):
            rig.move(FAR, SPEED_M_PER_S)
        assert rig.clock.now_s() - silent_s[0] <= STATUS_AFTER_S
        rig.clock.sleep_s(5.0)
        assert _stood_s(mock, silent_s[0]) <= BEAT_S + WATCHDOG_S + BRAKE_S <= rig.file.limits.heartbeat_s


def test_a_silent_plc():
    over = threading.Event()
    with _rig() as (mock, rig):
        silent = []

        def fall_silent():
            silent.append((rig.clock.now_s(), time.monotonic()))
            mock.plc._loop.call_soon_threadsafe(over.wait, 60.0)  # its listener still lets clients in

        rig.clock.call_at(rig.clock.now_s() + 1.0, fall_silent)
        try:
            with pytest.raises(DeviceError):
                rig.move(FAR, SPEED_M_PER_S)
            took_s = time.monotonic() - silent[0][1]
        finally:
            over.set()
        assert isinstance(rig.supervisor.trip, NoAnswer)
        assert _stood_s(mock, silent[0][0]) <= BEAT_S + BRAKE_S
        # One read, one connection and one read again wait for nothing, in host time; the rest is a busy computer.
        assert took_s < 3.0 * GUARD_S + 5.0
        assert 3.0 * rig.file.plc.reply_timeout_s + rig.file.limits.poll_period_s <= rig.file.limits.plc_heartbeat_s


def test_a_silent_station(tmp_path):
    store = Store(tmp_path / "store.sqlite")
    silent = []
    with _rig() as (mock, rig):

        def fall_silent(_number, phase):
            if phase == "calibration":
                mock.station_server.tamper = lambda _answer: None
                silent.append(time.monotonic())

        store.add_campaign(describe_campaign(rig, "short", now_text()), rig.machine.text)
        with open_runner(rig, store, "short", fall_silent) as runner:
            rig.refresh_atmosphere()
            block = Block(0, calibration_blocks(rig.machine, rig.file.campaign)[0].visits[:1])
            with pytest.raises(NoAnswer):
                runner.run(visits(runner.devices, block, "calibration", ("P1", "P2")), "short")
        assert len(silent) == 1
        # Its time-out, then a short question whether it is there; what it holds is not asked any more.
        assert time.monotonic() - silent[0] < 2.0 * GUARD_S + 5.0
        assert "settings_since_check" not in store.events("short", "failed")[0].data
        assert rig.drives.stop_reason is not None
        assert not any(drive.is_moving(rig.clock.now_s()) for drive in mock.drives)
        line = rig.file.station
        assert line.reply_timeout_s <= 5.0 < line.motion_timeout_s
    store.close()
