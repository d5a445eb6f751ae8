"""A host that dies at any write to a drive or to the store: the next one ends what it left, on all drives alike."""

from __future__ import annotations

import shutil
from dataclasses import replace
from itertools import pairwise

import pytest

from drivers.errors import DriveFault, TableError
from pkm_rig.errors import StoreError
from pkm_rig.rig.rig_checks import check_rig
from pkm_rig.rig.runner import describe_campaign
from pkm_rig.rig.table_change import VERDICT, begin, changes_of, changing_tables, switch_off
from pkm_rig.rig.table_recovery import settle_tables, unfinished_change
from pkm_rig.store.append import now_text
from tests.pkm_rig.tables_bench import CAMPAIGN, FORMER, images, table, tables_bench

FIRST, SECOND = 8, 9  # generations that a verification tries, with two payloads


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """A mock rig, and a store with a campaign in it."""
    with tables_bench(tmp_path_factory.mktemp("tables")) as made:
        with made.host() as (rig, store, _):
            store.add_campaign(describe_campaign(rig, CAMPAIGN, now_text()), rig.machine.text)
            made.former = images(rig, FORMER)
        yield made, made.world(tmp_path_factory.mktemp("kept") / "store")


@pytest.fixture
def bench(running, tmp_path):
    """The rig with a fresh copy of that store."""
    bench, world = running
    bench.path = tmp_path / world.store.name
    shutil.copy(world.store, bench.path)
    return bench


def verify_once(rig, store, verdict):
    """What a verification does to drives and store, without its measurements: two payloads, so both banks."""
    with changing_tables(rig, store, "verify", CAMPAIGN) as change:
        for generation in (FIRST, SECOND):
            rig.compensate(None)
            change.compensate(rig.images(table(generation * 1e-6), generation))
        change.require_in_use()
        store.add_event(CAMPAIGN, verdict, {VERDICT: change.id})
        if verdict == "accepted":
            change.keep()
        else:
            change.bring_to_target()


def worlds_of(bench, folder, act, last=0):
    """All different worlds that a host leaves which dies before one of its writes while it does `act`."""
    worlds, store_writes = {}, []

    def seen():
        key = (bench.drives(), len(store_writes))
        if key not in worlds:
            worlds[key] = bench.world(folder / f"{len(worlds)}")

    with bench.host(last, seen) as (rig, store, _):
        add, event = store.add_table_change, store.add_event
        store.add_table_change = lambda **step: (add(**step), store_writes.append(step))[0]
        store.add_event = lambda *what: (event(*what), store_writes.append(what))[0]
        act(rig, store)
        seen()
    return list(worlds.values())


def recover(bench, last=0):
    """Connect again, dying once more at a write; what was said, or None if it died."""
    said = []
    with bench.host(last) as (rig, store, _):
        settle_tables(rig, store, said.append)
        assert unfinished_change(rig, store) is None
        assert check_rig(rig) == []
        return said
    return None


def require_settled(bench, former, *, accepted):
    """One generation on all drives, none on trial, and the one that the stored verdict asks for."""
    expected = SECOND if accepted else FORMER if former else 0
    assert bench.used() == [expected, expected]
    assert set(bench.modes()) == ({1} if expected else {0})
    if former and not accepted:
        assert [c.banks[c.active_bank].image for c in bench.compensations] == former


def recover_world(bench, world, former):
    bench.restore(world)
    with bench.host() as (rig, store, _):
        settle_tables(rig, store, lambda _line: None)
        assert unfinished_change(rig, store) is None
        assert check_rig(rig) == []
        accepted = bool(store.events(CAMPAIGN, "accepted"))
    require_settled(bench, former, accepted=accepted)
    return accepted


def with_modes(world, change):
    """The same world after its drives have changed their mode words by themselves."""
    return replace(world, drives=tuple((change(mode), *rest) for mode, *rest in world.drives))


@pytest.mark.parametrize(("used_before", "verdict"), [(True, "accepted"), (True, "refused"), (False, "accepted")])
def test_killed_at_any_write_a_verification_is_finished_or_undone(bench, tmp_path, used_before, verdict):
    former = bench.former if used_before else None
    bench.reset(former)
    worlds = worlds_of(bench, tmp_path, lambda rig, store: verify_once(rig, store, verdict))
    assert len(worlds) > 20
    ends = [recover_world(bench, world, former) for world in worlds]
    assert ends == sorted(ends)  # undone before the verdict, finished from then on
    assert ends.count(True) == (4 if verdict == "accepted" else 0)  # before, between and after the mode words, the end


