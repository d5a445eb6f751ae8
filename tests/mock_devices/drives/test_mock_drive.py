"""A drive on a bus, with canopen's RemoteNode as its master."""

from __future__ import annotations

import logging
import struct
import threading

import can
import canopen
import numpy as np
import pytest
from canopen.objectdictionary import eds

import mock_devices.drives.mock_drive
from mock_devices.drives.mock_drive import DriveServer, MockAxis
from tests.mock_devices.images import MACHINE_ID, image

logging.getLogger("canopen").setLevel(logging.ERROR)
EDS = mock_devices.drives.mock_drive.__file__.replace("mock_drive.py", "mock_drive.eds")
TPDOS = {0x181, 0x182, 0x281, 0x282}
TRAVEL_M = (0.32, 1.70)
START_M = 1.0


class Master:
    """A canopen master with two remote nodes; waits for frames by events, never by time."""

    def __init__(self, bus):
        self.frames = []
        self.arrived = threading.Condition()
        self.network = canopen.Network(bus)
        self.network.NOTIFIER_CYCLE = 0.05
        self.network.connect()
        self.nodes = {}
        for node_id in (1, 2):
            self.nodes[node_id] = self.network.add_node(canopen.RemoteNode(node_id, eds.import_eds(EDS, node_id)))
            self.nodes[node_id].sdo.RESPONSE_TIMEOUT = 5.0
        for cob_id in (0x81, 0x82, 0x181, 0x182, 0x281, 0x282, 0x701, 0x702):
            self.network.subscribe(cob_id, self._on_frame)

    def _on_frame(self, cob_id, data, _t):
        with self.arrived:
            self.frames.append((cob_id, bytes(data)))
            self.arrived.notify_all()

    def wait_for(self, cob_id, count=1):
        """Data of the next `count` frames of an id; forgets all that came."""
        with self.arrived:
            assert self.arrived.wait_for(lambda: sum(f[0] == cob_id for f in self.frames) >= count, timeout=10.0)
            frames = [data for name, data in self.frames if name == cob_id]
            self.frames.clear()
        return frames

    def sync(self, count=1):
        for _ in range(count):
            self.network.send_message(0x080, b"")
            with self.arrived:
                assert self.arrived.wait_for(lambda: {f[0] for f in self.frames} >= TPDOS, timeout=10.0)
                last = dict(self.frames)
                self.frames.clear()
        return last

    def start(self):
        self.network.send_message(0x000, bytes([1, 0]))

    def enable(self, node_id):
        for word in (0x06, 0x07, 0x0F):
            self.nodes[node_id].sdo[0x6040].raw = word
        assert self.nodes[node_id].sdo[0x6041].raw & 0x6F == 0x27

    def go(self, node_id, target):
        sdo = self.nodes[node_id].sdo
        sdo[0x607A].raw = target
        sdo[0x6040].raw = 0x3F
        acknowledged = bool(sdo[0x6041].raw & 0x1000)
        sdo[0x6040].raw = 0x0F
        return acknowledged


@pytest.fixture
def drives(bus_factory, clock):
    made = [
        DriveServer(
            node,
            MockAxis(name=name, partner_node_id=3 - node, machine_id=MACHINE_ID, travel_m=TRAVEL_M, start_m=START_M),
            bus_factory(),
            clock,
            load_kg=lambda: 75.0,
        )
        for node, name in ((1, "left"), (2, "right"))
    ]
    yield made
    for drive in made:
        drive.close()


@pytest.fixture
def master(bus_factory, drives):
    master = Master(bus_factory())
    yield master
    master.network.disconnect()


@pytest.fixture
def sdo(master):
    return master.nodes[1].sdo


def abort_code(call):
    with pytest.raises(canopen.SdoAbortedError) as abort:
        call()
    return abort.value.code


def test_identity_units_and_limits_are_those_of_the_documents(sdo, master):
    assert sdo[0x1000].raw == 0x00020192
    assert sdo[0x1008].raw == "PKM mock drive"
    assert [sdo[0x1018][i].raw for i in (1, 2, 4)] == [0x504B, 0x402, 0x53494D01]
    assert [sdo[0x608F][i].raw for i in (1, 2)] == [1_000_000, 1]
    assert [sdo[0x6091][i].raw for i in (1, 2)] == [1, 1]
    assert [sdo[0x6092][i].raw for i in (1, 2)] == [10_000, 1]
    assert [sdo[0x607D][i].raw for i in (1, 2)] == [32_000_000, 170_000_000]
    assert sdo[0x6502].raw == 0xA1  # profile position, homing and cyclic synchronous position
    assert master.nodes[2].sdo[0x1018][4].raw == 0x53494D02


def test_it_starts_switched_off_with_compensation_off_and_payload_unknown(sdo):
    assert sdo[0x6041].raw & 0x6F == 0x40
    assert sdo[0x2100][1].raw == 0
    assert sdo[0x2100][7].raw == 0xFFFFFFFF
    assert sdo[0x6064].raw == 100_000_000


