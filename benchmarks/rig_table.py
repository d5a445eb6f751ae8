"""What many rigs of one machine show: error over bound, coverage, estimators side by side."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.rig_settings import CASES, WITHIN_95, CalibrationCase, Study
from benchmarks.rig_truth import Array

RATIO = (0.95, 1.05)
COVERED = (0.93, 0.97)
COVERED_EACH = (0.90, 0.99)
RESAMPLES = 2000

Rows = list[dict[str, Any]]


def pooled(values: Array) -> Array:
    """Root mean square over rigs (r, k) of figures that are RMS themselves."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def figures(rows: Rows, case: CalibrationCase, kg: float, name: str) -> Array:
    """Position (um) and orientation (urad) of every rig (r, 2): an estimator's, 'bound' or 'linear'; NaN: it failed."""
    used = [row["cases"][case.name]["used"][f"{kg:g}"] for row in rows]
    none = [np.nan, np.nan]
    return np.array([u[name] if name in ("bound", "linear") else u["error"].get(name, none) for u in used])


def ratio(error: Array, bound: Array) -> tuple[Array, Array]:
    """Pooled error over pooled bound (2,), and its standard error by resampling the rigs."""
    rng = np.random.default_rng(1)
    picks = rng.integers(0, len(error), (RESAMPLES, len(error)))
    again = np.sqrt(np.mean(error[picks] ** 2, axis=1) / np.mean(bound[picks] ** 2, axis=1))
    return pooled(error) / pooled(bound), np.std(again, axis=0)


def within(value: float, limits: tuple[float, float]) -> bool:
    """Limits included; round-off is not a reason to fail."""
    return limits[0] - 1e-12 <= value <= limits[1] + 1e-12


def summarise(study: Study, rows: Rows) -> tuple[list[str], bool]:
    """The lines of one machine, and whether every criterion holds."""
    lines = [
        f"{study.machine}: {len(rows)} rigs; {study.poses} poses a payload, {study.sigma_m * 1e6:g} um, "
        f"{study.sigma_rad * 1e6:g} urad; {study.held_out} held-out poses a payload",
        "",
        f"      {'held-out error / bound (MAP)':36s}{'position':>16s}{'orientation':>16s}   "
        "um / urad; over the linear estimate's",
    ]
    verdicts = []

    def say(good: bool | None, text: str) -> None:
        lines.append(f"{'----' if good is None else 'ok  ' if good else 'MISS'}  {text}")
        verdicts.append(good is not False)

    for case in CASES:
        for kg in case.used_kg:
            error, bound = figures(rows, case, kg, "map"), figures(rows, case, kg, "bound")
            value, spread = ratio(error, bound)
            good = all(within(v, RATIO) for v in value) if kg in case.judged_kg else None
            name = f"{case.name}; at {kg:g} kg"
            cells = "".join(f"{v:8.3f} +- {s:.3f}" for v, s in zip(value, spread, strict=True))
            (e, turn), (b, b_turn) = pooled(error), pooled(bound)
            same, _ = ratio(error, figures(rows, case, kg, "linear"))
            sizes = f"{e:.2f} / {turn:.1f}, bound {b:.2f} / {b_turn:.1f}; {same[0]:.3f}, {same[1]:.3f}"
            say(good, f"{name:36s} {cells}   {sizes}")
    lines += ["", "      coverage of 95 % intervals (MAP)"]
    for case in CASES:
        _coverage(study, rows, case, say)
    lines.append("")
    _draws(rows, say)
    apart = max(u["model_apart_nm"] for row in rows for c in row["cases"].values() for u in c["used"].values())
    say(apart < 1.0, f"independent truth and our model, same errors: at most {apart:.1e} nm (nrad) apart")
    lines += ["", *_table(rows, "RMS over all rigs", pooled), "", *_table(rows, "median rig", _median)]
    return lines, all(verdicts)


