"""A machine that its own control moves: `measure --moved-by-control`, and `verify --before ... --after ...`."""

from __future__ import annotations

from pathlib import Path

from calibration.base.errors import InputError
from pkm_rig.cli.going_on import resumable
from pkm_rig.cli.terminal_operator import at_terminal
from pkm_rig.errors import CampaignRefused


def measure_by_station(rig: Path, out: Path, *, json: bool, resume: str | None, first: str | None) -> None:
    """Measure the visits of the control's program, and say what comes next."""
    from pkm_rig.jobs.measure_watched import measure_watched, require_program
    from pkm_rig.jobs.next_command import command_line
    from pkm_rig.jobs.session import open_rig
    from pkm_rig.report.terminal import print_message, print_result
    from pkm_rig.rig.config import load_rig
    from pkm_rig.rig.session_record import last_moment
    from pkm_rig.store.store import find_recording, open_store

    before = None if first is None else find_recording(first, out)
    require_program(*load_rig(rig))  # what cannot be is said before any device is touched
    options = ["--moved-by-control"] + ([] if first is None else ["--first", first])
    with (
        resumable("measure", rig, out, *options, campaign=resume),
        open_store(out, hold=True, campaign=resume) as store,
        open_rig(rig, after=last_moment(store, resume) if resume else None, moved_by_control=True) as connected_rig,
        at_terminal(connected_rig, out) as progress,
    ):
        campaign = measure_watched(connected_rig, store, print_message, progress, resume, before=before)
        simulated = store.header(campaign).simulated
    if first is None:
        next_command = command_line("identify", campaign, "--out", out)
    else:
        next_command = command_line("verify", "--before", first, "--after", campaign, "--out", out)
    print_result(json, {"campaign": campaign, "simulated": simulated}, f"campaign {campaign}", f"next: {next_command}")


def verify_by_campaigns(
    campaign: str | None, rig: Path | None, before: str | None, after: str | None, out: Path, *, json: bool
) -> None:
    """Decide by two campaigns whether a control's correction helps; CampaignRefused if it does not."""
    from pkm_rig.jobs.verify_folders import verify_folders
    from pkm_rig.report.control_text import print_comparison
    from pkm_rig.report.terminal import print_either, say_repaired
    from pkm_rig.store.store import find_recording

    if before is None or after is None or campaign is not None or rig is not None:
        raise InputError("verify: give --before and --after, and neither CAMPAIGN nor --rig: nothing is connected")
    recordings = [find_recording(name, out) for name in (before, after)]
    for recording in recordings:
        say_repaired(recording)
    result = verify_folders(*recordings)
    print_either(json, result, print_comparison)
    if not result["accepted"]:
        raise CampaignRefused("the error did not fall by more than its U at every payload; switch the correction off")
