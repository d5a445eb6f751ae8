"""The main job: check, measure, identify, diagnose, build tables, write, verify, and a verdict."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import bluesky.plan_stubs as bps
import numpy as np

from calibration.base.errors import InputError
from calibration.compensation.tables import CompensationTable
from calibration.identification.calibration import (
    Calibration,
    identify_recording,
    model_comparison,
    orientation_prediction,
)
from calibration.identification.observability import observability_of
from calibration.identification.remarks import remarks
from calibration.recording.recording import Recording
from calibration.reduction.figures import Decision, Figures, decide, noise_floor, visit_figures
from calibration.reduction.reduction import Reduction, reduce
from drivers.errors import DeviceError
from drivers.table_bank import CompensationState
from pkm_rig.jobs.diagnose import Attempt, attempt
from pkm_rig.jobs.further_visits import adds_visits, first_pose, numbered_from, same_rig, visited_thrice
from pkm_rig.rig.fitness import check_rig
from pkm_rig.rig.plans import CampaignRefused, Plan, calibration, prepare, verification
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.runner import Runner, describe_campaign, new_campaign_id, running, settings_event
from pkm_rig.rig.schedule import Block, calibration_blocks, verification_block
from pkm_rig.rig.store import Store, now_text

Say = Callable[[str], None]
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Verified:
    """Verification at one payload: measured before and after, the rule, how the models predict it."""

    payload: int
    payload_kg: float
    before: Figures
    after: Figures
    decision: Decision
    orientation_prediction_rad: float
    models: dict[str, Figures]


@dataclass(frozen=True)
class Written:
    """A table that was written: for which payload, and by drive its generation, CRC and whether it was active."""

    table: CompensationTable
    payload: int
    drives: dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Outcome:
    """What a calibration ended with."""

    campaign: str
    calibration: Calibration
    reduction: Reduction
    floor: Figures
    verified: tuple[Verified, ...]
    written: tuple[Written, ...]
    accepted: bool
    diagnosis: Attempt
    restored: str | None = None


def measure(rig: Rig, store: Store, say: Say, progress: Progress, resume: str | None = None) -> str:
    """Prepare and measure a calibration campaign, compensation off meanwhile; returns its id.

    Every reading is in the store as soon as it is taken. `resume` goes on with a campaign that broke off: what is
    stored is not measured again, provided that a nest check finds the station where it was. Where the rig file now
    gives visits that it did not give then, they are added to the campaign.
    Raises DeviceError, CampaignRefused, StoreError, and InputError where the rig file is another one.
    """
    if resume is None:
        campaign, blocks, total = _open_campaign(rig, store, say, verify=False)
    else:
        campaign, blocks, total = _reopen_campaign(rig, store, say, resume)
    with (
        running(rig, store, campaign, lambda n, what: progress(n, total, what)) as runner,
        former_tables(rig) as former,
    ):
        if resume is not None and store.has_readings(campaign):
            runner.resume(store.recording(campaign))
        _measure(runner, blocks)
        former.restore()
    return campaign


def calibrate(rig: Rig, store: Store, say: Say, progress: Progress) -> Outcome:
    """Run the main job on a connected rig.

    Raises DeviceError, CampaignRefused, StoreError or InputError with the machine stopped, former
    tables restored where the drives can still be reached, and all readings kept.
    """
    campaign, blocks, total = _open_campaign(rig, store, say, verify=True)
    with (
        running(rig, store, campaign, lambda n, what: progress(n, total, what)) as runner,
        former_tables(rig) as former,
    ):
        _measure(runner, blocks)
        say("identifying")
        identified = identify_recording(store.recording(campaign))
        store.add_event(campaign, "identified", identified_summary(identified))
        diagnosis = attempt(store.recording(campaign))
        store.add_event(campaign, "diagnosed", diagnosis.as_json())
        say(diagnosis.line)
        return _verify(runner, identified, diagnosis, former, say)


def verify(rig: Rig, store: Store, campaign: str, say: Say, progress: Progress) -> Outcome:
    """Verify a measured campaign: identify it, measure before, write and activate its tables, measure after.

    The readings join the campaign, whose frame and nests they need: the station must not have been moved.
    """
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    identified = identify_recording(store.recording(campaign))
    if store.events(campaign, "accepted") or store.events(campaign, "refused"):
        raise InputError(f"campaign {campaign} was verified already; measure a new one")
    diagnosis = attempt(store.recording(campaign))
    say(diagnosis.line)
    total = planned_readings(rig, (), verify=True)
    with (
        running(rig, store, campaign, lambda n, what: progress(n, total, what)) as runner,
        former_tables(rig) as former,
    ):
        runner.resume(store.recording(campaign))
        rig.enable()
        return _verify(runner, identified, diagnosis, former, say)


def _open_campaign(rig: Rig, store: Store, say: Say, *, verify: bool) -> tuple[str, tuple[Block, ...], int]:
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    blocks = calibration_blocks(rig.machine, rig.file.campaign)
    if verify and not visited_thrice(blocks):
        raise InputError("campaign.visits: none is made three times, so there would be no noise floor; repeat some")
    total = planned_readings(rig, blocks, verify=verify)
    campaign = new_campaign_id(rig.file.rig)
    store.add_campaign(describe_campaign(rig, campaign, now_text()), rig.machine.text)
    store.add_event(campaign, "settings", settings_event(rig))
    say(f"campaign {campaign}: {total} readings planned")
    return campaign, blocks, total


def _reopen_campaign(rig: Rig, store: Store, say: Say, campaign: str) -> tuple[str, tuple[Block, ...], int]:
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    settings = store.events(campaign, "settings")
    if not settings:
        raise InputError(f"campaign {campaign}: it was not measured here; `pkm-rig list` shows what is there")
    then, now = (data["rig_file"] for data in (settings[0].data, settings_event(rig)))
    adds = adds_visits(then, now)
    if not same_rig(then, now, adds=adds):
        raise InputError(
            f"campaign {campaign}: begun with another rig file or campaign file; use that, or measure anew"
        )
    if store.events(campaign, "identified") or store.events(campaign, "verifying"):
        raise InputError(f"campaign {campaign}: its measurement is complete; measure a new one, without --resume")
    blocks = calibration_blocks(rig.machine, rig.file.campaign)
    if adds:
        blocks = numbered_from(first_pose(store, campaign, now["campaign"]["visits"]), blocks)
    say(f"campaign {campaign}: going on{' with further visits' if adds else ''}")
    return campaign, blocks, planned_readings(rig, blocks, verify=False)


def planned_readings(rig: Rig, blocks: Sequence[Block], *, verify: bool) -> int:
    """Number of readings of a campaign, nests included."""
    settings = rig.file.campaign
    on = [smr.on for smr in rig.machine.smrs]
    platform, floor, slider = (on.count(part) for part in ("platform", "floor", "slider"))
    visits = [len(block.visits) for block in blocks]
    readings = sum(visits) * (platform + slider)
    checks = sum(2 + (n - 1) // settings.nest_every_visits for n in visits)
    if blocks:
        readings += settings.repeatability_visits
        checks += 1
    if verify:
        runs = 2 * len(settings.verification_payloads)
        readings += runs * settings.verification_poses * platform
        checks += runs * (2 + (settings.verification_poses - 1) // settings.nest_every_visits)
    return readings + floor * checks


def _measure(runner: Runner, blocks: Sequence[Block]) -> None:
    rig = runner.rig
    rig.enable()
    rig.compensate(None)
    rig.refresh_atmosphere()
    runner.run(_both(prepare(runner.stage, blocks), calibration(runner.stage, blocks)), "calibration")


def _verify(runner: Runner, identified: Calibration, diagnosis: Attempt, former: FormerTables, say: Say) -> Outcome:
    rig, store, campaign = runner.rig, runner.store, runner.campaign
    store.add_event(campaign, "verifying", {"first_sequence": runner.stage.context.sequence})
    written = []
    payloads = rig.file.campaign.verification_payloads
    for payload in payloads:
        block = verification_block(rig.machine, rig.file.campaign, payload)
        say(f"verifying with payload '{rig.file.payloads[payload].name}'")
        runner.run(_payload(runner, payload), "payload")
        rig.compensate(None)
        rig.refresh_atmosphere()
        runner.run(verification(runner.stage, block, "verification_before"), "verification before")
        temperatures = rig.temperatures_c()
        table = identified.table(payload, temperatures)
        drives = table_summary(rig, rig.compensate(rig.images(table, rig.next_generation())))
        activated = {"payload": payload, "temperatures_c": temperatures, "tables": drives}
        store.add_event(campaign, "activated", activated)
        written.append(Written(table, payload, drives))
        runner.run(verification(runner.stage, block, "verification_after"), "verification after")
    recording = last_attempt(store, campaign)
    outcome = judge(campaign, identified, recording, tuple(written), diagnosis, former.description)
    if not outcome.accepted:
        say(f"the result is refused; back to {former.description}")
        former.restore()
    _record_verdict(store, outcome)
    return outcome


def last_attempt(store: Store, campaign: str) -> Recording:
    """A campaign's recording without the readings of a verification that was begun before and broke off."""
    recording = store.recording(campaign)
    attempts = store.events(campaign, "verifying")
    first = attempts[-1].data["first_sequence"] if attempts else 0
    phase = np.asarray(recording["phase"]).astype(str)
    keep = (recording["sequence"] >= first) | ~np.char.startswith(phase, "verification")
    return replace(recording, columns={name: column[keep] for name, column in recording.columns.items()})


