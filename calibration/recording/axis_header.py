"""axis.toml: whose axis was recorded, and in what units (docs/reference/axis-recording.md)."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from calibration.base.toml_file import Section
from calibration.recording.header import Name

Kind = Literal["rotary", "linear"]
PositionUnit = Literal["deg", "mdeg", "rad", "mrad", "urad", "m", "mm", "um"]
TorqueUnit = Literal["Nm", "kNm", "mNm", "N", "kN"]
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
DEGREE = 0.017453292519943295  # rad
ROTARY = {"deg": DEGREE, "mdeg": 1e-3 * DEGREE, "rad": 1.0, "mrad": 1e-3, "urad": 1e-6}
LINEAR = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
TORQUES = {"Nm": 1.0, "kNm": 1e3, "mNm": 1e-3}
FORCES = {"N": 1.0, "kN": 1e3}


class AxisFile(Section):
    """axis.toml."""

    format: Literal[1]
    name: Name = Field(description="Name of the recording.")
    source: Annotated[str, Field(max_length=1000)] = Field(default="", description="Free text, one line.")
    simulated: bool = Field(default=False, description="True if a program made it: every result says so.")
    kind: Kind = Field(description='"rotary" or "linear".')
    time_unit: Literal["s", "ms", "us"] = Field(description="Unit of the times.")
    position_unit: PositionUnit = Field(description="Unit of all positions, which are those of the load's side.")
    torque_unit: TorqueUnit | None = Field(default=None, description="Unit of the torque or force.")
    torque_side: Literal["motor", "load"] | None = Field(
        default=None, description="Side on which the torque or force is stated; with a torque it must be given."
    )
    ratio: float | None = Field(
        default=None,
        ge=1e-6,
        le=1e6,
        description="Torque (or force) on the load's side over that on the motor's, losses aside: of use only with "
        '`torque_side = "motor"`. Left out: not known, and a compliance counts per unit of the motor\'s torque.',
    )
    second_scale_u: float = Field(
        default=1e-3,
        ge=0.0,
        le=0.1,
        description="Standard uncertainty of the second position's scale against the motor's; its offset is not known.",
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.position_unit not in (ROTARY if self.kind == "rotary" else LINEAR):
            raise ValueError(f"a {self.kind} axis has no positions in {self.position_unit}")
        if (self.torque_unit is None) != (self.torque_side is None):
            raise ValueError("torque_unit and torque_side belong together; give both or none")
        loads = TORQUES if self.kind == "rotary" else FORCES
        of_spindle = self.kind == "linear" and self.torque_side == "motor"  # whose motor has a torque
        if self.torque_unit is not None and self.torque_unit not in loads and not of_spindle:
            raise ValueError(f"a {self.kind} axis has no load in {self.torque_unit}")
        return self

    @property
    def unit(self) -> str:
        """SI unit of positions: rad or m."""
        return "rad" if self.kind == "rotary" else "m"

    @property
    def load_unit(self) -> str:
        """SI unit of the torque or force as it is used: on the load's side, where the ratio is known."""
        if self.kind == "rotary" or (self.torque_unit in TORQUES and self.ratio is None):
            return "Nm"
        return "N"
