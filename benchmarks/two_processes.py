"""A campaign of two processes, mock and calibration, against the same one in one process: the same parameters.

The mock serves its station on a pseudo-terminal, its drives on socketcand and its PLC on Modbus TCP, in scaled host
time; the one-process run has the same protocols in virtual time. With drift and warmth the two see the machine at other
rig times: parameters agree within 0.3 of their uncertainty. With both switched off the readings know no time, and the
parameters have to be equal, bit for bit. Parts that are done are not run again, one that was stopped goes on with its
campaign.

    python -m benchmarks.two_processes [gough8] [--scale 1] [--poses 12] [--job measure] [--parts steady,drifting]

A machine that is led by SYNC needs every SYNC in time, and what the host is late counts SCALE times: scale 1, on free
cores. One that is not may go ten times as fast.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from calibration.base.errors import InputError
from calibration.identification.calibration import identify_recording
from mock_devices.lasting_state import RigState
from pkm_rig.rig.config import demo_rig_path, load_rig
from pkm_rig.store.store import open_existing_store
from pkm_rig.virtual.new_rig import with_values, write_new_rig
from tests.kept_results import until_stopped

PARTS = ("steady", "drifting")
MOST_OF_U = 0.3
READY_S = 120.0
SYNC_HOST_S, LONGEST_SYNC_S = 0.04, 0.1  # on a shared computer a process may pause for longer than 8 ms
NO_DRIFT = "1e-18"  # zero is refused; this is below what an angle resolves
DRIFTS = ("drift_rad_per_sqrt_h", "drift_of_level_rad_per_sqrt_h", "drift_m_per_sqrt_h")


class JobEnded(RuntimeError):
    """A process of the two ended before it was done; one line."""


def rig_files(machine: str, part: str, folder: Path, scale: float, poses: int | None) -> tuple[Path, Path]:
    """The rig file of the one process and that of the two, beside one another; those that are there are kept."""
    one, two = folder / "one.toml", folder / "two.toml"
    if not one.exists():
        folder.mkdir(parents=True, exist_ok=True)
        values: dict[tuple[str, str], str] = {}
        if part == "steady":
            values |= {("station.accuracy", name): NO_DRIFT for name in DRIFTS}
            values["mock", "steady_temperatures"] = "true"
        period_s = min(scale * SYNC_HOST_S, LONGEST_SYNC_S)
        if load_rig(demo_rig_path(machine))[0].can.sync_period_s < period_s:
            values["can", "sync_period_s"] = f"{period_s:g}"
        if poses is not None:
            values["campaign", "calibration_poses"] = str(poses)
        text = demo_rig_path(machine).read_text(encoding="utf-8")
        if poses is not None and "[campaign]" not in text:
            text += "\n[campaign]\n"
        one.write_text(with_values(text, values), encoding="utf-8")
    if not two.exists():
        scaled = folder / "scaled.toml"
        scaled.write_text(f"time_scale = {scale}\n" + one.read_text(encoding="utf-8"), encoding="utf-8")
        write_new_rig(scaled, two, anywhere=False)
    return one, two


@contextlib.contextmanager
def served(rig: Path) -> Iterator[None]:
    """A mock in a process of its own, until it has said how to connect; ended by its own id."""
    state = rig.with_suffix(".state")
    if not state.exists():  # without one a served mock is as old as Unix time, and has been warm for ever
        file = load_rig(rig)[0]
        new = RigState(machine=file.machine, seed=file.mock.seed if file.mock else 1, t_utc_s=time.time())
        state.write_text(new.model_dump_json(), encoding="utf-8")
    command = [sys.executable, "-m", "pkm_rig.cli", "mock", "--rig", str(rig), "--state", str(state)]
    with rig.with_suffix(".mock.log").open("a+", encoding="utf-8") as log:
        begin = log.tell()
        mock = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT)
        try:
            deadline = time.monotonic() + READY_S
            while "connect:" not in rig.with_suffix(".mock.log").read_text(encoding="utf-8")[begin:]:
                if mock.poll() is not None or time.monotonic() > deadline:
                    raise JobEnded(f"the mock did not start: see {log.name}")
                time.sleep(0.1)
            yield
        finally:
            mock.terminate()
            mock.wait(timeout=30.0)


def campaign_of(rig: Path, out: Path, job: str) -> tuple[str, float]:
    """`pkm-rig calibrate` or `measure`, or what is left of it; the campaign and the seconds that it took now."""
    former, measured = last_campaign(out), out / "measured"
    if former is not None and (measured.exists() or is_verified(out, former)):
        return former, 0.0
    resume = [] if former is None else ["--resume", former]
    begun_s = time.monotonic()
    command = [sys.executable, "-m", "pkm_rig.cli", job, "--rig", str(rig), "--out", str(out), *resume]
    done = subprocess.run(command, check=False, stdout=subprocess.PIPE, text=True)
    if done.returncode not in (0, 1):
        raise JobEnded(f"{job} ended with status {done.returncode}; the same command goes on")
    if job == "measure":
        measured.touch()  # taken up again it would measure its warm-up once more
    return last_campaign(out) or "", time.monotonic() - begun_s


def last_campaign(out: Path) -> str | None:
    """The campaign of a store, None without one."""
    if not (out / "pkm-rig.sqlite").exists():
        return None
    with open_existing_store(out) as store:
        campaigns = store.campaigns()
    return campaigns[-1].campaign if campaigns else None


def is_verified(out: Path, campaign: str) -> bool:
    """Whether a campaign has its verdict."""
    with open_existing_store(out) as store:
        return bool(store.events(campaign, "accepted") or store.events(campaign, "refused"))


def compare(one: Path, two: Path) -> dict[str, Any]:
    """Parameters of the two campaigns: how far apart, in their uncertainty, and whether all are equal."""
    fits = []
    for out in (one, two):
        with open_existing_store(out) as store:
            fits.append(identify_recording(store.recording(last_campaign(out) or ""), baselines=False).fit)
    names = fits[0].layout.names[: len(fits[0].theta)]
    apart = np.abs(fits[0].theta - fits[1].theta)
    share = apart / fits[0].theta_u
    worst = int(np.argmax(share))
    return {
        "parameters": len(names),
        "equal": int(np.count_nonzero(apart == 0.0)),
        "worst": names[worst],
        "worst_of_u": float(share[worst]),
        "median_of_u": float(np.median(share)),
    }


def run_part(machine: str, part: str, folder: Path, scale: float, poses: int | None, job: str) -> dict[str, Any]:
    """Both campaigns of a part, and their comparison."""
    one, two = rig_files(machine, part, folder, scale, poses)
    _, one_s = campaign_of(one, folder / "one", job)
    with served(two):
        _, two_s = campaign_of(two, folder / "two", job)
    time_scale = load_rig(two)[0].time_scale
    found = {"machine": machine, "part": part, "one_s": one_s, "two_s": two_s, "time_scale": time_scale}
    return found | compare(folder / "one", folder / "two")


def line_of(row: dict[str, Any]) -> tuple[str, bool]:
    """A part in one line, and whether its goal is reached."""
    equal = row["equal"] == row["parameters"]
    good = equal if row["part"] == "steady" else row["worst_of_u"] <= MOST_OF_U
    goal = "all equal" if row["part"] == "steady" else f"at most {MOST_OF_U:g} of their uncertainty"
    what = "no drift or warmth" if row["part"] == "steady" else "drifting"
    return (
        f"{'ok  ' if good else 'MISS'}  {row['machine']}, {what}: {row['equal']} of {row['parameters']} parameters "
        f"equal; farthest {row['worst_of_u']:.2g} of its u ({row['worst']}), median {row['median_of_u']:.2g}; goal: "
        f"{goal}; one process {row['one_s']:.0f} s, two {row['two_s']:.0f} s at time scale {row['time_scale']:g}"
    ), good


def main() -> int:
    """Run what is missing; exit status 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machine", nargs="?", default="gough8")
    parser.add_argument("--scale", type=float, default=1.0, help="rig seconds in a second of the two processes")
    parser.add_argument("--poses", type=int, help="calibration poses; for a first look")
    parser.add_argument(
        "--job", choices=("calibrate", "measure"), default="calibrate", help="measure: parameters alone"
    )
    parser.add_argument("--parts", default=",".join(PARTS))
    parser.add_argument("--out", type=Path, default=Path("runs/two-processes"))
    options = parser.parse_args()
    try:
        demo_rig_path(options.machine)
    except InputError as error:
        parser.error(str(error))
    if wrong := set(options.parts.split(",")) - set(PARTS):
        parser.error(f"--parts: no part {', '.join(sorted(wrong))}; there are {', '.join(PARTS)}")
    if not options.scale > 0.0:
        parser.error(f"--scale {options.scale:g}: give rig seconds in a second, above 0")
    reached = True
    for part in options.parts.split(","):
        folder = options.out / f"{options.machine}-{part}{'' if options.poses is None else f'-{options.poses}'}"
        folder = folder.with_name(f"{folder.name}-{options.job}")
        result = folder / "result.json"
        if not result.exists():
            try:
                row = run_part(options.machine, part, folder, options.scale, options.poses, options.job)
            except (InputError, JobEnded) as error:
                print(f"two_processes: {error}", file=sys.stderr)
                return 2
            result.write_text(json.dumps(row, indent=1), encoding="utf-8")
        line, good = line_of(json.loads(result.read_text(encoding="utf-8")))
        print(line, flush=True)
        reached = reached and good
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(until_stopped(main))
