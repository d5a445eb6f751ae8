"""The main job: check, measure, identify, diagnose, build tables, write, verify, and a verdict."""

from __future__ import annotations

from calibration.identification.calibration import identified_summary, identify_recording
from pkm_rig.jobs.acceptance import stored_outcome
from pkm_rig.jobs.diagnose import try_diagnosis
from pkm_rig.jobs.life_record import note_devices, record_identified
from pkm_rig.jobs.measure import go_on, measure_blocks, open_campaign, reopen_campaign
from pkm_rig.jobs.setup_tie import tie_to_earlier_setups
from pkm_rig.jobs.verify import Judge, verify_tables
from pkm_rig.report.diagnosis_json import diagnosis_attempt_json
from pkm_rig.report.diagnosis_text import diagnosis_line
from pkm_rig.results.callbacks import Notify, Progress
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_checks import require_back_end
from pkm_rig.rig.runner import open_runner
from pkm_rig.rig.table_change import changing_tables
from pkm_rig.rig.table_recovery import settle_tables
from pkm_rig.store.store import Store


def calibrate(
    rig: Rig,
    store: Store,
    notify: Notify,
    progress: Progress,
    resume: str | None = None,
    *,
    new_setup: bool = False,
    judge: Judge | None = None,
    accept_change: bool = False,
) -> CampaignOutcome:
    """Run the main job on a connected rig, or go on with a campaign (`resume`) wherever it ended.

    It goes on in the last set-up of the station, or in a `new_setup`. `judge`, `accept_change`: see `verify_tables`.

    What is measured stays; it is identified anew, and a verification that broke off begins anew; where
    only the tables had to be brought to where the verdict wants them, that is all that is done.
    Raises DeviceError, CampaignRefused, StoreError or InputError with the machine stopped, the
    previous tables restored if the drives can still be reached, and all readings kept.
    """
    require_back_end(rig)
    settled = settle_tables(rig, store, notify)
    if resume is not None and settled is not None and settled.campaign == resume and settled.judged:
        return stored_outcome(store, resume)
    note_devices(rig, store, notify)
    if resume is None:
        campaign, blocks, total = open_campaign(rig, store, notify, verify=True)
    else:
        campaign, blocks, total = reopen_campaign(rig, store, notify, resume, verify=True)
    with (
        open_runner(rig, store, campaign, total.show_by(progress), "calibrate", notify) as runner,
        changing_tables(rig, store, "calibrate", campaign) as change,
    ):
        go_on(runner, blocks, total, new_setup=new_setup)
        tie_to_earlier_setups(runner, total)
        if blocks:
            measure_blocks(runner, blocks)
        else:
            rig.enable()
        runner.devices.progress(0, "identifying")
        notify("identifying")
        identification = identify_recording(store.recording(campaign))
        store.add_event(campaign, "identified", identified_summary(identification))
        record_identified(rig, store, campaign, identification)
        runner.devices.progress(0, "diagnosing")
        diagnosis = try_diagnosis(store.recording(campaign))
        store.add_event(campaign, "diagnosed", diagnosis_attempt_json(diagnosis))
        notify(diagnosis_line(diagnosis))
        return verify_tables(runner, identification, diagnosis, change, notify, judge, accept_change=accept_change)
