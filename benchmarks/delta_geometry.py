"""What the parameters of a delta's kinematics can carry of its correction, each fitted to the correction itself.

Drawn machines, without noise: least squares over the corrected drive positions, so no other values of the same
parameters carry more. Beside the controls' own: towers that stand anywhere with arms of their own, and towers that lean
too, which no control has parameters for.

    python -m benchmarks.delta_geometry [--seeds 5]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from calibration.base.arrays import Array
from calibration.compensation.correction import Correction
from calibration.compensation.kinematics import linear_delta
from calibration.compensation.kinematics.catalogue import KINEMATICS
from calibration.compensation.kinematics.fit import Kinematics, KinematicsLoss, fit_parameters
from tests.calibration.compensation.drawn_machine import DrawnMachine

WIDTHS = np.array([1e-3] * 12 + [1e-4] * 3 + [1e-3] * 6)  # towers, arms, zeros in m; scales; leanings in rad
PLACED = 15
SETTLED = 4  # repetitions until a leaning tower's place and its carriage's height agree


def towers(values: Array, pose: Array) -> Array:
    """Drives (n, 3) by towers' places (3, 2), arms, zeros and scales (3,), and leanings (3, 2) where there are any."""
    places, lean = values[:6].reshape(3, 2), np.zeros((3, 2))
    arms, zeros, scales = values[6:9], values[9:12], values[12:15]
    if values.size > PLACED:
        lean = values[PLACED:].reshape(3, 2)
    drives = np.zeros((len(pose), 3))
    for _ in range(SETTLED):
        at = places + (scales * drives)[:, :, None] * lean
        across = np.sum((at - pose[:, None, :2]) ** 2, axis=2)
        drives = (pose[:, 2:3] + np.sqrt(arms**2 - across) - zeros) / scales
    return drives


def fits(correction: Correction) -> dict[str, Kinematics]:
    """The best parameters of each kind."""
    machine = correction.machine
    _, arm, zeros = linear_delta._nominal(machine)
    places = np.stack(linear_delta._towers(machine), axis=1).ravel()
    nominal = np.concatenate([places, [arm] * 3, zeros, machine.nominal.scale, np.zeros(6)])

    def best(count: int) -> Kinematics:
        return fit_parameters(towers, nominal[:count], WIDTHS[:count], machine, correction.fitted)

    makers: dict[str, Callable[[], Kinematics]] = {
        "lineardeltakins (8)": lambda: KINEMATICS["lineardeltakins"].build(correction, ()).kinematics,
        "klipper-delta (13)": lambda: KINEMATICS["klipper-delta"].build(correction, ()).kinematics,
        "towers anywhere (15)": lambda: best(PLACED),
        "leaning too (21)": lambda: best(nominal.size),
    }
    return {name: make() for name, make in makers.items()}


def main() -> None:
    """Print by machine and kind: share of the correction's RMS that is removed, and what is left in um."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    for seed in range(1, parser.parse_args().seeds + 1):
        drawn = DrawnMachine.of("delta6", seed)
        correction = Correction.sampled(drawn.machine, drawn.tool_error_free())
        parts = []
        for name, kinematics in fits(correction).items():
            loss = KinematicsLoss.of(kinematics, drawn.machine, correction.check)
            left_um = np.sqrt(np.mean(loss.rms_left**2)) * 1e6
            parts.append(f"{name} {1.0 - loss.remaining_share:.0%}, {left_um:.1f} um")
        print(f"delta6 {seed}: " + "; ".join(parts), flush=True)


if __name__ == "__main__":
    main()