@pytest.mark.parametrize("event", ["trials end", "drives restart", "one drive restarts"])
def test_what_the_drives_do_meanwhile_changes_nothing(bench, tmp_path, event):
    bench.reset(bench.former)
    worlds = worlds_of(bench, tmp_path, lambda rig, store: verify_once(rig, store, "accepted"))
    begun = next(i for i, world in enumerate(worlds) if world.drives != worlds[0].drives)
    for world in worlds[begun:-1:2]:
        if event == "one drive restarts":
            (_, *rest), other = world.drives
            changed = replace(world, drives=((0, *rest), other))
        else:
            changed = with_modes(world, lambda mode: 0 if event == "drives restart" or mode == 2 else mode)
        recover_world(bench, changed, bench.former)


def test_a_bank_that_was_being_written_is_written_anew(bench, tmp_path):
    bench.reset(bench.former)
    worlds = worlds_of(bench, tmp_path, lambda rig, store: verify_once(rig, store, "accepted"))
    places = [(drive, bank) for drive in (0, 1) for bank in (2, 3)]
    torn = 0
    for before, after in pairwise(worlds):
        for drive, bank in places:
            if before.drives[drive][bank] != after.drives[drive][bank]:
                drives = [list(contents) for contents in before.drives]
                drives[drive][bank] = after.drives[drive][bank][:-17]
                recover_world(bench, replace(before, drives=tuple(map(tuple, drives))), bench.former)
                torn += 1
    assert torn == 4


