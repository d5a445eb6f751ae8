"""Reports, PDF and certificates of five seeded campaigns: every number, every text box, every value read back.

    python -m benchmarks.papers [--out runs/papers] [--schemas DIR] [--only NAME ...]

Accepted, refused, resumed after an interrupt, a hexapod, and one with an effect; a campaign that is there already is
not measured again. Needs the extra [dev]; with `--schemas`, PTB's schema files, certificates of version 3.0.0 are
checked and read back by dcc-json-toolkit. Pages are drawn as PNG beside the reports, to be looked at.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any

from pkm_rig.certificate.page import quantities_of
from pkm_rig.certificate.xml_form import parse
from pkm_rig.rig.config import SHIPPED_RIGS, embedded_rig_path
from tests.pkm_rig.report.page_numbers import complaints

WHO = """
[certificate]
operator = "A. Example"
procedure = "example"
[certificate.machine]
manufacturer = "Example AG"
serial = "0042"
[certificate.customer]
name = "Customer"
email = "c@customer.example"
city = "Ulm"
[certificate.laboratory]
name = "Laboratory"
email = "l@laboratory.example"
city = "Ulm"
country = "DE"
"""
SHORT = "[campaign]\ncalibration_poses = 20\nverification_poses = 30\n\n[nuisance]"
CHANGES = {  # texts of the embedded rig file, old and new
    "accepted": (),
    "refused": (("seed = 1", "seed = 3\nerror_scale = 0.0"), ("[nuisance]", SHORT)),
    "resumed": (("seed = 1", "seed = 2"), ("[nuisance]", SHORT)),
    "hexapod": (),
    "effect": (("seed = 1", 'seed = 6\neffects = ["screw_periodic_error=8e-6,place=left"]'),),
}
SLACK_PT = 1.0  # by which boxes of text may touch


def main() -> None:
    """Print one line a campaign; status 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/papers"))
    parser.add_argument("--schemas", type=Path)
    parser.add_argument("--only", nargs="*", default=list(CHANGES))
    options = parser.parse_args()
    print("campaign   pages  numbers  wrong  overlapping  rules  schema 3.0.0  values read back", flush=True)
    wrong = 0
    for name in options.only:
        folder: Path = options.out / name
        rig = rig_of(name, folder)
        campaign = measured(name, folder, rig)
        found = papers_of(campaign, folder, rig, options.schemas)
        wrong += found["wrong"]
        line = (
            "{name:10} {pages:5}  {numbers:7}  {wrong_numbers:5}  {overlapping:11}  {rules:5}  {schema:12}  {read_back}"
        )
        print(line.format(name=name, **found), flush=True)
    sys.exit(1 if wrong else 0)


def rig_of(name: str, folder: Path) -> Path:
    """The rig file of a campaign."""
    folder.mkdir(parents=True, exist_ok=True)
    source = SHIPPED_RIGS / "demo-stewart6.toml" if name == "hexapod" else embedded_rig_path()
    text = source.read_text(encoding="utf-8")
    for old, new in CHANGES[name]:
        text = text.replace(old, new, 1)
    path = folder / "rig.toml"
    path.write_text(text + WHO, encoding="utf-8")
    return path


def measured(name: str, folder: Path, rig: Path) -> str:
    """The id of the folder's verified campaign, which is measured if it is not there."""
    done = [row for row in stored(folder) if row["state"] in ("accepted", "refused")]
    if done:
        return str(done[-1]["campaign"])
    if name == "resumed" and not stored(folder):
        interrupt(folder, rig)
    broken = stored(folder)
    resume = ["--resume", broken[-1]["campaign"]] if broken else []
    command("calibrate", "--rig", rig, "--out", folder, *resume, statuses=(0, 1))
    return str(stored(folder)[-1]["campaign"])