def test_every_object_of_the_eds_can_be_read(sdo):
    for index, entry in sdo.items():
        subs = [0] if not hasattr(entry, "items") else [s for s in entry if s]
        for sub in subs:
            if (index, sub) in ((0x2101, 1), (0x2102, 1)):  # an empty bank has no data
                assert abort_code(lambda i=index: sdo.upload(i, 1)) == 0x08000024
            else:
                assert sdo.upload(index, sub) is not None


def test_a_move_by_sdo_and_where_the_plant_finds_the_drive(master, drives, clock):
    master.enable(1)
    assert master.go(1, 120_000_000)
    assert drives[0].is_moving(clock.now_s())
    assert not master.nodes[1].sdo[0x6041].raw & 0x0400
    assert master.nodes[1].sdo[0x6077].raw > 117  # a share of the weight through the screw, and more
    clock.sleep_s(5.0)
    assert master.nodes[1].sdo[0x6041].raw & 0x0400
    assert master.nodes[1].sdo[0x6063].raw == 120_000_000
    assert drives[0].encoder_m(clock.now_s()) == pytest.approx(1.2, abs=1e-12)
    assert drives[0].set_point(clock.now_s()).target_inc == 120_000_000


def test_refusals_carry_their_abort_codes(sdo, master):
    assert abort_code(lambda: setattr(sdo[0x607A], "raw", 170_000_001)) == 0x06090030
    assert abort_code(lambda: setattr(sdo[0x6060], "raw", 3)) == 0x06090030
    assert abort_code(lambda: setattr(sdo[0x2100][2], "raw", 1)) == 0x08000022
    assert abort_code(lambda: sdo.download(0x6041, 0, b"\0\0")) == 0x06010002
    assert abort_code(lambda: sdo.upload(0x5FFF, 0)) == 0x06020000
    assert abort_code(lambda: sdo.download(0x607A, 0, b"\0\0")) == 0x06070010
    master.enable(1)
    assert abort_code(lambda: setattr(sdo[0x2100][1], "raw", 1)) == 0x08000022


def test_a_table_is_written_read_back_and_activated(sdo):
    whole = image(np.arange(17 * 17).reshape(17, 17), generation=5, payload_g=200_000)
    sdo.download(0x2101, 1, whole)
    assert sdo.upload(0x2101, 1) == whole
    assert sdo[0x2101][2].raw == int.from_bytes(whole[-4:], "little")
    assert [sdo[0x2101][i].raw for i in (3, 4, 5)] == [5, 200_000, 1]
    sdo[0x2100][2].raw = 1
    sdo[0x2100][1].raw = 1
    assert [sdo[0x2100][i].raw for i in (3, 5, 6)] == [1, 5, 0]
    sdo[0x2100][7].raw = 200_000
    assert sdo[0x2100][6].raw == 1
    assert abort_code(lambda: sdo.download(0x2101, 1, whole)) == 0x08000022
    sdo.download(0x2102, 1, whole[:-9])
    assert sdo[0x2102][5].raw == 2


def test_a_sync_brings_both_tpdos_of_both_drives_once_operational(master):
    assert struct.unpack("<H", master.nodes[1].sdo.upload(0x6041, 0))[0] & 0x6F == 0x40
    master.start()
    last = master.sync()
    status, position, torque = struct.unpack("<Hih", last[0x181])
    assert (status & 0x6F, position, torque) == (0x40, 100_000_000, 0)
    assert struct.unpack("<ii", last[0x282]) == (100_000_000, 0)


def test_an_rpdo_controls_only_when_operational(master, sdo):
    master.network.send_message(0x201, struct.pack("<H", 0x06))
    assert sdo[0x6041].raw & 0x6F == 0x40
    master.start()
    master.network.send_message(0x201, struct.pack("<H", 0x06))
    assert sdo[0x6041].raw & 0x6F == 0x21
    master.network.send_message(0x201, b"\x07")
    assert struct.unpack_from("<H", master.wait_for(0x081)[0])[0] == 0x8210
    assert sdo[0x6041].raw & 0x6F == 0x21


