"""Candidates of a diagnosis as campaign files, which `pkm-rig measure --campaign` takes."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import ValidationError

from calibration.base.toml_text import to_toml
from calibration.diagnosis.result import CampaignAddition, ProposedVisit
from calibration.machine.description import COORDINATES, Machine
from calibration.model.payload import PayloadEntry
from pkm_rig.rig.campaign_sections import CampaignFile, VisitEntry, VisitsSection

DECIMALS = 9  # of a target: well below what a drive can resolve


def campaign_text(
    candidate: CampaignAddition, machine: Machine, payloads: tuple[PayloadEntry, ...], campaign: str
) -> str:
    """A candidate's visits as TOML, with what they are for as comments."""
    visits = tuple(_entry(visit, machine) for visit in candidate.visits)
    used = sorted({visit.payload for visit in candidate.visits})
    loads = "; ".join(f"{n}: {payloads[n].name}, {payloads[n].mass_kg:g} kg" for n in used if n < len(payloads))
    lines = [
        f"{candidate.name}: {candidate.adds}",
        f"tells apart: {', '.join(candidate.settles) or 'what is open'}; {candidate.gain_bit:.2f} bit expected "
        f"in {candidate.minutes:.0f} min",
        f"after campaign {campaign} of machine {machine.name}",
        f"target: {', '.join(COORDINATES[c] for c in machine.commanded)} of the tool, m and rad; "
        f"direction: {', '.join(machine.drive_names)}, +1 from below",
        f"payloads: {loads}",
        "",
        "pkm-rig measure --rig RIG.toml --campaign THIS-FILE                    as a campaign of its own",
        f"pkm-rig measure --rig RIG.toml --campaign THIS-FILE --resume {campaign}  added to that campaign,",
        "  as long as station and nests were not moved and it was not verified",
    ]
    head = "".join(f"# {_one_line(line)}\n" if line else "#\n" for line in lines)
    return head + to_toml(CampaignFile(campaign=VisitsSection(visits=visits)))


def standard_campaign_text(section: VisitsSection, machine: Machine) -> str:
    """The visits that the formulae of a standard need, as TOML, with how they are measured as comments."""
    lines = [
        f"{len(section.visits)} visits of machine {machine.name}, for the formulae of {section.made_for}",
        "pkm-rig measure --rig RIG.toml --campaign THIS-FILE     compensation is off meanwhile",
        "pkm-rig report CAMPAIGN                                  states their figures",
    ]
    return "".join(f"# {line}\n" for line in lines) + to_toml(CampaignFile(campaign=section))


def write_campaign_files(
    candidates: list[CampaignAddition],
    machine: Machine,
    payloads: tuple[PayloadEntry, ...],
    campaign: str,
    folder: Path,
) -> dict[str, str | None]:
    """As `write_candidates`, for `pkm-rig measure --campaign`; None also for those that no such file may hold."""
    refused = _unwritable(candidates, machine)
    written = [replace(c, visits=()) if c.name in refused else c for c in candidates]
    return write_candidates(
        written, folder, "toml", lambda candidate: campaign_text(candidate, machine, payloads, campaign)
    )


def remarks_on_unwritable(candidates: Sequence[CampaignAddition], machine: Machine) -> tuple[str, ...]:
    """Why candidates have no campaign file, a line each."""
    return tuple(f"no campaign file for '{name}': {why}" for name, why in _unwritable(candidates, machine).items())


def _unwritable(candidates: Sequence[CampaignAddition], machine: Machine) -> dict[str, str]:
    """Candidates whose visits are none that a rig may be asked for, name to why. The diagnosis is good without them."""
    out = {}
    for candidate in candidates:
        try:
            for visit in candidate.visits:
                _entry(visit, machine)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(str(part) for part in first["loc"])
            out[candidate.name] = _one_line(f"{key} = {str(first['input'])[:40]}: {first['msg']}")
    return out


def write_candidates(
    candidates: Sequence[CampaignAddition], folder: Path, ending: str, text: Callable[[CampaignAddition], str]
) -> dict[str, str | None]:
    """Write one file a candidate that has visits, in the order given; name to path, None without visits.

    Files of an earlier diagnosis in that folder go first, so that none is taken for one of this. Raises OSError.
    """
    for old in folder.glob(f"next-*.{ending}"):
        old.unlink()
    files: dict[str, str | None] = {}
    for number, candidate in enumerate(candidates, start=1):
        files[candidate.name] = None
        if candidate.visits:
            path = folder / f"next-{number}-{file_name(candidate.name)}.{ending}"
            path.write_text(text(candidate), encoding="utf-8")
            files[candidate.name] = str(path)
    return files


def _entry(visit: ProposedVisit, machine: Machine) -> VisitEntry:
    low, high = machine.commanded_limits.T
    target = [
        min(max(round(float(visit.target_m[c]), DECIMALS), float(a)), float(b))
        if a - 1e-6 < visit.target_m[c] < b + 1e-6  # round-off only: what lies outside is to be said, not moved
        else float(visit.target_m[c])
        for c, a, b in zip(machine.commanded, low, high, strict=True)
    ]
    return VisitEntry.model_validate(
        {
            "target": tuple(target),
            "direction": tuple(1 if side > 0 else -1 for side in visit.direction),
            "payload": visit.payload,
            "speed_m_per_s": float(visit.speed_m_per_s) or None,  # 0 in recordings that do not say it
            "dwell_s": float(visit.dwell_s),
        }
    )


def file_name(name: str) -> str:
    """A candidate's name as a part of a file's."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()[:60] or "candidate"


def _one_line(text: str) -> str:
    return re.sub(r"[\x00-\x1f\x7f]+", " ", text)