@pytest.mark.parametrize("verdict", ["accepted", "refused"])
def test_a_recovery_that_is_killed_at_any_write_is_repeated(bench, tmp_path, verdict):
    bench.reset(bench.former)
    worlds = worlds_of(bench, tmp_path / "verify", lambda rig, store: verify_once(rig, store, verdict))
    for number in (len(worlds) // 3, -3):
        bench.restore(worlds[number])
        again = worlds_of(
            bench, tmp_path / f"recovery {number}", lambda rig, store: settle_tables(rig, store, lambda _line: None)
        )
        assert len(again) > 2
        assert len({recover_world(bench, world, bench.former) for world in again}) == 1


@pytest.mark.parametrize("last", [1, 9, 33, 77, 108, 121])
def test_a_host_that_is_really_gone(bench, last):
    """Not only the world before a write: its threads and sockets end too, and its last words are lost."""
    bench.reset(bench.former)
    with bench.host(last) as (rig, store, life):
        verify_once(rig, store, "refused")
    assert life.dead
    if last % 2:
        bench.mock.clock.sleep_s(200.0)
        assert 2 not in bench.modes()
    recover(bench, last % 7)
    assert recover(bench) is not None
    require_settled(bench, bench.former, accepted=False)


def test_what_was_found_is_said_once(bench):
    bench.reset(bench.former)
    with bench.host(60) as (rig, store, _):
        verify_once(rig, store, "refused")
    (line,) = recover(bench)
    assert line == (
        f"an unfinished change of the tables of campaign {CAMPAIGN} was found and undone; "
        "tables: generation 3 on all drives"
    )
    assert recover(bench) == []


def test_without_its_store_a_half_active_machine_is_named_and_switched_off(bench):
    bench.reset(bench.former)
    bench.compensations[0].mode = 0
    said = []
    with bench.host() as (rig, _, _life):
        (problem,) = check_rig(rig)
        assert "half active (left off, right generation 3)" in problem
        settle_tables(rig, None, said.append)
        assert check_rig(rig) == []
    assert said == ["the tables are half active (left off, right generation 3); compensation is now off on all drives"]
    assert bench.modes() == [0, 0]


def test_other_generations_or_a_trial_that_nobody_verifies_are_doubts_too(bench):
    bench.reset(bench.former)
    with bench.host() as (rig, _, _life):
        bench.compensations[1].banks[1].write(images(rig, 4)[1])
        assert "half active (left generation 3, right generation 4)" in check_rig(rig)[0]
        bench.reset(bench.former)
        rig.compensate(rig.images(table(), 5))
        assert "never verified" in check_rig(rig)[0]
        said = []
        settle_tables(rig, None, said.append)
        assert "never verified" in said[0]
    assert bench.modes() == [0, 0]


def unfinished(bench, last=30):
    bench.reset(bench.former)
    with bench.host(last) as (rig, store, _):
        verify_once(rig, store, "refused")


def test_tables_that_were_written_since_with_another_store_are_left_alone(bench):
    unfinished(bench)
    with bench.host() as (rig, _, _life):
        rig.bring_tables_to(images(rig, 12), on=True)
    (line,) = recover(bench)
    assert "given up: other tables were written to drive left since" in line
    assert bench.used() == [12, 12]
    assert recover(bench) == []


def test_another_drive_is_not_given_the_tables_of_the_one_before(bench):
    unfinished(bench, last=2)
    node = bench.mock.mock.drives[1]._node
    serial = node.data_store[0x1018][4]
    node.data_store[0x1018][4] = (77).to_bytes(4, "little")
    try:
        (line, *_) = recover(bench)
    finally:
        node.data_store[0x1018][4] = serial
    assert "given up: drive right has another serial number" in line


def try_tables(rig, store, then=lambda _change: None):
    with changing_tables(rig, store, "verify", CAMPAIGN) as change:
        change.compensate(rig.images(table(), 6))
        then(change)


def fill(store):
    while True:
        store.add_table_change(
            rig="other", machine="m", campaign=None, change="c", kind="filling", data={"text": "x" * 300}
        )


def test_a_store_that_cannot_be_written_prevents_the_change(bench):
    bench.reset(bench.former)
    with bench.host() as (rig, store, _):
        store.limit_pages(1)
        with pytest.raises(StoreError):
            fill(store)
        with pytest.raises(StoreError):
            try_tables(rig, store)
    assert bench.used() == [FORMER, FORMER]
    assert bench.modes() == [1, 1]
    assert [c.banks[2].image for c in bench.compensations] == [b"", b""]


def interrupt(_change):
    raise KeyboardInterrupt


def test_an_error_says_which_tables_are_active(bench):
    bench.reset(bench.former)
    with bench.host() as (rig, store, _):
        with pytest.raises(KeyboardInterrupt) as ended:
            try_tables(rig, store, interrupt)
        assert ended.value.__notes__ == ["tables: generation 3 on all drives"]
        assert unfinished_change(rig, store) is None
        rig.bring_tables_to([None, None], on=False)
        with pytest.raises(KeyboardInterrupt) as ended:
            try_tables(rig, store, interrupt)
        assert ended.value.__notes__ == ["tables: off on all drives"]


def test_an_error_says_that_the_drives_could_not_be_reached(bench):
    bench.reset(bench.former)
    with bench.host() as (rig, store, _):

        def cut(change):
            rig.drives.line.mark_lost(OSError("cut"))
            interrupt(change)

        with pytest.raises(KeyboardInterrupt) as ended:
            try_tables(rig, store, cut)
        assert "unknown: CAN line could not be reached; `pkm-rig tables show` tells" in ended.value.__notes__[0]
        assert unfinished_change(rig, store) is not None
    assert recover(bench) is not None
    assert bench.used() == [FORMER, FORMER]


def test_while_one_drive_is_silent_the_others_use_no_table_and_nobody_waits_long(bench):
    bench.reset(bench.former)
    with bench.host(guard_s=1.0) as (rig, store, _):
        bus = rig.drives.line.network.bus

        def silence(change):
            bus.unheard = 2
            interrupt(change)

        with pytest.raises(KeyboardInterrupt) as ended:
            try_tables(rig, store, silence)
        assert "unknown: right could not be reached" in ended.value.__notes__[0]
        assert bus.lost <= 8  # of which each costs a time-out
        assert unfinished_change(rig, store) is not None
        bus.unheard = 0
    assert bench.compensations[0].mode == 0
    assert recover(bench) is not None
    assert bench.used() == [FORMER, FORMER]


def test_tables_that_are_not_in_use_any_more_get_no_verdict(bench):
    bench.reset(bench.former)

    def fall_back(change):
        bench.compensations[1].mode = 0
        change.require_in_use()

    with bench.host() as (rig, store, _), pytest.raises(TableError, match=r"right.*not in use any more"):
        try_tables(rig, store, fall_back)
    assert bench.used() == [FORMER, FORMER]


def test_a_drive_that_restarts_during_a_change_stops_all_and_is_named(bench):
    bench.reset(bench.former)
    with bench.host() as (rig, store, _):

        def restart(_change):
            bench.mock.mock.drives[1].power_cycle()
            rig.wait(5.0)

        with pytest.raises(DriveFault, match=r"right.*has restarted, its compensation is off") as ended:
            try_tables(rig, store, restart)
        assert ended.value.__notes__ == ["tables: generation 3 on all drives"]


def test_tables_that_were_switched_off_are_recorded_with_what_was_before(bench):
    bench.reset(bench.former)
    with bench.host() as (rig, store, _):
        switch_off(rig, store, "off")
        change = changes_of(rig, store)[-1]
        assert change.end == "done"
        assert [record["generation"] for record in change.former] == [FORMER, FORMER]
    assert bench.modes() == [0, 0]
    assert [c.active_bank for c in bench.compensations] == [1, 1]


def test_an_image_is_stored_with_every_bit_of_it(bench):
    bench.reset(bench.former)
    with bench.host() as (rig, store, _):
        change = begin(rig, store, "off")
        stored = changes_of(rig, store)[-1]
        assert stored.id == change.id
        assert [stored.target.images[name] for name in ("left", "right")] == bench.former
        assert stored.target.on
        stored.give_up("a test")