def judge(
    campaign: str,
    identified: Calibration,
    recording: Recording,
    written: tuple[Written, ...],
    diagnosis: Attempt,
    former: str,
) -> Outcome:
    """Figures and verdict of a campaign that was verified: a function of what is stored."""
    reduction = reduce(recording, identified.reduction)
    floor = noise_floor(reduction)
    if floor is None:
        raise InputError(f"campaign {campaign}: no pose was visited three times, so there is no noise floor")
    verified = tuple(verify_payload(identified, reduction, w.payload) for w in written)
    accepted = bool(verified) and all(v.decision.accepted for v in verified)
    return Outcome(
        campaign=campaign,
        calibration=identified,
        reduction=reduction,
        floor=floor,
        verified=verified,
        written=written,
        accepted=accepted,
        diagnosis=diagnosis,
        restored=None if accepted else former,
    )


def _both(first: Plan, second: Plan) -> Plan:
    yield from first
    yield from second


def _payload(runner: Runner, payload: int) -> Plan:
    yield from bps.abs_set(runner.stage.payload, payload, wait=True)


def verify_payload(identified: Calibration, reduction: Reduction, payload: int) -> Verified:
    """Figures and decision at one payload; InputError if it was not verified."""
    before = visit_figures(reduction, "verification_before", payload)
    after = visit_figures(reduction, "verification_after", payload)
    predicted = orientation_prediction(identified, reduction, "verification_before", payload)
    if before is None or after is None or predicted is None:
        raise InputError(f"payload {payload} was not verified before and after; measure both")
    return Verified(
        payload=payload,
        payload_kg=reduction.recording.file.payloads[payload].mass_kg,
        before=before,
        after=after,
        decision=decide(before, after),
        orientation_prediction_rad=predicted,
        models=model_comparison(identified, reduction, payload),
    )