def interrupt(folder: Path, rig: Path) -> None:
    """Begin a campaign and end it after its first readings."""
    arguments = [sys.executable, "-m", "pkm_rig.cli", "calibrate", "--rig", str(rig), "--out", str(folder)]
    with subprocess.Popen(arguments, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None and not any(row["readings"] > 60 for row in stored(folder)):
            time.sleep(0.5)
        process.send_signal(signal.SIGINT)


def stored(folder: Path) -> list[dict[str, Any]]:
    """What is in the folder's store."""
    if not (folder / "pkm-rig.sqlite").is_file():
        return []
    found: list[dict[str, Any]] = json.loads(command("list", "--out", folder, "--json"))["campaigns"]
    return found


def command(*arguments: object, statuses: tuple[int, ...] = (0,)) -> str:
    """What a command prints. RuntimeError with its last line for another status."""
    words = [sys.executable, "-m", "pkm_rig.cli", *map(str, arguments)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode not in statuses:
        raise RuntimeError(f"{' '.join(words[3:])}: status {done.returncode}: {done.stderr.strip()[-300:]}")
    return done.stdout


def papers_of(campaign: str, folder: Path, rig: Path, schemas: Path | None) -> dict[str, Any]:
    """Write all papers of a campaign and check them."""
    command("report", campaign, "--out", folder, "--pdf")
    place = folder / campaign
    data = json.loads((place / "report.json").read_text(encoding="utf-8"))
    wrong, numbers = complaints((place / "report.html").read_text(encoding="utf-8"), data)
    pages, overlapping = look_at(place / "report.pdf")
    options = [] if schemas is None else ["--schemas", schemas]
    arguments = ("certificate", campaign, "--out", folder, "--rig", rig, "--json")
    newer = json.loads(command(*arguments))
    older = json.loads(command(*arguments, "--dcc", "3.0.0", *options))
    read_back, count = (0, 0) if schemas is None else values_read_back(Path(older["certificate"]), schemas)
    bad = len(wrong) + overlapping + (newer["rules"] != "valid") + (older["rules"] != "valid")
    bad += 0 if schemas is None else (older["schema"] != "valid") + (read_back != count)
    for line in wrong[:5]:
        print(f"  {line}", file=sys.stderr)
    return {
        "pages": pages,
        "numbers": numbers,
        "wrong_numbers": len(wrong),
        "overlapping": overlapping,
        "rules": newer["rules"],
        "schema": older["schema"].partition(":")[0],
        "read_back": f"{read_back} of {count}",
        "wrong": bad,
    }


def look_at(pdf: Path) -> tuple[int, int]:
    """Draw the pages beside a PDF; their number, and how many pairs of text boxes overlap."""
    import pypdfium2  # noqa: PLC0415

    document = pypdfium2.PdfDocument(str(pdf))
    overlapping = 0
    for number in range(len(document)):
        document[number].render(scale=1.4).to_pil().save(pdf.with_name(f"page-{number + 1:02}.png"))
        overlapping += sum(1 for _ in pairs(document[number].get_textpage()))
    return len(document), overlapping


def pairs(page: Any) -> Iterator[tuple[int, int]]:
    """Pairs of rectangles of text on a page that overlap."""
    boxes = [page.get_rect(i) for i in range(page.count_rects())]
    for i, (left, bottom, right, top) in enumerate(boxes):
        for j, (other_left, other_bottom, other_right, other_top) in enumerate(boxes[:i]):
            across = min(right, other_right) - max(left, other_left)
            up = min(top, other_top) - max(bottom, other_bottom)
            if across > SLACK_PT and up > SLACK_PT:
                yield i, j


def values_read_back(certificate: Path, schemas: Path) -> tuple[int, int]:
    """How many quantities dcc-json-toolkit reads as they were written (value, unit, U), and how many there are."""
    import dcc_json_toolkit.cache  # noqa: PLC0415

    written = quantities_of(parse(certificate.read_bytes(), str(certificate)))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        units = next(schemas.glob("SI_Format*2.0.0*.xsd"))
        text = next(schemas.glob("dcc*3.0.0*.xsd")).read_text(encoding="utf-8")
        (folder / "SI_Format.xsd").write_bytes(units.read_bytes())
        address = "https://ptb.de/si/v2.0.0/SI_Format.xsd"
        (folder / "dcc.xsd").write_text(text.replace(address, str(folder / "SI_Format.xsd")), encoding="utf-8")
        (folder / "cache").mkdir()
        dcc_json_toolkit.cache.CACHE_DIR_PATH = folder / "cache"
        schema = dcc_json_toolkit.DccSchema("3.0.0", schema_url=str(folder / "dcc.xsd"))
        read = list(reals(schema.to_dict(os.fspath(certificate))))
    same = sum(
        (Decimal(str(q["value"])), q["unit"], None if q["expanded"] is None else Decimal(str(q["expanded"])))
        == (Decimal(str(value)), unit, None if u is None else Decimal(str(u)))
        for q, (value, unit, u) in zip(written, read, strict=True)
    )
    return same, len(written)


def reals(node: Any) -> Iterator[tuple[Any, str, Any]]:
    """Value, unit and U of all quantities of a dictionary, in order."""
    if isinstance(node, list):
        for one in node:
            yield from reals(one)
    elif isinstance(node, dict):
        if "si:value" in node:
            yield node["si:value"], node["si:unit"], node.get("si:expandedUnc", {}).get("si:uncertainty")
        else:
            for key, one in node.items():
                if not key.startswith("@"):
                    yield from reals(one)


if __name__ == "__main__":
    main()