def _coverage(study: Study, rows: Rows, case: CalibrationCase, say: Any) -> None:
    outcomes = [row["cases"][case.name] for row in rows]
    for kg in case.used_kg:
        hits = np.array([o["used"][f"{kg:g}"]["covered"] for o in outcomes]) / study.held_out
        share, spread = float(np.mean(hits)), float(np.std(np.mean(hits, axis=1)) / np.sqrt(len(rows)))
        good = within(share, COVERED) if kg in case.judged_kg else None
        say(good, f"{case.name}; poses at {kg:g} kg: {100 * share:.1f} +- {100 * spread:.1f} %")
    names = list(outcomes[0]["z"])
    inside = np.abs(np.array([[o["z"][n] for n in names] for o in outcomes])) < WITHIN_95
    share, spread = float(np.mean(inside)), float(np.std(np.mean(inside, axis=1)) / np.sqrt(len(rows)))
    say(within(share, COVERED), f"{case.name}; all {len(names)} parameters: {100 * share:.1f} +- {100 * spread:.1f} %")
    each = np.mean(inside, axis=0)
    low, high = int(np.argmin(each)), int(np.argmax(each))
    span = f"{100 * each[low]:.1f} % ({names[low]}) to {100 * each[high]:.1f} % ({names[high]})"
    say(all(within(float(v), COVERED_EACH) for v in each), f"{case.name}; each parameter: {span}")
    chi2 = np.array([o["chi2_per_dof"] for o in outcomes])
    say(None, f"{case.name}; chi2/dof: mean {np.mean(chi2):.3f} +- {np.std(chi2) / np.sqrt(len(chi2)):.3f}")


def _draws(rows: Rows, say: Any) -> None:
    """The priors are the draw by construction (refused otherwise); here is what was drawn."""
    draws = np.array([list(row["draw"].values()) for row in rows])
    size, expected = float(np.sqrt(np.mean(draws**2))), 1.0 / np.sqrt(2.0 * draws.size)
    say(
        abs(size - 1.0) < 4.0 * expected,
        f"RMS of the drawn errors in prior standard deviations: {size:.4f} +- {expected:.4f}; "
        f"single ones {np.sqrt(np.mean(draws**2, axis=0)).min():.2f} to {np.sqrt(np.mean(draws**2, axis=0)).max():.2f}",
    )


def _median(values: Array) -> Array:
    return np.asarray(np.median(values, axis=0))


def _table(rows: Rows, title: str, reduce: Any) -> list[str]:
    """Estimators and rigid baselines: position / orientation of all compared cases."""
    columns = [(case, kg) for case in CASES if case.compared for kg in case.used_kg]
    names: dict[str, None] = {}
    for case in (c for c in CASES if c.compared):
        for row in rows:
            used, failed = row["cases"][case.name]["used"], row["cases"][case.name]["failed"]
            names |= dict.fromkeys([*(n for u in used.values() for n in u["error"]), *failed])
    groups = [(case, len(case.used_kg)) for case in CASES if case.compared]
    lines = [
        f"{title}, um / urad",
        f"{'calibrated at':36s}" + "".join(f"{case.name:>{16 * n}s}" for case, n in groups),
        f"{'used at':36s}" + "".join(f"{f'{kg:g} kg':>16s}" for _, kg in columns),
    ]
    for name in [
        *(n for n in names if not n.endswith("_per_payload")),
        *(n for n in names if n.endswith("_per_payload")),
        "bound",
    ]:
        cells = ""
        for case, kg in columns:
            values = figures(rows, case, kg, name)
            fine = np.all(np.isfinite(values), axis=1)
            if not np.any(fine):
                missing = any(name in row["cases"][case.name]["failed"] for row in rows)
                cells += f"{'failed' if missing else '-':>16s}"
                continue
            position, turn = reduce(values[fine])
            lost = f" ({np.sum(~fine)} lost)" if not np.all(fine) else ""
            cells += f"{f'{position:.2f} / {turn:.1f}{lost}':>16s}"
        lines.append(f"{name:36s}{cells}")
    return lines
