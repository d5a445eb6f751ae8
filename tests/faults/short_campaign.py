"""A short campaign over all devices for fault injection: 2 poses, 1 payload, then a table written and switched on."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calibration.compensation.tables import CompensationTable
from calibration.model.operating_conditions import OperatingConditions
from calibration.recording.recording import Recording
from drivers.errors import DeviceError
from mock_devices.faults import Fault, FaultPlan
from pkm_rig.errors import CampaignRefused, StoreError
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.plans import visits
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.runner import describe_campaign, open_runner
from pkm_rig.rig.schedule import Block, calibration_blocks
from pkm_rig.rig.supervision import Supervisor
from pkm_rig.store.append import now_text
from pkm_rig.store.store import Store
from pkm_rig.virtual.mock_rig import Embedded, embedded_mock_rig

CAMPAIGN = "short"
GUARD_S = 0.2  # host time in which an answer has to come, while a fault may keep it away
PATIENT_S = 10.0  # and while none does: a busy computer is no fault
DRIVES_STAND_S = 4.0  # rig time after which nothing may move any more, the drives' own watchdog included
WITHOUT_BLOCKS = (2,)  # so that a table goes by blocks to one drive and by segments to the other
EXPECTED = (DeviceError, CampaignRefused, StoreError)
Key = tuple[str, int, int, str]


@dataclass
class Bench:
    """One mock rig with armed faults, and the store that a campaign on it fills."""

    mock: Embedded
    store: Store
    plan: FaultPlan
    machine: object = None
    path: Path = field(default_factory=embedded_rig_path)


@contextmanager
def bench(fault: Fault | None) -> Iterator[Bench]:
    """A mock rig in virtual time with one fault armed, and an empty store."""
    file, machine = load_rig(embedded_rig_path())
    settings = file.campaign.model_copy(
        update={"readings_per_nest": 1, "speeds_m_per_s": (1.0, 1.0), "dwells_s": (1.0, 1.0)}
    )
    file = file.model_copy(update={"campaign": settings})
    plan = FaultPlan([] if fault is None else [fault])
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        store = Store(Path(folder) / "store.sqlite")
        stack.callback(store.close)
        path = embedded_rig_path()
        mock = stack.enter_context(embedded_mock_rig(file, path, faults=plan, without_blocks=WITHOUT_BLOCKS))
        stack.enter_context(mock.clock.activity())
        yield Bench(mock, store, plan, machine)


def run(bench: Bench, guard_s: float = GUARD_S) -> Supervisor:
    """Connect, measure what is not stored yet, write a table, switch it on; raises what ends it early."""
    file = bench.mock.file.model_copy(
        update={"station": bench.mock.file.station.model_copy(update={"port": bench.mock.mock.station_url})}
    )
    machine, store = bench.machine, bench.store
    with connect_rig(file, machine, bench.mock.clock, bench.mock.bus_factory, guard_s=guard_s) as rig:  # type: ignore[arg-type]
        if not store.campaigns():
            store.add_campaign(describe_campaign(rig, CAMPAIGN, now_text()), rig.machine.text)
        with open_runner(rig, store, CAMPAIGN, lambda _n, _what: None) as runner:
            if store.has_readings(CAMPAIGN):
                runner.resume(store.recording(CAMPAIGN))
            rig.drives.fault_reset()  # what an operator does who has removed the cause
            rig.enable()
            rig.compensate(None)
            rig.refresh_atmosphere()
            block = Block(0, calibration_blocks(rig.machine, file.campaign)[0].visits[:2])
            smrs = runner.devices.smrs("platform")
            runner.run(visits(runner.devices, block, "calibration", smrs), "short")
            rig.compensate(rig.images(flat_table(), rig.next_generation()))
            if not all(state.on and state.valid for state in (bank.state() for bank in rig.banks)):
                raise AssertionError("the tables are not on")
        return rig.supervisor


def heal(bench: Bench) -> None:
    """Everything works again; the mock rig stands as it was left."""
    bench.plan.clear()
    with suppress(AttributeError):
        bench.mock.mock.station_server.plug_in()  # type: ignore[attr-defined]


def flat_table() -> CompensationTable:
    """The same small correction everywhere, for no payload."""
    return CompensationTable(
        start_m=np.array([0.5, 0.5]),
        step_m=np.array([0.4, 0.4]),
        correction_m=np.full((2, 3, 3), 20e-6),
        conditions=OperatingConditions(0.0, (0.0, 0.0, 0.0), {"struts": 20.0}),
    )


def still(bench: Bench) -> bool:
    """Whether nothing moves once the drives had their time to stop."""
    bench.mock.clock.sleep_s(DRIVES_STAND_S)
    return not bench.mock.mock.plant.is_moving()


def recorded(bench: Bench) -> Recording | None:
    """What is in the store."""
    if not bench.store.campaigns() or not bench.store.has_readings(CAMPAIGN):
        return None
    return bench.store.recording(CAMPAIGN)


def rows_by_key(recording: Recording) -> dict[Key, list[int]]:
    """Rows of each reading that a plan names: phase, pose, pass and reflector."""
    values: dict[Key, list[int]] = {}
    columns = (recording["phase"], recording["pose"], recording["pass"], recording["smr"])
    for row, (phase, pose, pass_, smr) in enumerate(zip(*columns, strict=True)):
        values.setdefault((str(phase), int(pose), int(pass_), str(smr)), []).append(row)
    return values


__all__ = ["EXPECTED", "Bench", "Rig", "bench", "heal", "recorded", "rows_by_key", "run", "still"]
