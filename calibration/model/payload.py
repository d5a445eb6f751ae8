"""What the machine carries."""

from __future__ import annotations

from pydantic import Field

from calibration.base.toml_file import Label, Section


class PayloadEntry(Section):
    """A payload of the rig; its number is its place in the list, 0 is no payload."""

    name: Label = Field(description="Name.")
    mass_kg: float = Field(ge=0.0, le=1.0e6, description="Mass.")
    u_mass_kg: float = Field(ge=0.0, default=0.0, description="Standard uncertainty of the mass.")
    com_m: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="Centre of mass in the platform frame."
    )
    u_com_m: float = Field(ge=0.0, default=0.0, description="Standard uncertainty of each of its coordinates.")
