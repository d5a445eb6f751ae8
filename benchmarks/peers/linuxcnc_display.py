#!/usr/bin/python3
"""What stands for the operator's screen of a running LinuxCNC: it homes, commands blocks and notes where motors are.

Run by LinuxCNC itself with the system's Python, in the folder of the configuration: blocks and pins are in job.json.
What was found goes into found.json: after each block, when nothing moves any more, where all joints are commanded and
where their motors; and the values of the pins.
"""

import json
import time
import traceback
from pathlib import Path

import hal
import linuxcnc

WAIT_S, STEP_S = 30.0, 0.01
STILL = 30  # looks at the motors, STEP_S apart, within which they may not move
STILL_MM = 1e-10  # a compensation settles by shares of what is left


def main() -> None:
    """Do the job; whatever goes wrong is in the file, since nobody sees this program's output."""
    job = json.loads(Path("job.json").read_text(encoding="utf-8"))
    try:
        found = run(job)
    except Exception:
        found = {"error": traceback.format_exc()}
    Path("found.json").write_text(json.dumps(found), encoding="utf-8")


def run(job: dict) -> dict:
    """Home, then all blocks in turn."""
    command, status = linuxcnc.command(), linuxcnc.stat()
    own = hal.component("looks-only")  # pins can be read while it is there
    own.ready()

    def wait(what: str, reached) -> None:
        until = time.monotonic() + WAIT_S
        status.poll()
        while not reached():
            if time.monotonic() > until:
                raise TimeoutError(what)
            time.sleep(STEP_S)
            status.poll()

    command.state(linuxcnc.STATE_ESTOP_RESET)
    command.wait_complete()
    command.state(linuxcnc.STATE_ON)
    wait("power on", lambda: status.task_state == linuxcnc.STATE_ON)
    command.home(-1)
    wait("homed", lambda: all(status.homed[: job["joints"]]))
    command.mode(linuxcnc.MODE_MDI)
    command.wait_complete()
    rests = [_after_block(command, status, block, wait, job["joints"]) for block in job["blocks"]]
    return {
        "joints": [joints for joints, _ in rests],
        "motors": [motors for _, motors in rests],
        "pins": {pin: hal.get_value(pin) for pin in job["pins"]},
    }


def _after_block(command, status, block: str, wait, joints: int) -> tuple:
    command.mdi(block)
    command.wait_complete(WAIT_S)
    wait(block, lambda: status.inpos and status.interp_state == linuxcnc.INTERP_IDLE)
    looks: list = []

    def still() -> bool:
        looks.append([_motor(k) for k in range(joints)])
        last = looks[-STILL:]
        return len(last) == STILL and all(max(of) - min(of) <= STILL_MM for of in zip(*last, strict=True))

    wait(f"{block}: motors at rest", still)
    return [hal.get_value(f"joint.{k}.pos-cmd") for k in range(joints)], looks[-1]


def _motor(joint: int) -> float:
    """Where a motor is commanded, in the joint's coordinate: homing without a switch has set it to zero."""
    return hal.get_value(f"joint.{joint}.motor-pos-cmd") - hal.get_value(f"joint.{joint}.motor-offset")


if __name__ == "__main__":
    main()
