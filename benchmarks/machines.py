"""All shipped machines beside one another: what each command does with them, by the checks that the commands make.

No device is touched. `yes` means that the rig file of the machine's demo passes the check that the command makes before
it touches any device; anything else is its message. With --twins a campaign of each machine's plant
is diagnosed as well, its twin made, and served.

    python -m benchmarks.machines [--twins]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.base.errors import InputError
from calibration.machine.description import shipped_machine, shipped_machines
from mock_devices.effects import SPECS, EffectError
from mock_devices.effects.in_space import IN_SPACE
from mock_devices.plant.any_plant import parse_effect
from mock_devices.plant.base_plant import Motion, SetPoint
from pkm_rig.jobs.diagnose import run_diagnosis
from pkm_rig.jobs.dry_run import dry_run
from pkm_rig.rig.capabilities import Need, require_capabilities, uses_tables
from pkm_rig.rig.clock import VirtualClock
from pkm_rig.rig.config import RigFile, demo_rig_path, load_rig
from pkm_rig.rig.device_sections import MOVING_HOMING_METHODS
from pkm_rig.rig.expected_error import expected_error
from pkm_rig.rig.led_motion import is_led
from pkm_rig.rig.rig_checks import predicted_floor, undecidable
from pkm_rig.virtual.mock_rig import TwinFiles, settings_of, twin_plant
from tests.pkm_rig.plant_recording import record as planar_record
from tests.pkm_rig.spatial_recording import record

COARSE_RANGE_M = 1e-4


@dataclass
class Standing:
    """A drive that stands."""

    at: float

    def encoder_m(self, t_s: float) -> float:
        """Where it stands."""
        del t_s
        return self.at

    def set_point(self, t_s: float) -> SetPoint:
        """Where it stands."""
        del t_s
        return SetPoint(0, 0)

    def is_moving(self, t_s: float) -> bool:
        """Never."""
        del t_s
        return False

    def motions_after(self, t_s: float) -> list[Motion]:
        """None."""
        del t_s
        return []


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
    """The rig with an effect and disturbances in its mock."""
    assert file.mock is not None
    nuisance = file.mock.nuisance.model_copy(update={"reversal_m": 1e-6})
    update = {"effects": ("backlash=1e-5",), "nuisance": nuisance}
    return file.model_copy(update={"mock": file.mock.model_copy(update=update)})


def homing_of(file: RigFile) -> str:
    """How the drives are homed: by moving to the next index, or where they stand."""
    methods = {drive.homing.method for drive in file.drives if drive.homing is not None}
    return ("by moving" if methods & set(MOVING_HOMING_METHODS) else "standing") if methods else "none"


def effects_of(path: Path) -> str:
    """How many effects, of the catalogue and outside it, the mock has for a machine, at their typical size."""
    found = 0
    for name in SPECS:
        try:
            parse_effect(f"{name}={SPECS[name].size.typical!r}", path)
        except EffectError:
            try:  # another variant than the first
                parse_effect(f"{name}={SPECS[name].size.typical!r},variant={IN_SPACE[name][0]}", path)
            except (EffectError, KeyError, IndexError):
                continue
        found += 1
    return f"{found} of {len(SPECS)}"


def twin_of(name: str) -> dict[str, str]:
    """Whether a campaign of the plant can be diagnosed, its twin be made, and served in place of the mock's machine."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)

        def add() -> None:
            recording = planar_record(5) if name == "planar4" else record(name, 5, poses=12)
            run_diagnosis(recording, folder, add=True)

        def serve() -> None:
            path = demo_rig_path(name)
            (twin,) = folder.glob("*/twin")
            plant = twin_plant(load_rig(path)[0], path, TwinFiles(twin), VirtualClock())
            drives = tuple(Standing(part.home) for part in plant.parts)
            plant.attach(drives)
            places = np.array([sighting.polar.distance_m for sighting in plant.sightings(10.0)])
            if not np.all(np.isfinite(places)):
                raise InputError("the twin has no place for a reflector")

        return {"diagnose --add": tried(add), "mock --twin": tried(serve)}


def main() -> int:
    """Print the table, then what does not work and why."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--twins", action="store_true", help="also diagnose --add and mock --twin, for minutes")
    twins = parser.parse_args().twins
    commands = ("mock", "check", "home", "measure", "calibrate, verify", "health", "mock --effect")
    commands += ("diagnose --add", "mock --twin") if twins else ()
    print("um, of machines that command rotations /urad; floor: predicted noise of a visit")
    names = (
        "drives",
        "coord.",
        "motion",
        "homing",
        "correction",
        "visits",
        "expected",
        "floor",
        "at 0.1 mm",
        "decidable",
    )
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
            homing_of(file),
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
            "home": tried(lambda: preflight(Need.HOMING)),
            "health": tried(lambda: preflight(Need.MOTION)),
            "mock --effect": tried(lambda f=file, p=path: settings_of(with_effect(f), p) and None),  # type: ignore[misc]
        }
        if twins:
            answers[name] |= twin_of(name)
    print("\n" + " ".join([f"{'':10}", *(f"{command:>17}" for command in commands), f"{'effects':>10}"]))
    for name, row in answers.items():
        cells = [f"{'yes' if row[c] == 'yes' else 'no':>17}" for c in commands]
        print(" ".join([f"{name:10}", *cells, f"{effects_of(shipped_machine(name)):>10}"]))
    print()
    for name, row in answers.items():
        for command, answer in row.items():
            if answer != "yes":
                print(f"{name}, {command}: {answer}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
