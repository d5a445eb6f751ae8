"""Section of the rig file that says who calibrates what for whom."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from calibration.base.toml_file import Label, Section


def _check_email(text: str) -> str:
    name, _, host = text.partition("@")
    if not name or "." not in host or any(c.isspace() for c in text) or len(text) > 200:
        raise ValueError("an address of e-mail has the form name@host.example")
    return text


Email = Annotated[str, AfterValidator(_check_email)]


class PartyEntry(Section):
    """A person or an organisation, with its address."""

    name: Label = Field(description="Name.")
    email: Email | None = Field(default=None, description="Address of e-mail.")
    street: Label | None = Field(default=None, description="Street and number.")
    postcode: Label | None = Field(default=None, description="Postal code.")
    city: Label | None = Field(default=None, description="City.")
    country: str | None = Field(
        default=None, pattern="^[A-Z]{2}$", description="Country, two letters of ISO 3166-1, as in `DE`."
    )


class CalibratedItem(Section):
    """The machine that is calibrated, as its plate names it."""

    manufacturer: Label | None = Field(default=None, description="Make.")
    model: Label | None = Field(default=None, description="Model.")
    serial: Label | None = Field(default=None, description="Serial number.")
    place: Label | None = Field(default=None, description="Where it stands: hall, cell.")


class CertificateSection(Section):
    """Who calibrates what and for whom; certificates of what is measured with stand in `[[certificates]]`."""

    laboratory: PartyEntry | None = Field(default=None, description="Who calibrates.")
    customer: PartyEntry | None = Field(default=None, description="For whom.")
    machine: CalibratedItem = Field(default=CalibratedItem(), description="The machine.")
    operator: Label | None = Field(default=None, description="Who is responsible for the result.")
    procedure: Label | None = Field(default=None, description="Number or name of the calibration procedure.")
    location: Literal["laboratory", "customer"] = Field(
        default="customer", description="Where it is calibrated: in the laboratory, or where the customer has it."
    )
    prefix: str = Field(
        default="PKM",
        pattern="^[A-Za-z0-9][A-Za-z0-9.-]{0,19}$",
        description="What numbers of certificates begin with.",
    )
    accreditation: Label | None = Field(
        default=None,
        description="Body and number of an accreditation that covers this procedure; without it certificates say that "
        "they are not accredited.",
    )
    language: Literal["en", "de"] = Field(default="en", description="Language of headings, verdict and fields.")
