"""How long a stop takes: from an interlock's bit, or one drive's fault, to the last drive's stop frame.

The mock rig runs in a process of its own at time scale 1, over socketcand, Modbus TCP and a pseudo terminal; this
process moves the drives back and forth, asks the station and reads the table banks by SDO all the while. All times are
taken in the mock's process. `python -m benchmarks.stop_latency [--trips N] [--seed S]`; exit status 1 above the limit.
"""

from __future__ import annotations

import argparse
import json
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from drivers.drives.cia402 import QUICK_STOP
from drivers.errors import DeviceError, DriveFault
from pkm_rig.rig.clock import ScaledClock
from pkm_rig.rig.config import load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.rig import Rig
from pkm_rig.virtual.mock_rig import MockRig
from pkm_rig.virtual.served_rig import serve_mock_rig

LIMIT_MS = 20.0
EXAMPLE = Path(__file__).parents[1] / "examples" / "mock-rig.toml"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trips", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve is not None:
        serve(options.serve, options.seed)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        path = rig_file(Path(folder))
        latencies = list(measure(path, options.trips, options.seed))
    total, polling = np.array([(row["total_ms"], row["polling_ms"]) for row in latencies if "total_ms" in row]).T
    faults = np.array([row["fault_ms"] for row in latencies if "fault_ms" in row])
    print(f"{len(total)} trips under load, times in ms           median    95 %    99 %     max")
    for name, values in (
        ("bit to last stop frame", total),
        ("of it until the poll", polling),
        ("the rest", total - polling),
        (f"one drive's fault to the other's stop ({len(faults)})", faults),
    ):
        figures = (*np.percentile(values, (50, 95, 99)), values.max())
        print(f"{name:44}" + "".join(f"{figure:8.2f}" for figure in figures))
    print(f"polling's share of the mean: {polling.mean() / total.mean():.0%}")
    good = float(np.percentile(total, 99)) <= LIMIT_MS
    print(f"99th percentile {'within' if good else 'ABOVE'} {LIMIT_MS:g} ms")
    return 0 if good else 1


def rig_file(folder: Path) -> Path:
    """The example rig at time scale 1 on free ports."""
    with ExitStack() as stack:
        probes = [stack.enter_context(socket.socket()) for _ in range(2)]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        can_port, plc_port = (str(probe.getsockname()[1]) for probe in probes)
    text = EXAMPLE.read_text(encoding="utf-8").replace("time_scale = 40.0", "time_scale = 1.0")
    text = text.replace("29536", can_port).replace("15020", plc_port)
    path = folder / "rig.toml"
    path.write_text(text.replace("/tmp/pkm-rig-station", str(folder / "station")), encoding="utf-8")
    return path


def serve(path: Path, seed: int) -> None:
    """The mock's process: for each line on stdin open the guard at some time, say when it was polled and obeyed."""
    file, _ = load_rig(path)
    random = np.random.default_rng(seed)
    with serve_mock_rig(file, path) as mock:
        stops: dict[int, float] = {}
        stopped = threading.Event()
        opened_s = [float("inf")]
        for drive in mock.drives:
            control = drive.axis.control

            def watched(word: int, drive=drive, control=control) -> None:  # type: ignore[no-untyped-def]
                if word == QUICK_STOP and time.monotonic() >= opened_s[0]:
                    stops.setdefault(drive.node_id, time.monotonic())
                    if len(stops) == len(mock.drives):
                        stopped.set()
                control(word)

            drive.axis.control = watched  # type: ignore[method-assign]
            drive._objects._writers[0x6040, 0] = watched
        before, polls = watch_polls(mock, opened_s)
        print("ready", flush=True)
        for order in sys.stdin:
            stops.clear()
            polls.clear()
            stopped.clear()
            before.clear()
            time.sleep(float(random.uniform(0.05, 0.15)))
            opened_s[0] = time.monotonic()
            between_ms = (1e3 * np.diff(before)).tolist()
            if order.strip() == "fault":
                mock.drives[0].inject_fault()
            else:
                mock.plc.set_interlock(0, False)
            if not stopped.wait(10.0):
                opened_s[0] = float("inf")
                mock.plc.set_interlock(0, True)
                moving = any(drive.is_moving(mock.plant.clock.now_s()) for drive in mock.drives)
                print(json.dumps({"error": "the drives were not stopped", "moving": moving}), flush=True)
                continue
            if order.strip() == "fault":
                other_ms = 1e3 * (stops[mock.drives[1].node_id] - opened_s[0])
                opened_s[0] = float("inf")
                print(json.dumps({"fault_ms": other_ms, "between_polls_ms": between_ms}), flush=True)
                continue
            total_ms = 1e3 * (max(stops.values()) - opened_s[0])
            polling_ms = min(1e3 * (polls[0] - opened_s[0]), total_ms)
            opened_s[0] = float("inf")
            mock.plc.set_interlock(0, True)
            found = {"total_ms": total_ms, "polling_ms": polling_ms, "between_polls_ms": between_ms}
            print(json.dumps(found), flush=True)


