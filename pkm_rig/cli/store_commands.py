"""Commands on what is stored: list, show, report, export, import."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.base.errors import InputError
from calibration.base.plain_file import require_file_or_folder
from pkm_rig.cli.options import JsonOption, OutOption, SequenceOption, StoredCampaignArgument
from pkm_rig.errors import StoreError

if TYPE_CHECKING:
    from pkm_rig.store.stored_rows import CampaignSummary


def list_campaigns(
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    removed: Annotated[bool, typer.Option("--removed", help="campaigns that were deleted or archived")] = False,
    chart: Annotated[bool, typer.Option("--chart", help="draw them too: campaigns.png, a line a rig")] = False,
) -> None:
    """What is in the store."""
    from pkm_rig.report.record_text import removed_line
    from pkm_rig.report.terminal import print_json, results
    from pkm_rig.store.store import open_existing_store

    with open_existing_store(out) as store:
        rows, gone = store.campaigns(), store.removed()
    picture = _chart(rows, out) if chart else None
    if json:
        result = {"campaigns": [row._asdict() for row in rows], "removed": [one._asdict() for one in gone]}
        print_json(result | ({} if picture is None else {"picture": str(picture)}))
    elif removed:
        for one in gone:
            results.print(removed_line(one), soft_wrap=True, markup=False)
    else:
        for row in rows:
            state = "DAMAGED" if row.damage else " ".join(part for part in (row.state, row.step) if part)
            parts = (row.campaign, row.created, row.rig, row.readings, state, "SIMULATED" if row.simulated else "")
            results.print("  ".join(str(part) for part in parts).rstrip(), soft_wrap=True, markup=False)
        if gone:
            results.print(f"{len(gone)} removed: pkm-rig list --removed --out {out}", soft_wrap=True, markup=False)
        if picture is not None:
            results.print(f"picture: {picture}", soft_wrap=True, markup=False)
    damaged = [row.damage for row in rows if row.damage]
    if damaged:
        raise StoreError(damaged[0])


def _chart(rows: Sequence[CampaignSummary], out: Path) -> Path:
    from pkm_rig.report.campaign_chart import draw_campaigns
    from pkm_rig.report.pictures import save_png
    from pkm_rig.report.terminal import print_message
    from pkm_rig.store.place import store_folder

    picture = store_folder(out) / "campaigns.png"
    figure, undated = draw_campaigns(rows)
    try:
        save_png(figure, picture, simulated=bool(rows) and all(row.simulated for row in rows))
    except OSError as error:
        raise InputError(f"list: {picture}: {error.strerror}; choose another --out") from error
    if undated:
        print_message(f"{undated} without a date are not in the picture")
    return picture


def show(campaign: StoredCampaignArgument, out: OutOption = Path("runs"), json: JsonOption = False) -> None:
    """What happened to a campaign."""
    from pkm_rig.report.terminal import print_json, print_simulated, results, say_repaired
    from pkm_rig.store.store import open_existing_store

    with open_existing_store(out) as store:
        simulated, head = store.header(campaign).simulated, store.head(campaign)
        readings, events = store.count_readings(campaign), store.events(campaign)
        recording = store.recording(campaign) if readings else None
    sessions = () if recording is None else recording.file.sessions
    if json:
        print_json({
            "campaign": campaign,
            "simulated": simulated,
            "readings": readings,
            "head": head or None,
            **({} if recording is None else say_repaired(recording)),
            "sessions": [s.model_dump(mode="json") for s in sessions],
            "events": [{"created": e.created, "kind": e.kind, "data": e.data} for e in events],
        })  # fmt: skip
        return
    print_simulated(simulated)
    chained = f"head {head}" if head else "not chained"
    results.print(f"{campaign}: {readings} readings, {chained}", soft_wrap=True, markup=False)
    if recording is not None:
        say_repaired(recording)
    for s in sessions:
        span = f"rig time {s.begin_rig_s:.0f} to {s.end_rig_s:.0f} s"
        results.print(f"session {s.number}  {s.command}  {span}  {s.why}".rstrip(), soft_wrap=True, markup=False)
    for event in events:
        plan = event.data.get("plan") or ""
        what = event.data.get("reason") or event.data.get("name") or ""
        line = f"{event.created}  {event.kind}  {plan} {what}".rstrip()
        results.print(line, soft_wrap=True, markup=False)


def report(
    campaign: StoredCampaignArgument,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    pdf: Annotated[bool, typer.Option("--pdf", help="as PDF too, in A4 (needs the extra [pdf])")] = False,
    language: Annotated[
        str | None, typer.Option("--language", help="en or de: headings, verdict and fields; else the rig file's")
    ] = None,
) -> None:
    """Write the report of a campaign anew, whatever the campaign came to."""
    from pkm_rig.jobs.report import parse_language, report_source
    from pkm_rig.report.html import report_path, write_report
    from pkm_rig.report.pdf import require_pdf, write_pdf
    from pkm_rig.report.terminal import print_result
    from pkm_rig.store.store import open_existing_store

    chosen = None if language is None else parse_language(language)
    if pdf:
        require_pdf()
    with open_existing_store(out) as store:
        source = report_source(store, campaign)
    try:
        path = report_path(campaign, out)
        written = write_report(source, path, chosen)
        if pdf:
            write_pdf(written.html, path.with_suffix(".pdf"))
    except OSError as error:
        raise InputError(f"report: {error}; choose another --out") from error
    result = written.data | {"pdf": str(path.with_suffix(".pdf")) if pdf else None}
    print_result(json, result, f"report: {path.with_suffix('.pdf') if pdf else path}")


def export_campaign(
    campaign: StoredCampaignArgument,
    folder: Annotated[Path, typer.Argument(help="new folder")],
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    hdf5: Annotated[bool, typer.Option("--hdf5", help="FOLDER.h5 beside it too (needs the extra [hdf5])")] = False,
) -> None:
    """Write a campaign as a recording folder (docs/reference/recording.md)."""
    from calibration.recording.folder import RecordFile, write_folder, write_record
    from calibration.recording.hdf5 import require_hdf5, write_hdf5
    from pkm_rig.report.terminal import print_result, say_repaired
    from pkm_rig.store.store import open_existing_store

    beside = folder.with_name(f"{folder.name}.h5") if hdf5 else None
    if beside is not None:
        require_hdf5(beside)
    with open_existing_store(out) as store:
        recording, head = store.recording(campaign), store.head(campaign)
    repaired = say_repaired(recording)
    write_folder(recording, folder)
    if beside is not None:
        write_hdf5(recording, beside, head)
    if head:
        write_record(folder, RecordFile(campaign=campaign, head=head, readings=len(recording)))
    simulated = recording.file.simulated
    result = {"campaign": campaign, "simulated": simulated, "folder": str(folder), "readings": len(recording)}
    result |= {"head": head or None, "hdf5": None if beside is None else str(beside), **repaired}
    print_result(json, result, f"{len(recording)} readings: {folder}{'' if beside is None else f', {beside}'}")


def import_folder(
    source: Annotated[Path, typer.Argument(help="recording folder, or Klipper's printer.cfg of a linear delta")],
    folder: Annotated[Path | None, typer.Argument(help="new measurement folder, of a printer.cfg only")] = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    by_sequence: SequenceOption = False,
) -> None:
    """Read a recording into the store or a printer.cfg into a measurement folder (docs/reference/measurements.md)."""
    if not source.exists():
        raise InputError(f"{source}: no such file or folder; check the path")
    require_file_or_folder(source)
    if source.is_file():
        _import_printer(source, folder, out, json)
    elif folder is not None:
        raise InputError(f"{source}: not a file; a second folder is only for what a printer.cfg holds")
    else:
        _import_recording(source, out, json, by_sequence=by_sequence)


def _import_printer(source: Path, folder: Path | None, out: Path, json: bool) -> None:
    from pkm_rig.jobs.measured_machine import import_printer, printer_name
    from pkm_rig.jobs.next_command import command_line
    from pkm_rig.report.terminal import print_result
    from pkm_rig.store.place import campaign_folder

    folder = folder or campaign_folder(out, printer_name(source))
    result = import_printer(source, folder)
    print_result(json, result, f"{result['readings']} readings: {folder}", f"next: {command_line('identify', folder)}")


def _import_recording(source: Path, out: Path, json: bool, *, by_sequence: bool) -> None:
    from calibration.recording.folder import read_folder
    from pkm_rig.report.terminal import print_result, say_repaired
    from pkm_rig.store.store import open_store

    recording = read_folder(source, by_sequence=by_sequence)
    repaired = say_repaired(recording)
    with open_store(out) as store:
        store.add_recording(recording)
    name, count = recording.file.campaign, len(recording)
    result = {"campaign": name, "simulated": recording.file.simulated, "readings": count} | repaired
    print_result(json, result, f"campaign {name}: {count} readings")