def test_the_partners_command_arrives_by_pdo_at_the_next_sync_and_corrects_the_motion(master, drives, clock):
    corrections = np.add.outer(1000 * np.arange(17), 300 * np.arange(17))
    for node_id in (1, 2):
        sdo = master.nodes[node_id].sdo
        sdo.download(0x2101, 1, image(corrections, node=node_id))
        sdo[0x2100][7].raw = 0
        sdo[0x2100][2].raw = 1
        sdo[0x2100][1].raw = 1
        master.enable(node_id)
    assert not master.go(1, 110_000_000)
    assert struct.unpack_from("<H", master.wait_for(0x081)[0])[0] == 0xFF10
    master.start()
    master.sync(3)
    assert master.nodes[1].sdo[0x2100][8].raw == pytest.approx(100_000_000, abs=20_000)
    for node_id, target in ((1, 110_000_000), (2, 130_000_000)):
        assert master.go(node_id, target)
    for _ in range(20):
        clock.sleep_s(0.2)
        master.sync()
    for drive, own, partner in ((drives[0], 110_000_000, 130_000_000), (drives[1], 130_000_000, 110_000_000)):
        expected = own + 1000 * (own - 32e6) / 8.625e6 + 300 * (partner - 32e6) / 8.625e6
        assert drive.encoder_m(clock.now_s()) == pytest.approx(expected * 1e-8, abs=1e-12)
        assert drive.axis.actual_inc() == pytest.approx(own, abs=1e-3)


def test_a_tpdo_of_transmission_type_three_comes_with_every_third_sync(master, sdo):
    sdo[0x1800][1].raw = 0x80000181
    sdo[0x1800][2].raw = 3
    sdo[0x1800][1].raw = 0x181
    master.start()
    for _ in range(6):
        master.network.send_message(0x080, b"")
    with master.arrived:  # a drive sends its second TPDO, of type 1, after its first
        assert master.arrived.wait_for(lambda: sum(f[0] == 0x281 for f in master.frames) == 6, timeout=10.0)
        assert sum(f[0] == 0x181 for f in master.frames) == 2


def test_a_changed_mapping_is_honoured(master, sdo):
    sdo[0x1800][1].raw = 0x80000181
    sdo[0x1A00][0].raw = 0
    sdo[0x1A00][1].raw = 0x60410010
    sdo[0x1A00][0].raw = 1
    sdo[0x1800][1].raw = 0x181
    master.start()
    assert len(master.sync()[0x181]) == 2
    sdo[0x1400][1].raw = 0x301
    master.network.send_message(0x301, struct.pack("<H", 0x06))
    assert sdo[0x6041].raw & 0x6F == 0x21


def test_heartbeats_beat_in_rig_time(master, sdo, clock):
    sdo[0x1017].raw = 500
    master.frames.clear()
    clock.sleep_s(10.2)
    assert master.wait_for(0x701, 20) == [b"\x7f"] * 20
    sdo[0x1017].raw = 0
    clock.sleep_s(5.0)
    assert not [f for f in master.frames if f[0] == 0x701]


def test_a_reset_boots_again_and_keeps_the_banks(master, sdo):
    whole = image(np.zeros((3, 3)))
    sdo.download(0x2101, 1, whole)
    sdo[0x2100][7].raw = 0
    master.enable(1)
    master.frames.clear()
    master.network.send_message(0x000, bytes([129, 1]))
    assert master.wait_for(0x701) == [b"\x00"]
    assert sdo[0x6041].raw & 0x6F == 0x40
    assert sdo[0x2100][7].raw == 0xFFFFFFFF
    assert sdo[0x2101][5].raw == 1


def test_a_stopped_node_answers_no_sdo_and_a_stop_in_motion_is_a_quick_stop(master, drives, clock):
    master.start()
    master.enable(1)
    master.go(1, 150_000_000)
    clock.sleep_s(1.0)
    master.network.send_message(0x000, bytes([2, 1]))
    master.nodes[1].sdo.RESPONSE_TIMEOUT = 0.1
    with pytest.raises(canopen.SdoCommunicationError):
        master.nodes[1].sdo.upload(0x6041, 0)
    assert drives[0].axis.state.name == "QUICK_STOP_ACTIVE"


def test_a_fault_is_told_by_emcy_and_the_error_objects(master, drives, sdo):
    drives[0].inject_fault(0x2310)
    assert struct.unpack_from("<HB", master.wait_for(0x081)[0]) == (0x2310, 1)
    assert sdo[0x603F].raw == 0x2310
    assert sdo[0x1001].raw == 1
    sdo[0x6040].raw = 0x80
    assert struct.unpack_from("<HB", master.wait_for(0x081)[0]) == (0, 0)


def test_closing_twice_is_once(bus_factory, clock):
    drive = DriveServer(
        5,
        MockAxis(name="x", partner_node_id=6, machine_id=MACHINE_ID, travel_m=TRAVEL_M, start_m=1.0),
        bus_factory(),
        clock,
    )
    drive.close()
    drive.close()


def test_foreign_frames_are_ignored(master, sdo):
    for frame in (
        can.Message(arbitration_id=0x601, data=b"\x40", is_extended_id=False),
        can.Message(arbitration_id=0x000, data=b"\x01", is_extended_id=False),
        can.Message(arbitration_id=0x123, data=b"abc", is_extended_id=False),
    ):
        master.network.bus.send(frame)
    assert sdo[0x6041].raw & 0x6F == 0x40
