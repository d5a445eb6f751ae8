"""Sections of the rig file and of campaign files that say what a campaign measures and when it is refused."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from calibration.base.toml_file import Section
from calibration.compensation.grid import GRID_MARGIN_M
from calibration.recording.header import MOST_DWELL_S, MOST_SPEED_M_PER_S

Speed = Annotated[float, Field(gt=0.0, le=MOST_SPEED_M_PER_S)]
Dwell = Annotated[float, Field(ge=0.0, le=MOST_DWELL_S)]
Limit = Annotated[float, Field(gt=0.0)]
MadeFor = Literal["ISO 230-2 x", "ISO 230-2 y", "ISO 230-2 z", "ISO 9283"]
PayloadNumber = Annotated[int, Field(ge=0)]
MOST_VISITS, MOST_DRIVES = 2000, 12


class VisitEntry(Section):
    """One visit of a campaign that lists its visits one by one."""

    target: tuple[float, ...] = Field(
        min_length=1, max_length=6, description="Commanded coordinates of the tool, in m and rad."
    )
    direction: tuple[Literal[-1, 1], ...] = Field(
        default=(),
        max_length=MOST_DRIVES,
        description="Side that each drive comes from: 1 from below, -1 from above; left out, all from below.",
    )
    payload: PayloadNumber = Field(default=0, description="Number of the payload in `[[payloads]]`.")
    speed_m_per_s: Speed | None = Field(
        default=None, description="Speed of the approach; left out, the first of the campaign's."
    )
    dwell_s: Dwell | None = Field(
        default=None, description="Time between arrival and measurement; left out, the first of the campaign's."
    )


class CampaignSettings(Section):
    """What a campaign measures; durations are rig time."""

    seed: int = Field(ge=0, default=1, description="Seed of poses, order, speeds and dwells.")
    calibration_poses: int = Field(
        ge=6, default=40, description="Number of calibration poses, drawn in the workspace and denser at its edges."
    )
    targets: tuple[tuple[float, ...], ...] = Field(
        default=(),
        max_length=1000,
        description="Calibration poses in commanded coordinates, in place of drawn ones; their order is drawn; they "
        "are visited from both sides, with and without payload.",
    )
    visits: tuple[VisitEntry, ...] = Field(
        default=(), max_length=MOST_VISITS, description="Visits one by one, in this order, in place of poses."
    )
    made_for: MadeFor | None = Field(
        default=None,
        description="Standard whose formulae the visits were made for (`pkm-rig poses`); the report then states their "
        "figures.",
    )
    loaded_payload: int = Field(ge=1, default=2, description="Payload of the loaded block, by number.")
    readings_per_smr: int = Field(ge=1, le=20, default=1, description="Measurements averaged to a reading.")
    readings_per_nest: int = Field(ge=1, le=20, default=5, description="The same for floor nests.")
    two_face: bool = Field(default=False, description="Measure every point in both faces of the telescope.")
    speeds_m_per_s: tuple[Speed, Speed] = Field(
        default=(0.5, 0.25),
        description="Speeds of approach, drawn for each visit: of the drives, or on led paths of what is fastest, a "
        "platform joint, slider or leg.",
    )
    acceleration_m_per_s2: float = Field(gt=0.0, le=50.0, default=2.0, description="Acceleration of all motions.")
    approach_m: float = Field(
        gt=0.0, lt=GRID_MARGIN_M, default=0.010, description="Distance from which each drive makes its last approach."
    )
    dwells_s: tuple[Dwell, Dwell] = Field(
        default=(2.0, 4.0), description="Times between arrival and measurement, drawn for each visit."
    )
    warm_up_max_s: float = Field(
        ge=0.0, default=1800.0, description="Time after which a warm-up that has not settled has failed."
    )
    warm_up_step_s: float = Field(gt=0.0, default=60.0, description="Time between two looks at the temperatures.")
    warm_up_rate_k_per_h: float = Field(
        gt=0.0, default=2.0, description="Rate of change of the parts' temperatures below which measuring begins."
    )
    repeatability_visits: int = Field(ge=3, default=5, description="Visits of the repeatability test.")
    repeatability_limit_m: float = Field(
        gt=0.0, default=40e-6, description="Scatter of that test above which the campaign is refused."
    )
    nest_every_visits: int = Field(ge=1, default=5, description="Visits between two nest checks.")
    nest_limit_m: float = Field(
        gt=0.0, default=80e-6, description="Shift of a nest across the line of sight at which a nest check has failed."
    )
    verification_poses: int = Field(ge=30, default=40, description="Poses at which before and after are measured.")
    verification_payloads: tuple[PayloadNumber, ...] = Field(
        min_length=1, default=(0, 1), description="Payloads at which they are measured, by number."
    )
    accept_below_m: dict[PayloadNumber, Limit] = Field(
        default_factory=dict,
        description="Largest error after compensation with which tables are accepted, by the payload's number; left "
        "out, it need only fall.",
    )
    compensation: Literal["drive-tables", "host"] | None = Field(
        default=None,
        description="What corrects: tables in the drives, or this computer's own targets; left out, tables where the "
        "machine has two sliders, else this computer.",
    )
    motion: Literal["profile", "led"] | None = Field(
        default=None,
        description="How poses are reached: each drive by its own profile, or all led along paths by SYNC; left out, "
        "led where the machine has more drives than commanded coordinates or cranks.",
    )
    on_interlock: Literal["stop", "suspend"] = Field(
        default="stop",
        description="What an interlock that opens does to a campaign: `stop` ends it, `suspend` has it wait until it "
        "is acknowledged; the drives are stopped and without power either way.",
    )
    on_unseen: Literal["stop", "suspend"] = Field(
        default="stop",
        description="What a reflector that the station does not find, or gets no signal of, does to a campaign: `stop` "
        "ends it, `suspend` has it wait, the drives without power, until somebody has cleaned it and acknowledges; the "
        "visit is then measured anew.",
    )
    payload_timeout_s: float = Field(
        gt=0.0, default=3600.0, description="Longest wait for the PLC to report a payload that was asked for."
    )


class VisitsSection(Section):
    """The visits of a campaign file."""

    visits: tuple[VisitEntry, ...] = Field(
        min_length=1, max_length=MOST_VISITS, description="Visits, made in this order."
    )
    made_for: MadeFor | None = Field(
        default=None, description="Standard whose formulae they were made for (`pkm-rig poses --virtual-axis`)."
    )


class CampaignFile(Section):
    """A campaign file: the visits that a rig is to make, and nothing else of it."""

    campaign: VisitsSection = Field(description="The only section.")


class Limits(Section):
    """When the rig is refused or stopped, and how well the station must know the air.

    By the stations' own formula 0.1 ppm is 0.1 K or 0.4 hPa, 0.3 um over 3 m.
    """

    in_plane_u_m: float = Field(
        gt=0.0, default=15e-6, description="Predicted uncertainty of a tool position above which `check` complains."
    )
    moved_m: float = Field(
        gt=0.0,
        default=2e-6,
        description="Motion of a drive during a visit that ends the visit; it is measured anew once.",
    )
    heartbeat_s: float = Field(
        gt=0.0, default=2.0, description="Age of a drive's heartbeat that is late; at twice that age all stop."
    )
    drive_watchdog_s: float = Field(
        ge=1.0, le=60.0, default=1.5, description="Time without our heartbeat after which a drive stops by itself."
    )
    trial_timeout_s: float = Field(
        ge=5.0,
        le=3600.0,
        default=60.0,
        description="Time without our heartbeat after which a drive ends the use of a table that was not verified yet.",
    )
    poll_period_s: float = Field(
        ge=0.005, le=0.1, default=0.01, description="Period of polling the interlocks at time scale 1."
    )
    plc_heartbeat_s: float = Field(
        gt=0.0, default=2.0, description="Time that the PLC's heartbeat may stand still before all drives are stopped."
    )
    atmosphere_age_s: float = Field(
        gt=0.0, default=300.0, description="Age of the station's air at which it is set anew."
    )
    atmosphere_ppm: float = Field(
        gt=0.0, default=0.1, description="Change of the correction for air at which it is set anew."
    )
    interlocks: tuple[str, ...] = Field(
        default=("guard closed", "emergency stop released", "drive power on", "air pressure"),
        description="Interlocks that must be good before anything moves, by their names in `[plc]`.",
    )

    @model_validator(mode="after")
    def _stop_before_the_trial_ends(self) -> Limits:
        if self.trial_timeout_s <= self.drive_watchdog_s:
            raise ValueError("trial_timeout_s must be longer than drive_watchdog_s: a drive stops first")
        return self
