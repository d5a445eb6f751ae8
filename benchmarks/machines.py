"""All shipped machines beside one another: what each command does with them, by the checks that the commands make.

No device is touched. `yes` means that the rig file of the machine's demo passes the check that the command makes before
it touches any device; anything else is its message.

    python -m benchmarks.machines
"""

from __future__ import annotations

import sys
from collections.abc import Callable

from calibration.base.errors import InputError
from calibration.machine.description import shipped_machines
from pkm_rig.jobs.dry_run import dry_run
from pkm_rig.rig.capabilities import Need, require_capabilities, uses_tables
from pkm_rig.rig.config import RigFile, demo_rig_path, load_rig
from pkm_rig.rig.expected_error import expected_error
from pkm_rig.rig.led_motion import is_led
from pkm_rig.rig.rig_checks import predicted_floor, undecidable
from pkm_rig.virtual.mock_rig import settings_of

COARSE_RANGE_M = 1e-4


def tried(act: Callable[[], object]) -> str:
    """Whether something passes, else what is said."""
    try:
        found = act()
    except InputError as error:
        return str(error)
    return "yes" if not found else "; ".join(map(str, found)) if isinstance(found, list) else "yes"


def with_range(file: RigFile, range_sd_m: float) -> RigFile:
    """The rig with another accuracy of the station's range."""
    accuracy = file.station.accuracy.model_copy(update={"range_sd_m": range_sd_m})
    return file.model_copy(update={"station": file.station.model_copy(update={"accuracy": accuracy})})


def with_effect(file: RigFile) -> RigFile:
    """The rig with an effect in its mock."""
    assert file.mock is not None
    return file.model_copy(update={"mock": file.mock.model_copy(update={"effects": ("backlash=1e-5",)})})


def main() -> int:
    """Print the table, then what does not work and why."""
    commands = ("mock", "check", "measure", "calibrate, verify", "mock --effect, --twin")
    print("um, of machines that command rotations /urad; floor: predicted noise of a visit")
    names = ("drives", "coord.", "motion", "correction", "visits", "expected", "floor", "at 0.1 mm", "decidable")
    print(f"{'':10}" + "".join(f"{name:>13}" for name in names))
    answers: dict[str, dict[str, str]] = {}
    for name in shipped_machines():
        path = demo_rig_path(name)
        file, machine = load_rig(path)
        error, floor = expected_error(machine), predicted_floor(file, machine)
        coarse = predicted_floor(with_range(file, COARSE_RANGE_M), machine)
        rotations = [
            f"/{e.rotation_rad * 1e6:.0f}" if (machine.commanded > 2).any() else "" for e in (error, floor, coarse)
        ]
        row = (
            len(machine.drive_names),
            len(machine.commanded),
            "led" if is_led(machine, file.campaign) else "profile",
            "drive tables" if uses_tables(file, machine) else "host",
            len(dry_run(file, machine).visits),
            *(f"{e.position_m * 1e6:.1f}{turn}" for e, turn in zip((error, floor, coarse), rotations, strict=True)),
            "no" if undecidable(with_range(file, COARSE_RANGE_M), machine) else "yes",
        )
        print(f"{name:10}" + "".join(f"{cell:>13}" for cell in row))

        def preflight(needs: Need, name: str = name) -> None:
            path = demo_rig_path(name)
            require_capabilities(*load_rig(path), path, needs)

        answers[name] = {
            "mock": tried(lambda f=file, p=path: settings_of(f, p) and None),  # type: ignore[misc]
            "check": tried(lambda f=file, m=machine: undecidable(f, m)),  # type: ignore[misc]
            "measure": tried(lambda: preflight(Need.MOTION)),
            "calibrate, verify": tried(lambda: preflight(Need.MOTION | Need.TABLES)),
            "mock --effect, --twin": tried(lambda f=file, p=path: settings_of(with_effect(f), p) and None),  # type: ignore[misc]
        }
    print("\n" + " ".join([f"{'':10}", *(f"{command:>22}" for command in commands)]))
    for name, row in answers.items():
        print(" ".join([f"{name:10}", *(f"{'yes' if row[c] == 'yes' else 'no':>22}" for c in commands)]))
    print()
    for name, row in answers.items():
        for command, answer in row.items():
            if answer != "yes":
                print(f"{name}, {command}: {answer}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
