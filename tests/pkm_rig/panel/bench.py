"""A panel's work on an embedded mock rig with a campaign of a few poses, whose mock a test may meddle with."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager

from pkm_rig.panel.actions import Action
from pkm_rig.panel.work import Work
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.rig.device_sections import RegisterEntry
from pkm_rig.rig.release import missing_to_move
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file

REGISTERS = {"acknowledge": RegisterEntry(address=19), "local_release": RegisterEntry(address=20)}
FEW_POSES = {"calibration_poses": 6, "nest_every_visits": 4}
LIMIT_S = 120.0  # host time; a busy computer is no fault


class Bench:
    """`at` runs what a test wants to happen when the campaign has so many readings, in the campaign's own thread."""

    def __init__(self, out, *, registers=REGISTERS, released=True, **campaign):
        self.clock_s = 0.0
        self.registers, self.released = registers, released
        self.campaign = {**FEW_POSES, **campaign}
        self.mock = self.rig = None
        self.at = {}
        self.connections = 0
        self.powered = []
        self.work = Work(embedded_rig_path(), out, self.connect, host_s=lambda: time.monotonic() + self.clock_s)
        self.work.file, _ = self.file()
        self.payload_is_on = threading.Event()
        self._progress, self.work.live.progress = self.work.live.progress, self.progress

    def file(self):
        file, machine = short_rig_file(seed=4, **self.campaign)
        return file.model_copy(update={"plc": file.plc.model_copy(update={"registers": self.registers})}), machine

    @contextmanager
    def connect(self, _path, *, needs=None, homing=False, after=None):
        file, machine = self.file()
        with mock_and_rig(file, machine, start_s=after.t_rig_s if after else 0.0) as (self.mock, self.rig):
            self.connections += 1
            self.mock.plc.state.set_release(self.released)
            asks = self.work.live.asks

            def asked(request):
                asks(request)
                if request is not None and request.text == "the payload is on":
                    self.payload_is_on.set()

            self.work.live.asks = asked
            yield self.rig

    def progress(self, count, total, phase):
        self._progress(count, total, phase)
        happens = self.at.pop(self.work.live.snapshot().done, None)
        if happens is not None:
            happens()

    def press_twice(self, action, page="a"):
        prepared = self.work.press(page, action)
        self.clock_s += 1.0
        self.work.press_again(page, prepared.secret)

    def end(self):
        assert self.work.wait(LIMIT_S)
        return self.work.job.result

    def go_on_whenever_asked(self, page="a"):
        """Lets the campaign go on each time that it waits, until it has ended."""
        while not self.work.wait(0.02):
            if self.work.operator.waits and not missing_to_move(self.rig, self.rig.supervisor.last_state):
                self.press_twice(Action("go on"), page)
        return self.work.job.result
