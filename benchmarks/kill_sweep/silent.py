"""A device that falls silent, and a host that stands still: how soon the drives stand, and how the host ends.

In real time, with one long slow motion under way: how long it takes is what is measured.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from benchmarks.kill_sweep.processes import RIG, HostProcess, MockProcess, wait_until
from pkm_rig.rig.config import load_rig
from pkm_rig.virtual.new_rig import with_values

CASES = ("silent-plc", "silent-can", "silent-station", "silent-host")
DEVICE = 3
WATCHDOG_S = 1.5
STATUS_S = 15.0
STATION_MORE_S = 5.0
PATIENCE_S = 120.0
_SLOW = {
    ("", "time_scale"): "1.0",
    ("campaign", "speeds_m_per_s"): "[0.02, 0.02]",
    ("campaign", "warm_up_step_s"): "1.0",
    ("plc", "reply_timeout_s"): "0.5",
}


def run_case(case: str, folder: Path) -> list[dict[str, Any]]:
    """One case: its times and what is wrong with them."""
    template = folder / "template.toml"
    template.write_text(with_values(RIG.read_text(encoding="utf-8"), _SLOW), encoding="utf-8")
    mock = MockProcess(folder, template)
    host = HostProcess(["measure", "--rig", str(mock.rig), "--out", str(folder / "runs")], folder)
    try:
        limits = load_rig(mock.rig)[0]
        moving = _measuring(folder) if case == "silent-station" else lambda: _moves(mock)
        if not wait_until(moving, host.process, 0.05):
            return [_result(case, {}, [f"nothing moved before the host ended: {host.wait().last_line}"])]
        time.sleep(0.5)  # a motion is well under way
        began_s = time.monotonic()
        if case == "silent-host":
            host.stop()
            stop_limit_s = WATCHDOG_S
        else:
            mock.tell(f"silent {case.removeprefix('silent-')}")
            stop_limit_s = limits.limits.plc_heartbeat_s
        stood_s = _time_to_stand(mock, began_s)
        found = {"drives stood after s": round(stood_s, 2)}
        wrong = [] if case == "silent-station" or stood_s <= stop_limit_s else [
            f"the drives stood after {stood_s:.2f} s, limit {stop_limit_s:g} s"
        ]  # fmt: skip
        if case == "silent-host":
            host.process.kill()
            host.wait()
            return [_result(case, found, wrong)]
        ended = host.wait(PATIENCE_S)
        took_s = time.monotonic() - began_s
        status_limit_s = STATUS_S
        if case == "silent-station":
            station = limits.station
            status_limit_s = max(station.reply_timeout_s, station.motion_timeout_s) + STATION_MORE_S
        found["status after s"] = round(took_s, 2)
        if ended.status != DEVICE or took_s > status_limit_s:
            wrong.append(f"status {ended.status} after {took_s:.1f} s, limit {status_limit_s:g} s: {ended.last_line}")
        reachable = case != "silent-can"  # over a cut cable the power can only be left to the PLC
        if reachable and any(drive["powered"] for drive in mock.status()["drives"].values()):
            wrong.append("a drive has power after the host has ended")
        return [_result(case, found, wrong)]
    finally:
        host.process.kill()
        host.process.wait()
        mock.close()


def _moves(mock: MockProcess) -> bool:
    return any(drive["moving"] for drive in mock.status()["drives"].values())


def _measuring(folder: Path) -> Any:
    from benchmarks.kill_sweep.processes import StoreView  # noqa: PLC0415

    view = StoreView(folder / "runs")
    return lambda: view.count() > 0


def _time_to_stand(mock: MockProcess, began_s: float) -> float:
    """Seconds until no drive moves; polled every 10 ms."""
    while _moves(mock):
        time.sleep(0.01)
        if time.monotonic() - began_s > PATIENCE_S:
            break
    return time.monotonic() - began_s


def _result(case: str, found: dict[str, float], wrong: list[str]) -> dict[str, Any]:
    said = ", ".join(f"{name} {value:g}" for name, value in found.items())
    return {"chain": case, "struck": f"{case}: {said}", "problems": wrong}