def watch_polls(mock: MockRig, opened_s: list[float]) -> tuple[list[float], list[float]]:
    """Times of polls of the PLC: of those before the guard is opened, and of those that find it open."""
    answer = mock.plc.state.answer
    before: list[float] = []
    polls: list[float] = []

    def polled() -> list[int]:
        words = answer()
        now_s = time.monotonic()
        if now_s < opened_s[0]:
            before.append(now_s)
        elif not words[1] & 1:
            polls.append(now_s)
        return words

    mock.plc.state.answer = polled  # type: ignore[method-assign]
    return before, polls


def measure(path: Path, trips: int, seed: int) -> Iterator[dict[str, Any]]:
    """Trip supervision again and again while the rig works, then fault a drive."""
    with at_work(path, seed) as (_rig, strike):
        for number in range(trips + trips // 4):
            yield strike("trip" if number < trips else "fault")


@contextmanager
def at_work(path: Path, seed: int) -> Iterator[tuple[Rig, Callable[[str], dict[str, Any]]]]:
    """A rig at work, and what strikes it: `trip` opens the guard, `fault` faults a drive; it gives the times,
    none where the drives stood already.
    """
    file, machine = load_rig(path)
    command = [sys.executable, "-m", "benchmarks.stop_latency", "--serve", str(path), "--seed", str(seed)]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "start_new_session": True}
    with subprocess.Popen(command, text=True, **pipes) as mock:  # Ctrl-C ends it by the end of its input
        assert mock.stdin is not None
        assert mock.stdout is not None
        mock.stdout.readline()
        clock = ScaledClock(1.0)
        with connect_rig(file, machine, clock, rig_path=path) as rig, working(rig):

            def strike(order: str) -> dict[str, Any]:
                start_again(rig)
                mover = threading.Thread(target=move, args=(rig,))
                mover.start()
                until_moving(rig)
                assert mock.stdin is not None
                assert mock.stdout is not None
                mock.stdin.write(f"{order}\n")
                mock.stdin.flush()
                message: dict[str, Any] = json.loads(mock.stdout.readline())
                mover.join()
                if "error" not in message:
                    return message
                if message["moving"]:
                    raise SystemExit(message["error"])
                said = f"{rig.supervisor.trip or rig.drives.stop_reason or 'between two motions'}"
                print(
                    f"at rest when it was struck: {said}", file=sys.stderr
                )  # as on a computer that has no time for it
                return {}

            yield rig, strike
        mock.stdin.close()
        clock.close()


def until_moving(rig: Rig) -> None:
    """Wait until a drive moves, at most some seconds: what stands is not stopped."""
    end_s = time.monotonic() + 5.0
    while time.monotonic() < end_s:
        with suppress(DeviceError):
            if any(abs(sample.velocity_m_per_s) > 0.01 for sample in rig.drives.sample()):
                return
        time.sleep(0.002)


def start_again(rig: Rig) -> None:
    """What an operator does after a trip."""
    rig.supervisor.stop()
    rig.drives.clear_stop()
    rig.supervisor = rig.new_supervisor()
    rig.supervisor.start()
    end_s = time.monotonic() + 5.0
    while True:  # a fault can be reset only when the drive's reaction to it has ended
        try:
            rig.drives.fault_reset()
            rig.enable()
            return
        except DriveFault:
            if time.monotonic() > end_s:
                raise
            time.sleep(0.05)


def move(rig: Rig) -> None:
    """Back and forth until stopped."""
    with suppress(DeviceError):
        for turn in range(1000):
            rig.move(np.array([1.10, 1.10]) + (0.03 if turn % 2 else -0.03), 0.2)


@contextmanager
def working(rig: Rig) -> Iterator[None]:
    """The load of a campaign and more: the station measures, tables are read by SDO, without a pause."""
    ended = threading.Event()

    def measure() -> None:
        while not ended.is_set():
            with suppress(DeviceError):
                rig.station.read_angles()

    def read_tables() -> None:
        while not ended.is_set():
            for bank in rig.banks:
                with suppress(DeviceError):
                    bank.state()

    threads = [threading.Thread(target=work, daemon=True) for work in (measure, read_tables)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        for thread in threads:
            thread.join(timeout=5.0)


if __name__ == "__main__":
    raise SystemExit(main())
