"""What the software costs a campaign: host time of programs and transports over the rig time of the campaign.

In virtual time nobody waits for the machine, so all the host time that a campaign takes is overhead: CPU and waiting
for threads, sockets and the disk; the mock devices' own work is in it. `--real-time` runs 20 poses at time scale 1 as
well and says how much longer they take than their rig time in virtual time.
`python -m benchmarks.overhead [--poses N] [--real-time]`; exit status 1 above the limit.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from pkm_rig.jobs.session import pin_to_one_core
from pkm_rig.rig.campaign_sections import CampaignSettings
from pkm_rig.rig.config import RigFile, embedded_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.plans import visits
from pkm_rig.rig.runner import describe_campaign, open_runner
from pkm_rig.rig.schedule import Block, calibration_blocks
from pkm_rig.store.append import now_text
from pkm_rig.store.store import Store
from pkm_rig.virtual.mock_rig import embedded_mock_rig

LIMIT = 0.02
SHORT_POSES = 20


@dataclass(frozen=True)
class Cost:
    """Of one run: poses, readings, rig time, host time and CPU time in seconds."""

    poses: int
    readings: int
    rig_s: float
    host_s: float
    cpu_s: float


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=240)
    parser.add_argument("--real-time", action="store_true")
    options = parser.parse_args()
    cost = campaign(options.poses, real_time=False)
    share = cost.host_s / cost.rig_s
    print(
        f"{cost.poses} poses, {cost.readings} readings, virtual time: {cost.rig_s / 60.0:.1f} min of rig time in"
        f" {cost.host_s:.1f} s of host time ({cost.cpu_s:.1f} s CPU, {cost.host_s - cost.cpu_s:.1f} s waiting):"
        f" {share:.2%}"
    )
    good = share <= LIMIT
    if options.real_time:
        virtual, real = campaign(SHORT_POSES, real_time=False), campaign(SHORT_POSES, real_time=True)
        longer = real.host_s / virtual.rig_s - 1.0
        print(
            f"{real.poses} poses at time scale 1: {real.host_s:.1f} s for {virtual.rig_s:.1f} s of rig time"
            f" ({longer:+.2%}), {real.cpu_s:.1f} s CPU ({real.cpu_s / real.host_s:.1%} of a core, 100 Hz polling and"
            " the mock devices included)"
        )
        good = good and longer <= LIMIT
    print(f"{'within' if good else 'ABOVE'} {LIMIT:.0%}")
    return 0 if good else 1


def campaign(poses: int, *, real_time: bool) -> Cost:
    """Measure so many poses of the default campaign's kind, connection and warm-up aside."""
    path = embedded_rig_path()
    file, machine = load_rig(path)
    with (
        tempfile.TemporaryDirectory() as folder,
        nullcontext() if real_time else pin_to_one_core(os.getpid()),
        embedded_mock_rig(file, path, real_time=real_time) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory) as rig,
    ):
        store = Store(Path(folder) / "store.sqlite")
        store.add_campaign(describe_campaign(rig, "overhead", now_text()), rig.machine.text)
        with open_runner(rig, store, "overhead", lambda _n, _what: None) as runner:
            rig.enable()
            rig.compensate(None)
            rig.refresh_atmosphere()
            smrs = runner.devices.smrs("platform", "slider")
            rig_s, host_s, cpu_s = rig.clock.now_s(), time.monotonic(), time.process_time()
            runner.run(visits(runner.devices, plan(file, poses, machine), "calibration", smrs), "overhead")
            elapsed_s = (rig.clock.now_s() - rig_s, time.monotonic() - host_s, time.process_time() - cpu_s)
        readings = len(store.recording("overhead"))
        store.close()
    return Cost(poses, readings, *elapsed_s)


def plan(file: RigFile, poses: int, machine: object) -> Block:
    """So many visits without payload, from the campaign's own schedule."""
    settings: CampaignSettings = file.campaign.model_copy(update={"calibration_poses": max(poses, 6)})
    first = calibration_blocks(machine, settings)[0].visits[:poses]  # type: ignore[arg-type]
    return Block(0, tuple(replace(visit, payload=0) for visit in first))


if __name__ == "__main__":
    raise SystemExit(main())
