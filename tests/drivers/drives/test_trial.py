"""Tables on trial: bytes on the bus, and drives that end a trial by themselves when their master stays away."""

from __future__ import annotations

import dataclasses
import itertools

import can
import numpy as np
import pytest

from drivers.can.drive_object import DriveObject
from drivers.drives.drive_profile import load_profile, parse_profile
from drivers.drives.table_bank import CompensationMode, TableBank
from drivers.drives.table_group import bring_to, use_on_trial
from drivers.drives.table_image import encode_table
from drivers.errors import NoAnswer, SdoRefused, TableError
from tests.drivers.drive_bench import Bench, Open
from tests.drivers.drives.test_table_image import make_image

TIMEOUT_S = 20.0
MODE = DriveObject(0x2100, 1, "<B", "mode")
ACTIVATE = DriveObject(0x2100, 2, "<B", "activate", reads_back=False)
EMCY_TRIAL = 0xFF11


def image_for(node: int, generation: int = 4) -> bytes:
    return encode_table(
        make_image(
            np.full((3, 3), 20e-6 * generation),
            node_id=node,
            generation=generation,
            payload_kg=0.0,
            machine_id=b"\0" * 16,
            own_start_m=-0.5,
            own_step_m=0.5,
            partner_start_m=-0.5,
            partner_step_m=0.5,
        )
    )


def banks_of(bench: Bench) -> list[TableBank]:
    banks = [TableBank(drive) for drive in bench.drives]
    for bank in banks:
        bank.set_payload(0.0)
    return banks


def images(generation: int = 4) -> list[bytes]:
    return [image_for(1, generation), image_for(2, generation)]


def on_trial(bench: Bench) -> list[TableBank]:
    banks = banks_of(bench)
    use_on_trial(banks, images(), TIMEOUT_S)
    return banks


def modes(bench: Bench) -> list[int]:
    return [server.compensation.mode for server in bench.servers]


def downloads(frames: list[can.Message]) -> list[str]:
    """Requests to write, of node 1, as hexadecimal bytes."""
    return [bytes(f.data).hex() for f in frames if f.arbitration_id == 0x601 and f.data[0] & 0xE0 == 0x20]


def test_golden_bytes_of_a_trial_and_of_keeping_it(opened: Open) -> None:
    bench = opened()
    bank = banks_of(bench)[0]
    bank.load(image_for(1))
    bank.activate(1, bank.state().banks[0].crc, 4)
    bench.bus.sent.clear()
    bank.set_trial_timeout(20.0)
    bank.set_mode(CompensationMode.TRIAL)
    assert bank.state().mode is CompensationMode.TRIAL
    bank.set_mode(CompensationMode.KEPT)
    bank.set_mode(CompensationMode.OFF)
    assert downloads(bench.bus.sent) == [
        "2300210c204e0000",  # time-out of a trial: 20,000 ms
        "2f00210102000000",  # on trial
        "2f00210101000000",  # kept
        "2f00210100000000",  # off
    ]


def test_a_trial_goes_on_while_its_master_is_there(opened: Open) -> None:
    bench = opened()
    on_trial(bench)
    bench.group.enable()
    bench.clock.sleep_s(600.0)
    assert modes(bench) == [2, 2]
    bench.group.move_to([0.1, -0.1], 0.2)


def test_a_drive_without_power_ends_its_trial_when_its_master_stays_away(opened: Open) -> None:
    bench = opened()
    on_trial(bench)
    bench.beating = False
    bench.clock.sleep_s(TIMEOUT_S - 0.5)
    assert modes(bench) == [2, 2]
    bench.clock.sleep_s(1.5)
    assert modes(bench) == [0, 0]
    assert [drive.emergencies[-1].code for drive in bench.drives] == [EMCY_TRIAL, EMCY_TRIAL]
    assert "on trial" in str(bench.drives[0].emergencies[-1])
    assert [server.compensation.active_bank for server in bench.servers] == [1, 1]  # the bank stays, unused


def test_a_moving_drive_ends_its_trial_after_its_own_stop_and_without_power(opened: Open) -> None:
    """Even if it is not told to stop by its own watchdog, as 0x6007 = 0 says."""
    bench = opened()
    on_trial(bench)
    for drive in bench.drives:
        drive.sdo.write(DriveObject(0x6007, 0, "<h", "option"), 0)
    bench.group.enable()
    axis = bench.servers[0].axis
    drive = bench.drives[0]
    bench.group.sample()
    bench.group.sample()
    drive.set_profile(0.005)
    drive.write_target(0.4)
    drive.send_controlword(0x3F)
    drive.state()
    bench.beating = False
    seen = []

    def look() -> None:
        seen.append((axis.compensation.mode, axis.powered, axis.motion.is_moving(bench.clock.now_s())))
        if len(seen) < 4000:
            bench.clock.call_at(bench.clock.now_s() + 0.01, look)

    look()
    bench.clock.sleep_s(TIMEOUT_S + 3.0)
    assert (2, True, True) in seen
    assert seen[-1] == (0, False, False)
    assert not [entry for entry in seen if entry[0] == 0 and (entry[1] or entry[2])]


def test_the_end_of_a_trial_in_a_fault_reaction_waits_for_it(opened: Open) -> None:
    bench = opened()
    on_trial(bench)
    bench.group.enable()
    bench.servers[0].inject_fault()
    bench.beating = False
    bench.clock.sleep_s(TIMEOUT_S + 2.0)
    assert modes(bench) == [0, 0]
    assert bench.servers[0].axis.state.name == "FAULT"
    assert bench.servers[1].axis.state.name == "SWITCH_ON_DISABLED"


