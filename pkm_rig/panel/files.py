"""Files that the page shows, by a campaign of the store and a name that is known: no path ever comes from a page."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

from calibration.base.errors import InputError
from calibration.base.plain_file import read_text
from calibration.machine.description import Machine
from pkm_rig.jobs.diagnose import PICTURES_FOLDER
from pkm_rig.panel.actions import Visits, read_visits
from pkm_rig.store.place import campaign_folder, has_store, store_folder
from pkm_rig.store.store import open_existing_store

REPORT = "report.html"
PICTURES = ("error-map", "coordinates", "time-line", "spectrum")
MOST_NEXT_FILES = 20


def report_of(out: Path, campaign: str) -> Path | None:
    """The report of a campaign of the store; None if there is no such campaign, or no report of it."""
    return _file(out, campaign, REPORT)


def report_url(campaign: str) -> str:
    """Where the page asks for it."""
    return f"/campaign/{quote(campaign, safe='')}/report"


def picture_url(campaign: str, name: str) -> str:
    """Where the page asks for a picture."""
    return f"/campaign/{quote(campaign, safe='')}/picture/{quote(name, safe='')}"


def picture_of(out: Path, campaign: str, name: str) -> Path | None:
    """A picture of the campaign's diagnosis, by its name."""
    return _file(out, campaign, PICTURES_FOLDER, f"{name}.png") if name in PICTURES else None


def pictures_of(out: Path, campaign: str) -> list[str]:
    """Names of the pictures that there are."""
    return [name for name in PICTURES if picture_of(out, campaign, name) is not None]


def next_measurements(out: Path, campaign: str, machine: Machine) -> list[Visits]:
    """The campaign files that the diagnosis has written, the most informative first."""
    folder = campaign_folder(out, campaign) / PICTURES_FOLDER
    if not _is_stored(out, campaign) or not folder.is_dir():
        return []
    found = []
    for path in sorted(folder.glob("next-*.toml"))[:MOST_NEXT_FILES]:
        file = _file(out, campaign, PICTURES_FOLDER, path.name)
        if file is not None:
            found.append(read_visits(path.stem, read_text(file).encode(), machine))
    return found


def _is_stored(out: Path, campaign: str) -> bool:
    if not has_store(out):
        return False
    try:
        with open_existing_store(out) as store:
            store.header(campaign)
    except InputError:
        return False
    return True


def _file(out: Path, campaign: str, *parts: str) -> Path | None:
    """A plain file below the store's folder; nothing that leads elsewhere, whatever a campaign is called."""
    if not _is_stored(out, campaign):
        return None
    root = store_folder(out).resolve()
    path = campaign_folder(out, campaign).joinpath(*parts)
    resolved = path.resolve()
    inside = resolved.is_relative_to(root) and len(resolved.relative_to(root).parts) == 1 + len(parts)
    return resolved if inside and resolved.is_file() else None