def identified_summary(identified: Calibration) -> dict[str, Any]:
    """Parameters with uncertainty, for the store and for JSON."""
    fit = identified.fit
    observed = observability_of(fit)
    parameters = {
        p.name: {
            "value": float(value),
            "u": float(u),
            "unit": p.unit,
            "observable": bool(u < 0.5 * p.sigma),
            "left": float(u / p.sigma),
        }
        for p, value, u in zip(fit.model.parameters.parameters, fit.theta, fit.theta_u, strict=True)
    }
    return {
        "estimator": fit.estimator,
        "parameters": parameters,
        "rank": observed.decided,
        "unknowns": fit.layout.size,
        "chi2_per_dof": fit.chi2_per_dof,
        "aliased": list(observed.sentences),
        "remarks": list(remarks(fit)),
        "range_constant_m": identified.reduction.range_constant_m,
        "u_range_constant_m": identified.reduction.range_constant_u_m,
        "dropped": identified.reduction.dropped,
    }


def table_summary(rig: Rig, states: Sequence[CompensationState]) -> dict[str, dict[str, Any]]:
    """Drive to generation, CRC and whether its table is active."""
    return {
        drive.name: {"generation": state.generation, "crc": state.crc, "active": state.valid}
        for drive, state in zip(rig.file.drives, states, strict=True)
    }


def _record_verdict(store: Store, outcome: Outcome) -> None:
    store.add_event(
        outcome.campaign,
        "accepted" if outcome.accepted else "refused",
        {
            "restored": outcome.restored,
            "noise_floor": outcome.floor.as_dict(),
            "verified": [
                {
                    "payload": v.payload,
                    "before": v.before.as_dict(),
                    "after": v.after.as_dict(),
                    "rule": v.decision.rule,
                }
                for v in outcome.verified
            ],
        },
    )


class FormerTables:
    """The tables that were active before, kept to be written back."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        states = [bank.state() for bank in rig.banks]
        self._images = (
            [bank.read_image(state.active) for bank, state in zip(rig.banks, states, strict=True)]
            if states and all(state.on and state.active for state in states)
            else None
        )
        self.description = "no compensation, as before" if self._images is None else "the former tables"

    def restore(self) -> None:
        """Back to what was active before, on all drives; they are left without power."""
        self._rig.switch_compensation(self._images)


@contextlib.contextmanager
def former_tables(rig: Rig) -> Iterator[FormerTables]:
    """Keep what is active now; it comes back if anything fails, as far as the drives can be reached."""
    former = FormerTables(rig)
    try:
        yield former
    except BaseException:
        with contextlib.suppress(DeviceError):
            former.restore()
        raise
