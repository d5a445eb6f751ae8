from __future__ import annotations

import pytest

from calibration.base.errors import InputError
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.plc_connection import plc_line, register_map


@pytest.fixture
def text():
    """The embedded rig's, with the default map of the PLC."""
    before, rest = embedded_rig_path().read_text(encoding="utf-8").split("[plc.registers]\n")
    return before + rest[rest.index("[[payloads]]") :]


def load(tmp_path, text):
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return load_rig(path)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("[can]", "[can]\nbaud = 5", "unknown key 'can.baud'"),
        ('[[payloads]]\nname = "none"', '[[payloads]]\nnam = "none"', "unknown key 'payloads.0.nam'"),
        ("node_id = 1", "node_id = 300", "drives.0.node_id"),
        ("node_id = 1", "node_id = 2", "same node_id"),
        ('name = "left"', 'name = "north"', "do not match the machine's"),
        ('machine = "planar4"', 'machine = "planar5"', "known: .*planar4"),
        ('machine = "planar4"', 'machine = "missing.toml"', "check the path"),
        ('nests = ["N1", "N2"]', 'nests = ["N1", "P1"]', "not a floor nest"),
        ('nests = ["N1", "N2"]', 'nests = ["N1", "N9"]', "no SMR 'N9'"),
        ("angle_sd_rad = 2.4e-6", "angle_sd_rad = nan", "angle_sd_rad"),
        ("angle_sd_rad = 2.4e-6", "angle_sd_rad = -1.0", "angle_sd_rad"),
        ("[nuisance]", "[campaign]\nloaded_payload = 7\n[nuisance]", "payload 7"),
        ("[nuisance]", "[campaign]\nverification_poses = 10\n[nuisance]", "verification_poses"),
        ("[nuisance]", "[campaign.accept_below_m]\n2 = 3e-5\n[nuisance]", "payload 2 is not in verification_payloads"),
        ("[nuisance]", "[campaign.accept_below_m]\n0 = 0.0\n[nuisance]", "accept_below_m.0"),
        ("[nuisance]", "[campaign.accept_below_m]\nnone = 1.0\n[nuisance]", "accept_below_m.none"),
        ("mass_kg = 0.0", "mass_kg = 1.0", "first one must be no payload"),
        ('rig = "embedded-mock"', 'rig = "embedded-mock', "not TOML"),
    ],
)
def test_bad_rig_files_are_one_clear_line(tmp_path, text, old, new, complaint):
    assert old in text
    with pytest.raises(InputError, match=complaint) as caught:
        load(tmp_path, text.replace(old, new, 1))
    assert "\n" not in str(caught.value)
    assert "rig.toml" in str(caught.value) or "machine" in str(caught.value) or "missing.toml" in str(caught.value)


def test_the_example_is_fit(request):
    file, machine = load_rig(request.config.rootpath / "examples" / "mock-rig.toml")
    assert file.time_scale == 40.0
    assert machine.name == "planar4"


def test_registers_can_be_moved_and_unknown_ones_are_named(tmp_path, text):
    file, _ = load(tmp_path, text.replace("port = 0", "port = 0\nregisters = { payload = 40, air_temperature_c = 20 }"))
    registers = register_map(file.plc)
    assert registers.payload == 40
    assert registers.temperatures_c["air"].address == 20
    file, _ = load(tmp_path, text.replace("port = 0", "port = 0\nregisters = { wind = 40 }"))
    with pytest.raises(InputError, match="wind"):
        register_map(file.plc)


def test_registers_may_have_another_type_order_unit_and_range(tmp_path, text):
    entry = (
        'registers.air_temperature_c = { address = 20, type = "i16", scale = 0.1, unit = "K", low = 0, stale_s = 60 }\n'
        'without = ["master_seen"]\ninterlocks = { "guard closed" = 5 }'
    )
    file, _ = load(tmp_path, text.replace("port = 0", f"port = 0\n{entry}"))
    registers = register_map(file.plc)
    air = registers.temperatures_c["air"]
    assert (air.type, air.unit, air.low, air.high, air.stale_s) == ("i16", "K", 0.0, 60.0, 60.0)
    assert air.value([2940]) == pytest.approx(20.85)
    assert registers.master_seen is None
    assert registers.interlock_bits == {"guard closed": 5}
    file, _ = load(tmp_path, text.replace("port = 0", "port = 0\nregisters.heartbeat = { address = 1, scale = 2 }"))
    with pytest.raises(InputError, match="whole word"):
        register_map(file.plc)


def test_the_line_to_the_plc(tmp_path, text):
    file, _ = load(tmp_path, text.replace("port = 0", 'transport = "rtu"\nserial_port = "/dev/ttyS9"\nparity = "N"'))
    assert str(plc_line(file.plc, tmp_path / "rig.toml")) == "/dev/ttyS9 (RTU, 115200 Bd, 8N1)"
    file, _ = load(tmp_path, text.replace("port = 0", 'port = 802\ntransport = "tls"\nca_file = "ca.pem"'))
    with pytest.raises(InputError, match=r"no file .*ca\.pem"):
        plc_line(file.plc, tmp_path / "rig.toml")
    (tmp_path / "ca.pem").write_text("")
    assert str(plc_line(file.plc, tmp_path / "rig.toml")) == "127.0.0.1:802 (TLS)"


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ('transport = "tls"', "ca_file"),
        ('transport = "rtu"', "serial_port"),
        ('transport = "udp"', "transport"),
        ('registers.air_temperature_c = { address = 4, unit = "F" }', "unit"),
        ('registers.air_temperature_c = "4"', "air_temperature_c"),
    ],
)
def test_a_plc_that_cannot_be(tmp_path, text, line, complaint):
    with pytest.raises(InputError, match=complaint):
        load(tmp_path, text.replace("port = 0", f"port = 0\n{line}"))


def test_profiles_of_drives(tmp_path, text):
    with pytest.raises(InputError, match="not shipped"):
        load(tmp_path, text.replace("node_id = 1", 'node_id = 1\nprofile = "nobody"'))
    with pytest.raises(InputError, match="all of its drives or by none"):
        load(tmp_path, text.replace("node_id = 1", 'node_id = 1\nprofile = "plain-402"'))
    with pytest.raises(InputError, match="master_node_id"):
        load(tmp_path, text.replace('interface = "embedded"', 'interface = "embedded"\nmaster_node_id = 2'))
