"""What the machine carries."""

from __future__ import annotations

from pydantic import Field

from calibration.base.toml_file import Section


class PayloadEntry(Section):
    """A payload of the rig: mass and centre of mass in the platform frame with standard uncertainties."""

    name: str
    mass_kg: float = Field(ge=0.0, le=1.0e6)
    u_mass_kg: float = Field(ge=0.0, default=0.0)
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    u_com_m: float = Field(ge=0.0, default=0.0)
