"""Memory: what a part does late that follows a recorded quantity with a time constant."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array

LAG_GRID = 400  # points in time at which what follows a smooth quantity is integrated


def lag_behind(t_s: Array, values: Array, tau_s: float) -> Array:
    """What follows smooth values (n,) at times (n,), minus these; zero at the start."""
    order = np.argsort(t_s, kind="stable")
    t, in_time = t_s[order], values[order]
    grid = np.linspace(t[0], t[-1], LAG_GRID)
    on_grid = np.interp(grid, t, in_time)
    decay = float(np.exp(-(grid[1] - grid[0]) / tau_s))
    lag, lag_on_grid = 0.0, np.empty(len(grid))
    for i, change in enumerate(np.diff(on_grid, prepend=on_grid[0]).tolist()):
        lag = (lag - change) * decay
        lag_on_grid[i] = lag
    return np.asarray(np.interp(t_s, grid, lag_on_grid))


def following(t_s: Array, values: Array, tau_s: float) -> Array:
    """What follows values (n,) at times (n,) that change in steps; it begins where they do."""
    order = np.argsort(t_s, kind="stable")
    out = np.empty(len(values))
    late, in_time = float(values[order[0]]), []
    decays = np.exp(-np.diff(t_s[order], prepend=t_s[order[0]]) / tau_s)
    for now, decay in zip(values[order].tolist(), decays.tolist(), strict=True):
        late = now + (late - now) * decay
        in_time.append(late)
    out[order] = in_time
    return out


def fading(t_s: Array, added: Array, tau_s: float) -> Array:
    """Sum (k,) of what is added at ascending times (k,), which dies away from then on."""
    out = np.empty(len(t_s))
    total, before_s = 0.0, t_s[0]
    for i, (now_s, more) in enumerate(zip(t_s.tolist(), added.tolist(), strict=True)):
        total = total * np.exp(-max(now_s - before_s, 0.0) / tau_s) + more
        out[i], before_s = total, now_s
    return out
