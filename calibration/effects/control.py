"""What the controls leave: crosstalk between axes, latency of the station, settling after a motion."""

from __future__ import annotations

import numpy as np

from calibration.effects.base import Effect, Forms, Parameter, Setting, ladder, varied
from calibration.gap.shapes import products, smooth
from calibration.machine import Array

REFERENCE_SPEED_M_PER_S = 0.5
REST_S = ladder(0.5, 16.0, 7)


def coupling(s: Setting, drive: int) -> Forms:
    """Where another axis stands, or how it came, moves this one."""
    f, travel, m = Forms(), f"travel.{s.drive(drive)}", s.moments
    mine = s.along(drive)
    for other in s.partners(drive):
        (middle, half), q = s.middle_m(other), m.drives[:, other]
        x = (q - middle) / half * 0.5
        straight = f.add((travel, x))
        curve = f.add((travel, smooth(q, 5)))
        crossed = f.add((travel, products(np.stack([x, 2.0 * x**2], axis=1), np.stack([mine, mine**2 - 0.4], axis=1))))
        come = f.add((travel, 0.25 * m.direction[:, other, None] * _speeds(s)))
        f.form(straight, curve, share=0.5)
        f.form(curve)
        f.form(crossed[:1], (*straight, *crossed[1:], *curve), share=0.3)
        f.form(come)
    return f


def latency(s: Setting, _: int) -> Forms:
    """All drives are seen at another moment: by v tau while they move, less and less after a stop."""
    f, m = Forms(), s.moments
    drives = range(len(s.machine.drive_names))
    speed = np.abs(m.velocity_m_per_s).max(axis=1)
    f.form(
        f.add(*((f"travel.{s.drive(a)}", m.velocity_m_per_s[:, a]) for a in drives)),
        f.add(*((f"travel.{s.drive(a)}", m.velocity_m_per_s[:, a] * speed / 0.25) for a in drives)),
        share=0.5,
    )
    for tau in ladder(0.15, 5.0, 7):
        late = np.exp(-m.dwell_s / tau)[:, None] * _speeds(s) * REFERENCE_SPEED_M_PER_S
        f.form(
            f.add(*((f"travel.{s.drive(a)}", -m.direction[:, a, None] * late) for a in drives)), tau_s=tau, weight=0.5
        )
    return f


def servo_settling(s: Setting, drive: int) -> Forms:
    """The slider comes to rest late, the later the faster it came."""
    f, travel, m = Forms(), f"travel.{s.drive(drive)}", s.moments
    behind = -m.direction[:, drive, None] * _speeds(s)
    rest = products(behind, smooth(np.log(m.dwell_s + 0.3), 6, constant=True))
    any_way = f.add((travel, rest))
    for tau in REST_S:
        t = m.dwell_s / tau
        decay = f.add((travel, behind * np.exp(-t)[:, None]))
        ringing = np.stack([np.exp(-0.5 * t) * np.cos(w * t) for w in (1.5, 2.5, 4.0)], axis=1)
        more = f.add((travel, products(behind, ringing)))
        f.form(decay, any_way, share=0.3, tau_s=tau)
        f.form(more, any_way, share=0.3, tau_s=tau, weight=0.5)
    return f


def _speeds(s: Setting) -> Array:
    """The approach's speed (n, 4) over the reference, and what a last leg too short to reach it makes of it."""
    v = s.moments.speed_m_per_s / REFERENCE_SPEED_M_PER_S
    moving = s.moments.moving.astype(np.float64)
    return np.stack([v, np.full(len(v), 0.3), moving * v, 0.3 * moving], axis=1)


def _same_dwell(s: Setting) -> str | None:
    at_rest = s.moments.dwell_s[~s.moments.moving]
    return None if varied(at_rest, 5.0) and varied(s.moments.direction, 1.0) else (
        "every pose was measured after the same rest; vary the dwell"
    )  # fmt: skip


def _nothing_moves(s: Setting) -> str | None:
    if bool(np.any(s.moments.moving)) or float(s.moments.dwell_s.min()) < 1.0:
        return None
    return "no reading was taken on the fly or soon after a stop"


def _one_axis(s: Setting) -> str | None:
    return None if len(s.machine.drive_names) > 1 else "the machine has one drive"


EFFECTS = (
    Effect(
        "axis_coupling", "drive", Parameter("ratio", 1e-6, 2e-3, "1", "metres a metre of the other axis"),
        "the other drive's coordinate, reflectors on the sliders", ("screw_cumulative_error",), coupling, (), _one_axis,
    ),
    Effect(
        "latency", "rig", Parameter("latency_s", 1e-5, 5.0, "s", "dead time or time constant"),
        "readings on the fly at several speeds, or short rests", ("servo_settling",), latency, (), _nothing_moves,
    ),
    Effect(
        "servo_settling", "drive", Parameter("amplitude_m", 1e-6, 4e-3, "m", "short on arrival at 0.5 m/s"),
        "varied dwell and speed, reflectors on the sliders", ("backlash", "latency"), servo_settling,
        (Parameter("tau_s", 0.3, 20.0, "s", "time constant"),), _same_dwell,
    ),
)  # fmt: skip
