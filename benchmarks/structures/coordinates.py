"""What a structure may depend on: coordinates of the readings of a campaign, and how a part remembers them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mock_devices.plant.thermal import SENSORS
from mock_devices.recordings.maker import SimulatedCampaign

Array = NDArray[np.float64]

SCREW_M, GRATING_M = (0.004, 0.04), (2e-5, 2e-3)  # periods of a screw's turn, of a grating
LAG_S = {"place": (60.0, 600.0), "partner": (60.0, 600.0)}
LAG_ELSE_S = (300.0, 2400.0)  # of temperatures and loads
PLAY = (0.15, 0.6)  # half width of the play over half the range of the coordinate


@dataclass(frozen=True)
class Readings:
    """What is known of the r readings of a campaign: nothing of it is noisy but the recorded torque.

    q_m, side, velocity_m_per_s, torque_ratio: (r, d). visit: number of the last arrival. sight_m: height of the
    measured point in the station's frame. part_c: true temperatures, `air` among them.
    """

    t_s: Array
    visit: NDArray[np.intp]
    q_m: Array
    side: Array
    velocity_m_per_s: Array
    torque_ratio: Array
    payload_kg: Array
    speed_m_per_s: Array
    dwell_s: Array
    sight_m: Array
    part_c: dict[str, Array]

    @classmethod
    def of(cls, campaign: SimulatedCampaign) -> Readings:
        """The readings of a campaign on the plain machine."""
        line, columns = campaign.timeline, campaign.record().columns
        names = [slider.name for slider in campaign.nominal.sliders]

        def drives(quantity: str) -> Array:
            return np.stack([columns[f"{name}_{quantity}"] for name in names], axis=1)

        thermal = campaign.thermal
        part_c = {name: thermal.part_series_c(name, line.t_s) for name in SENSORS}
        return cls(
            t_s=line.t_s,
            visit=np.maximum(line.visit, 0),
            q_m=line.q_m,
            side=drives("direction"),
            velocity_m_per_s=line.velocity_m_per_s,
            torque_ratio=drives("torque_ratio"),
            payload_kg=columns["payload_mass_kg"],
            speed_m_per_s=columns["speed_m_per_s"],
            # Between visits, when nests are measured, drives rest for minutes: as if for the longest rest at a pose.
            dwell_s=np.minimum(columns["dwell_s"], columns["dwell_s"][~line.is_nest].max()),
            sight_m=campaign.points_m([])[:, 2],
            part_c=part_c | {"air": thermal.air_series_c(line.t_s)},
        )

    def coordinate(self, name: str, own: int, part: str) -> Array:
        """A coordinate (r,) as drive `own` has it; part: whose temperature. Phases are taken later."""
        partner = (own + 1) % self.q_m.shape[1]
        if name == "way":
            return self.at_visits(np.abs(np.diff(self.of_visits(self.q_m[:, own]), prepend=self.q_m[0, own])))
        plain: dict[str, Array] = {
            "place": self.q_m[:, own],
            "partner": self.q_m[:, partner],
            "turn": self.q_m[:, own],
            "grating": self.q_m[:, own],
            "side": self.side[:, own],
            "velocity": np.abs(self.velocity_m_per_s[:, own]),
            "torque": self.torque_ratio[:, own],
            "time": self.t_s,
            "temperature": self.part_c[part],
            "air": self.part_c["air"],
            "load": self.payload_kg,
            "speed": self.speed_m_per_s,
            "dwell": self.dwell_s,
            "sight": self.sight_m,
        }
        return plain[name]

    def of_visits(self, x: Array) -> Array:
        """A coordinate (r,) as it was at the first reading of each visit (v,)."""
        _, first = np.unique(self.visit, return_index=True)
        return x[first]

    def at_visits(self, x: Array) -> Array:
        """What belongs to visits (v,) at the readings of each (r,)."""
        return x[np.unique(self.visit, return_inverse=True)[1]]


def lagging(t_s: Array, x: Array, tau_s: float) -> Array:
    """What follows a coordinate (r,) with a time constant; it begins where the coordinate does."""
    out = np.empty_like(x)
    out[0] = x[0]
    keep = np.exp(-np.diff(t_s) / tau_s)
    for i in range(1, len(x)):
        out[i] = x[i] + (out[i - 1] - x[i]) * keep[i - 1]
    return out


def within_play(x: Array, half_width: float) -> Array:
    """Where a coordinate (v,) stands in its play: what it drags along follows at a distance of the half width."""
    out, dragged = np.empty_like(x), x[0]
    for k, now in enumerate(x):
        dragged = min(max(dragged, now - half_width), now + half_width)
        out[k] = now - dragged
    return out
