"""A mock rig that is killed and started again with the same state file comes back as hardware would."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_devices.commands import execute
from mock_devices.drives.cia402 import State
from mock_devices.lasting_state import LastingStateError, RigState, StateFile, read_state
from mock_devices.rig import MockPorts, MockRig
from mock_devices.settings import MockSettings
from tests.mock_devices.images import image as make_image

UTC_S = 1.7e9


@pytest.fixture
def start(machine_path, clock, bus_factory, tmp_path):
    """Start a rig from the state file; the one before is left as a kill leaves it: nothing is written any more."""
    running: list[MockRig] = []

    def begin(**settings):
        for rig in running:
            rig._state_file = None
            rig.plant.changed = lambda: None
            rig.close()
        path = tmp_path / "state.json"
        state = read_state(path) or RigState(machine="planar4", seed=5)
        file = StateFile(path, state, clock, lambda: UTC_S + clock.now_s())
        ports = MockPorts(socketcand_port=0)
        rig = MockRig(machine_path, MockSettings(seed=5, **settings), clock, bus_factory, ports=ports, state_file=file)
        running.append(rig)
        return rig

    yield begin
    running[-1].close()


def write(drive, index, sub, data):
    entry = drive._node.object_dictionary[index]
    drive._write(index=index, subindex=sub, od=entry[sub] if sub else entry, data=data)


def switch_on(drive):
    for word in (0x06, 0x07, 0x0F):
        write(drive, 0x6040, 0, word.to_bytes(2, "little"))


def test_tables_stay_in_their_banks_and_compensation_is_off(start):
    rig = start()
    images = {}
    for drive in rig.drives:
        images[drive.node_id] = make_image(np.full((3, 3), 900), node=drive.node_id, generation=7)
        write(drive, 0x2102, 1, images[drive.node_id])
        write(drive, 0x2100, 2, b"\x02")
        write(drive, 0x2100, 1, b"\x01")
        assert drive.compensation.mode == 1
    write(rig.drives[0], 0x6081, 0, (1_234_567).to_bytes(4, "little"))
    again = start()
    for drive in again.drives:
        assert drive.compensation.banks[2].image == images[drive.node_id]
        assert drive.compensation.banks[1].image == b""
        assert drive.compensation.active_bank == 2
        assert drive.compensation.table.generation == 7
        assert drive.compensation.mode == 0
        assert drive.axis.state is State.SWITCH_ON_DISABLED
    assert [drive.axis.limits.speed for drive in again.drives] == [1_234_567, 20_000_000]


def test_a_table_is_in_the_file_before_the_master_has_its_answer(start, tmp_path):
    rig = start()
    image = make_image(np.full((3, 3), 900), node=1, generation=3)
    write(rig.drives[0], 0x2101, 1, image)
    assert bytes.fromhex(read_state(tmp_path / "state.json").drives[1].images[0]) == image


@pytest.mark.parametrize("absolute", [True, False])
def test_the_axes_stand_where_they_were_and_only_incremental_encoders_lose_their_reference(start, clock, absolute):
    rig = start(absolute_encoders=absolute)
    drive = rig.drives[0]
    if not absolute:  # homed
        drive.axis.motion.recount(clock.now_s(), 1.118033988749895e8)
        drive.axis.homing.referenced = True
    switch_on(drive)
    target = 111_803_399 + 5_000_000
    write(drive, 0x607A, 0, target.to_bytes(4, "little", signed=True))
    write(drive, 0x6040, 0, (0x3F).to_bytes(2, "little"))
    clock.sleep_s(10.0)
    before = [d.encoder_m(clock.now_s()) for d in rig.drives]
    rig.keep_state()
    again = start(absolute_encoders=absolute)
    assert [d.encoder_m(clock.now_s()) for d in again.drives] == pytest.approx(before, abs=1e-12)
    assert before[0] == pytest.approx(1.118033988749895 + 0.05, abs=1e-7)
    assert [d.axis.homing.referenced for d in again.drives] == [absolute, absolute]
    counts = [d.axis.encoder_inc(clock.now_s()) for d in again.drives]
    assert counts == (pytest.approx([b * 1e8 for b in before], abs=1e-3) if absolute else [0.0, 0.0])


def test_payload_noise_and_station_go_on(start, clock):
    rig = start()
    rig.plant.put_on(2)
    place = rig.plant.view.drift_free((0.1, 0.2, 0.3))
    assert execute(rig, "station move 0.4 -0.05 0.2 0.3").startswith("the station stands")
    moved = rig.plant.view.drift_free((0.1, 0.2, 0.3))
    first = rig.plant.reading_noise(0, clock.now_s())
    request = b"2024,1:0.0344"
    assert rig._station.respond(b"%R1Q," + request) == b"%R1P,0,1:0\r\n"
    rig.keep_state()
    again = start()
    assert again.plant.payload == 2
    np.testing.assert_allclose(again.plant.view.drift_free((0.1, 0.2, 0.3)), moved, atol=1e-12)
    assert np.linalg.norm(moved - place) > 0.1
    assert again.plant.reading_noise(0, clock.now_s()) != first, "the same visit must not be made twice"
    assert again._station.respond(b"%R1Q,2023,1:") == b"%R1P,0,1:0,0.0344\r\n"


def test_the_air_of_a_station_that_came_back_can_be_set_anew(start):
    def air_after(rig, pressure_hpa):
        set_air = b"%%R1Q,2028,1:6.58E-07,%d,21.5,13.5" % pressure_hpa
        assert rig._station.respond(set_air) == b"%R1P,0,1:0\r\n"
        return rig._station.respond(b"%R1Q,2029,1:")

    rig = start()
    assert air_after(rig, 1008) == b"%R1P,0,1:0,0.0000,1008.0000,21.5000,13.5000\r\n"
    rig.keep_state()
    again = start()
    assert again._station.respond(b"%R1Q,2029,1:") == b"%R1P,0,1:0,0.0000,1008.0000,21.5000,13.5000\r\n"
    assert air_after(again, 990) == b"%R1P,0,1:0,0.0000,990.0000,21.5000,13.5000\r\n"


def test_a_station_is_moved_by_what_the_operator_said(start):
    """A point that moved and turned with the station is seen where the point was before."""
    rig = start()
    view = rig.plant.view
    station = -view.rotation.T @ view.translation_m
    before = view.drift_free((0.3, 0.5, -0.2))
    execute(rig, "station move 0.4 -0.05 0.2 0.3")
    away = np.array([0.3, 0.5, -0.2]) - station
    c, s = math.cos(0.3), math.sin(0.3)  # clockwise seen from above (+y): x towards +z
    turned = np.array([c * away[0] - s * away[2], away[1], s * away[0] + c * away[2]])
    after = view.drift_free(tuple(station + np.array([0.4, -0.05, 0.2]) + turned))
    np.testing.assert_allclose(after, before, atol=3e-4)  # the station is level to 20 urad only


def test_rig_time_goes_on_with_the_worlds_and_never_back():
    state = RigState(machine="m", seed=1, t_rig_s=1000.0, t_utc_s=UTC_S)
    assert state.time_now_s(UTC_S + 10.0, 40.0) == 1400.0
    assert state.time_now_s(UTC_S - 10.0, 40.0) == 1000.0


def test_a_drive_alone_is_restarted_and_a_device_falls_silent(start):
    rig = start()
    rig.drives[1].compensation.mode = 1
    assert execute(rig, "drive restart right") == "drive right was switched off and on"
    assert rig.drives[1].compensation.mode == 0
    assert json.loads(execute(rig, "status"))["drives"]["right"] == {
        "moving": False, "powered": False, "referenced": True, "compensation": 0, "generation": 0, "crc": 0,
        "machine": "", "serial": 0x53494D02,
    }  # fmt: skip
    for device, flag in (
        ("plc", lambda: rig.plc.silent),
        ("station", lambda: rig.station_server.silent),
        ("can", lambda: rig.socketcand.silent),
    ):
        assert execute(rig, f"silent {device}") == f"{device} is silent"
        assert flag()
        assert execute(rig, "silent none") == "all answer"
        assert not flag()
    assert execute(rig, "fault drive-heartbeat@1") == "armed: drive-heartbeat@1, counted from now on"
    assert execute(rig, "fault none") == "no fault strikes any more"


def test_another_drive_in_its_place_has_another_serial_number_and_no_tables(start, clock):
    rig = start()
    rig.drives[0].compensation.write_bank(1, make_image(np.zeros((2, 2))))
    rig.drives[0].compensation.active_bank = 1
    told = json.loads(execute(rig, "status"))["drives"]["left"]
    assert told["crc"] == rig.drives[0].compensation.banks[1].crc != 0
    assert told["machine"] == rig.drives[0].compensation.table.machine_id.hex()
    stood, count = rig.drives[0].encoder_m(clock.now_s()), rig.drives[0].axis.encoder_inc(clock.now_s())
    assert "serial number 1397312785" in execute(rig, "drive replace left 2e-4")
    for _ in range(2):
        assert rig.drives[0]._node.get_data(0x1018, 4) == (0x53494D11).to_bytes(4, "little")
        assert rig.drives[0].compensation.table is None
        assert [bank.image for bank in rig.drives[0].compensation.banks.values()] == [b"", b""]
        assert rig.drives[0].encoder_m(clock.now_s()) == pytest.approx(stood, abs=1e-12)
        assert rig.drives[0].axis.encoder_inc(clock.now_s()) == pytest.approx(count + 2e4)
        assert rig.drives[1].serial == 0x53494D02
        rig = start()
    execute(rig, "drive recount right -1e-4")
    assert rig.drives[1].axis.true_position_inc(clock.now_s()) - rig.drives[1].axis.encoder_inc(clock.now_s()) == (
        pytest.approx(1e4)
    )


def test_a_knocked_column_leans_for_good(start, clock):
    def tool(rig):
        return np.array([s.polar.distance_m for s in rig.plant.sightings(clock.now_s())])

    rig = start()
    before, same = tool(rig), tool(rig)
    np.testing.assert_array_equal(before, same)
    assert "leans by 0.0002 rad" in execute(rig, "column knock left 2e-4 1e-5")
    after = tool(rig)
    assert 1e-6 < np.max(np.abs(after - before)) < 1e-3
    np.testing.assert_allclose(tool(start()), after, atol=1e-12)


WRONG_LINES = (
    "jump", "", "station move 1 2", "station move a b c", "station move nan 0 0", "station move 1e3 0 0",
    "drive replace", "drive replace up", "drive replace left x", "drive replace left 1", "drive recount left",
    "drive recount left nan", "column knock left", "column knock up 1e-4", "column knock left 0 0 0",
    "drive restart", "drive restart up", "silent", "silent all", "fault", "fault x", "fault x@1", "status now",
)  # fmt: skip


def test_a_line_that_cannot_be_carried_out_says_what_can(start):
    rig = start()
    before = rig.plant.view.translation_m.copy()
    for line in WRONG_LINES:
        with pytest.raises(ValueError, match=r"\S") as caught:
            execute(rig, line)
        assert "\n" not in str(caught.value)
    np.testing.assert_array_equal(rig.plant.view.translation_m, before)


def test_a_write_that_is_cut_short_leaves_the_state_of_before(start, tmp_path, monkeypatch):
    rig = start()
    path = tmp_path / "state.json"
    before = path.read_bytes()

    def cut(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("mock_devices.lasting_state.os.fsync", cut)
    rig.plant.put_on(1)
    assert path.read_bytes() == before
    monkeypatch.undo()
    rig.keep_state()
    assert read_state(path).plant.payload == 1


KEYS = st.sampled_from(["format", "machine", "seed", "t_rig_s", "drives", "1", "count_inc", "images", "plant"])
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=8,
)
STATES = st.fixed_dictionaries({"machine": st.just("m"), "seed": st.integers()}, optional={"t_rig_s": VALUES})


@given(st.binary(max_size=200) | (VALUES | STATES).map(lambda value: json.dumps(value).encode()))
def test_no_file_is_more_than_a_refusal_in_one_line(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("state") / "state.json"
    path.write_bytes(data)
    read, refused = None, ""
    try:
        read = read_state(path)
    except LastingStateError as error:
        refused = str(error)
    if read is None:
        assert str(path) in refused
        assert "\n" not in refused
    else:
        assert math.isfinite(read.t_rig_s)


def test_a_state_is_written_and_read_without_loss(tmp_path, clock):
    path = tmp_path / "state.json"
    assert read_state(path) is None
    with pytest.raises(LastingStateError, match="not a state file"):
        read_state(tmp_path)
    file = StateFile(path, RigState(machine="m", seed=3), clock, lambda: UTC_S)
    clock.sleep_s(12.5)
    file.write()
    assert read_state(path) == file.state
    assert (file.state.t_rig_s, file.state.t_utc_s) == (12.5, UTC_S)
