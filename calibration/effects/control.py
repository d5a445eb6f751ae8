"""What the controls leave: crosstalk between axes, latency of the station, settling after a motion."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import Effect, Forms, Parameter, Setting, ladder, varied
from calibration.effects.basis_functions import products, smooth

REFERENCE_SPEED_M_PER_S = 0.5
REST_S = ladder(0.5, 16.0, 7)
CAPS_M_PER_S = (10.0, 0.3, 0.2, 0.15, 0.125)


def coupling(s: Setting, drive: int) -> Forms:
    """Where another axis stands, or how it came, moves this one."""
    f, travel, m = Forms(), f"travel.{s.drive(drive)}", s.moments
    mine = s.along(drive)
    for other in s.partners(drive):
        (middle, half), q = s.middle_m(other), m.drives[:, other]
        x, u = q - middle, s.along(other)
        straight = f.add((travel, x))
        curve = f.add((travel, half * smooth(q, 5)))
        crossed = f.add((travel, half * products(np.stack([u, u**2], axis=1), np.stack([mine, mine**2 - 0.4], axis=1))))
        f.form(straight, curve[1:], share=0.5)
        f.form(curve)
        f.form(crossed[:1], (*straight, *crossed[1:], *curve), share=0.3)
        pushed = f.add((travel, 0.25 * m.direction[:, other]))
        for speed in _speeds(s):
            f.form(f.add((travel, 0.25 * m.direction[:, other] * speed)), pushed, share=0.3, weight=0.5)
    return f


def latency(s: Setting, _: int) -> Forms:
    """All drives are seen at another moment: by v tau while they move, less and less after a stop."""
    f, m = Forms(), s.moments
    drives = range(len(s.machine.drive_names))

    def every(shape: Array) -> list[int]:
        return f.add(*((f"travel.{s.drive(a)}", shape[:, a]) for a in drives))

    speed = np.abs(m.velocity_m_per_s).max(axis=1, keepdims=True)
    f.form(every(m.velocity_m_per_s), every(m.velocity_m_per_s * speed / 0.25), share=0.5)
    for reached in _speeds(s)[::2]:
        for tau in ladder(0.15, 5.0, 6):
            late = np.exp(-m.dwell_s / tau) * reached * REFERENCE_SPEED_M_PER_S
            f.form(every(-m.direction * late[:, None]), tau_s=tau, weight=0.2)
    return f


def servo_settling(s: Setting, drive: int) -> Forms:
    """The slider comes to rest late, the later the faster it came."""
    f, travel, m = Forms(), f"travel.{s.drive(drive)}", s.moments
    rest = smooth(np.log(m.dwell_s + 0.3), 6, constant=True)
    for speed in _speeds(s):
        behind = -m.direction[:, drive] * speed
        any_way = f.add((travel, behind[:, None] * rest))
        for tau in REST_S:
            f.form(f.add((travel, behind * np.exp(-m.dwell_s / tau))), any_way, share=0.4, tau_s=tau)
        for tau in REST_S[1::2]:
            t = m.dwell_s / tau
            ringing = np.stack([np.exp(-0.5 * t) * np.cos(w * t) for w in (1.5, 2.5, 4.0)], axis=1)
            f.form(f.add((travel, behind[:, None] * ringing)), any_way, share=0.4, tau_s=tau, weight=0.5)
    return f


def _speeds(s: Setting) -> list[Array]:
    """The last leg's speed (n,) over the reference: a leg too short does not reach the approach's, so it is capped."""
    m = s.moments
    caps = [np.where(m.moving, m.speed_m_per_s, np.minimum(m.speed_m_per_s, cap)) for cap in CAPS_M_PER_S]
    return [capped / REFERENCE_SPEED_M_PER_S for capped in caps]


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
