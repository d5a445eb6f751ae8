"""Writing, comparing and switching tables on the in-process bus."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest

from drivers.drives.table_bank import BankStatus, CompensationMode, TableBank
from drivers.drives.table_group import Activation, activate_all
from drivers.errors import SdoRefused, TableError
from tests.drivers.drives.test_table_image import make_image
from tests.drivers.scripted_drive import Rig

_channels = itertools.count()


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = Rig(f"table bank {next(_channels)}")
    with rig.clock.activity():
        rig.connect()
        yield rig
    rig.close()


@pytest.fixture
def banks(rig: Rig) -> list[TableBank]:
    return [TableBank(servo) for servo in rig.servos]


def _write_both(banks: list[TableBank], generation: int) -> list[Activation]:
    written = [
        (bank, bank.write_inactive(make_image(node_id=bank.drive.node_id, generation=generation))) for bank in banks
    ]
    return [Activation(bank, w.bank, w.crc, w.generation) for bank, w in written]


def test_a_fresh_drive(banks: list[TableBank]) -> None:
    state = banks[0].state()
    assert not state.on
    assert state.payload_kg is None
    assert (state.active, state.idle, state.next_generation) == (0, 1, 1)
    assert state.banks[0].status is BankStatus.EMPTY


def test_write_activate_and_roll_back(banks: list[TableBank]) -> None:
    assert [a.number for a in activate_all(_write_both(banks, 1))] == [0, 0]
    assert banks[0].state().active == 1
    assert banks[0].read_image(1).generation == 1
    previous = activate_all(_write_both(banks, 2))
    assert banks[1].state().active == 2
    assert banks[1].state().next_generation == 3
    activate_all(previous)
    assert [bank.state().generation for bank in banks] == [1, 1]


def test_another_table_than_the_expected_one_is_told(banks: list[TableBank]) -> None:
    activations = _write_both(banks, 3)
    activate_all(activations)
    banks[0].confirm(1, activations[0].crc, 3)
    for number, crc, generation in ((2, activations[0].crc, 3), (1, 0xDEAD, 3), (1, activations[0].crc, 4)):
        with pytest.raises(TableError, match=rf"bank 1, .* is active instead of bank {number}, CRC {crc:08X}, .*"):
            banks[0].confirm(number, crc, generation)


def test_other_bytes_in_the_bank(rig: Rig, banks: list[TableBank]) -> None:
    store = rig.drives[1]._react

    def damage(key: tuple[int, int], value: bytes) -> None:
        store(key, value)
        if key == (0x2101, 1):
            rig.drives[1].objects[key] = value[:-1] + b"\0"

    rig.drives[1]._react = damage  # type: ignore[method-assign]
    with pytest.raises(TableError, match="other bytes"):
        banks[0].write_inactive(make_image())


def test_a_table_for_another_drive(banks: list[TableBank]) -> None:
    with pytest.raises(TableError, match="node 2"):
        banks[0].write_inactive(make_image(node_id=2))
    with pytest.raises(TableError, match="increments"):
        banks[0].write_inactive(make_image(metres_per_increment=1e-9))


def test_a_drive_that_finds_it_damaged(rig: Rig, banks: list[TableBank]) -> None:
    store = rig.drives[1]._react

    def object_to_it(key: tuple[int, int], value: bytes) -> None:
        store(key, value)
        rig.drives[1].objects[0x2101, 5] = b"\2"

    rig.drives[1]._react = object_to_it  # type: ignore[method-assign]
    with pytest.raises(TableError, match="damaged"):
        banks[0].write_inactive(make_image())


def test_a_refused_image(rig: Rig, banks: list[TableBank]) -> None:
    rig.drives[1].refuse[0x2101, 1] = 0x08000022
    with pytest.raises(SdoRefused, match="not in this state"):
        banks[0].write_inactive(make_image())


def test_all_or_none(rig: Rig, banks: list[TableBank]) -> None:
    activate_all(_write_both(banks, 1))
    second = _write_both(banks, 2)
    rig.drives[2].refuse[0x2100, 2] = 0x08000022
    with pytest.raises(TableError, match="restoring the previous table failed"):  # drive 2 refuses the way back as well
        activate_all(second)
    assert banks[0].state().generation == 1
    rig.drives[2].refuse.clear()
    rig.drives[2].objects[0x2102, 2] = b"abcd"
    with pytest.raises(TableError, match="expected CRC") as caught:
        activate_all(second)
    assert "restoring" not in str(caught.value)  # this time it went well
    assert [bank.state().generation for bank in banks] == [1, 1]


def test_mode_and_payload(rig: Rig, banks: list[TableBank]) -> None:
    banks[0].set_mode(CompensationMode.KEPT)
    assert banks[0].state().on
    banks[0].set_payload(199.9996)
    assert rig.drives[1].integer(0x2100, 7) == 200_000
    assert banks[0].state().payload_kg == pytest.approx(200.0)
    banks[0].set_payload(None)
    assert banks[0].state().payload_kg is None
    with pytest.raises(ValueError, match="payload"):
        banks[0].set_payload(-1.0)
    rig.drives[1].refuse[0x2100, 1] = 0x08000022
    with pytest.raises(SdoRefused, match="disable the drive"):
        banks[0].set_mode(CompensationMode.OFF)


@pytest.mark.parametrize("timeout_s", [0.0, 4e-4, 2.0**32 * 1e-3, -1.0, float("inf"), float("nan")])
def test_a_time_out_that_is_no_number_of_milliseconds_is_refused(banks: list[TableBank], timeout_s: float) -> None:
    with pytest.raises(ValueError, match="impossible time-out"):
        banks[0].set_trial_timeout(timeout_s)
