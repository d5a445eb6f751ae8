"""How the uncertainty of the parameters falls with the readings, as a small picture of numbers only."""

from __future__ import annotations

from collections.abc import Sequence

WIDE, HIGH, LEFT, LOW = 320, 140, 44, 24


def trend_svg(readings: Sequence[int], shares: Sequence[float]) -> str:
    """A line of the shares of the tolerance that are left over the number of readings, as SVG; empty without any."""
    if not readings:
        return ""
    most = max(readings)
    top = max(1.0, *shares) if len(shares) > 1 else max(1.0, shares[0])

    def place(count: float, share: float) -> str:
        x = LEFT + (WIDE - LEFT - 8) * count / most
        y = 8 + (HIGH - LOW - 8) * (1.0 - share / top)
        return f"{x:.1f},{y:.1f}"

    points = " ".join(place(n, s) for n, s in zip([0, *readings], [1.0, *shares], strict=True))
    dots = "".join(
        f'<circle cx="{at.split(",")[0]}" cy="{at.split(",")[1]}" r="2.5" fill="#2a6f97"/>'
        for at in (place(n, s) for n, s in zip(readings, shares, strict=True))
    )
    base, end = place(0, 0).split(","), place(most, 0).split(",")
    return (
        f'<svg viewBox="0 0 {WIDE} {HIGH}" role="img" aria-label="share of the tolerance that is left" '
        f'style="width:100%;max-width:30rem" font-size="10" font-family="system-ui, sans-serif" fill="#4a5666">'
        f'<path d="M{base[0]},8 L{base[0]},{base[1]} L{end[0]},{end[1]}" fill="none" stroke="#c9d1dc"/>'
        f'<polyline points="{points}" fill="none" stroke="#2a6f97" stroke-width="1.8"/>{dots}'
        f'<text x="{LEFT - 5}" y="12" text-anchor="end">{top * 100:.0f} %</text>'
        f'<text x="{LEFT - 5}" y="{base[1]}" text-anchor="end">0 %</text>'
        f'<text x="{WIDE - 8}" y="{HIGH - 8}" text-anchor="end">after {most} readings: {shares[-1] * 100:.0f} %</text>'
        "</svg>"
    )