def test_a_kept_table_stays_whether_a_master_is_there_or_not(opened: Open) -> None:
    bench = opened()
    banks = on_trial(bench)
    for bank in banks:
        bank.set_mode(CompensationMode.KEPT)
    bench.beating = False
    bench.clock.sleep_s(10 * TIMEOUT_S)
    assert modes(bench) == [1, 1]


def test_a_restart_ends_a_trial_and_a_kept_table_alike(opened: Open) -> None:
    bench = opened()
    banks = on_trial(bench)
    banks[1].set_mode(CompensationMode.KEPT)
    for server in bench.servers:
        server.power_cycle()
    assert modes(bench) == [0, 0]
    assert [server.compensation.trial_ms for server in bench.servers] == [0, 0]
    bench.clock.sleep_s(10 * TIMEOUT_S)
    assert not any(e.code == EMCY_TRIAL for drive in bench.drives for e in drive.emergencies)


def test_what_a_drive_refuses_about_trials(opened: Open) -> None:
    bench = opened()
    bank = banks_of(bench)[0]
    with pytest.raises(SdoRefused, match="not in this state"):
        bank.set_mode(CompensationMode.TRIAL)  # without a time-out
    with pytest.raises(SdoRefused, match="out of range"):
        bench.drives[0].sdo.write(MODE, 3)
    on_trial(bench)
    with pytest.raises(SdoRefused, match="not in this state"):
        bank.set_trial_timeout(1.0)
    bench.group.enable()
    with pytest.raises(SdoRefused, match="not in this state"):
        bank.set_mode(CompensationMode.KEPT)
    with pytest.raises(ValueError, match="time-out of a trial"):
        bank.set_trial_timeout(float("nan"))


def test_a_mode_that_is_none_is_no_state(opened: Open) -> None:
    bench = opened()
    bench.servers[0].compensation.mode = 7
    with pytest.raises(TableError, match="mode 7 is unknown"):
        banks_of(bench)[0].state()


def test_a_make_without_trials_keeps_at_once(opened: Open) -> None:
    bench = opened()
    banks = banks_of(bench)
    profile = load_profile("pkm-mock")
    assert profile.compensation is not None
    for drive in bench.drives:
        drive.profile = dataclasses.replace(profile, compensation=dataclasses.replace(profile.compensation, trial=None))
    use_on_trial(banks, images(), TIMEOUT_S)
    assert modes(bench) == [1, 1]
    assert not parse_profile('name = "x"').capabilities.trial


def test_tables_are_brought_to_a_state_from_any_other(opened: Open) -> None:
    bench = opened()
    banks = banks_of(bench)
    wanted: list[tuple[list[bytes | None], bool]] = [
        (list(images(4)), True),
        (list(images(5)), True),
        (list(images(4)), False),
        ([None, None], False),
        (list(images(9)), True),
        (list(images(4)), True),  # in no bank any more
        ([image_for(1, 5), None], False),
        (list(images(9)), True),
    ]
    for contents, on in wanted:
        for _ in range(2):  # and again
            bring_to(banks, contents, TIMEOUT_S, on=on)
            assert modes(bench) == [int(on)] * 2
            tables = [server.compensation.table for server in bench.servers]
            stored = [server.compensation.banks[server.compensation.active_bank or 1].image for server in bench.servers]
            for content, table, image in zip(contents, tables, stored, strict=True):
                assert (table is None) is (content is None)
                assert content is None or image == content


def test_what_is_in_use_already_is_kept_without_being_switched_off(opened: Open) -> None:
    bench = opened()
    banks = on_trial(bench)
    bench.bus.sent.clear()
    bring_to(banks, list(images()), TIMEOUT_S, on=True)
    assert downloads(bench.bus.sent) == ["2f00210101000000"]


def test_a_drive_that_refuses_leaves_compensation_off_on_all(opened: Open) -> None:
    bench = opened()
    banks = banks_of(bench)
    bench.servers[1].compensation.set_trial_ms(1)
    bench.servers[1].compensation.mode = 2  # it does not accept another time-out
    bench.servers[1].compensation.set_mode = lambda _mode, _powered: None  # type: ignore[method-assign]
    with pytest.raises((SdoRefused, TableError)):
        use_on_trial(banks, images(), TIMEOUT_S)
    assert bench.servers[0].compensation.mode == 0


@pytest.mark.parametrize(("entry", "value", "repeatable"), [(MODE, 1, True), (ACTIVATE, 0, False)])
def test_a_word_whose_answer_was_lost_is_not_written_again(
    opened: Open, entry: DriveObject, value: int, repeatable: bool
) -> None:
    """The drive has carried it out: written again it could act twice."""
    bench = opened()
    count = itertools.count()
    bench.bus.misses = lambda frame: frame.arbitration_id == 0x581 and frame.data[0] == 0x60 and next(count) == 0
    if repeatable:
        bench.drives[0].sdo.write(entry, value)
    else:
        with pytest.raises(NoAnswer):
            bench.drives[0].sdo.write(entry, value)
    assert next(count) > 0  # an answer was lost
    assert len([frame for frame in downloads(bench.bus.sent) if frame[2:8] == f"0021{entry.sub:02x}"]) == 1
    assert bench.servers[0].compensation.mode == (value if repeatable else 0)
