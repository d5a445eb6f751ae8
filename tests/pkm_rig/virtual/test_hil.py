"""The kit for tests of other people's controllers: addresses, changes while it runs, the control port, the how-to."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import tomllib
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from calibration.base.errors import InputError
from mock_devices.control_port import MOST_BYTES, MOST_CONNECTIONS, ControlPort
from pkm_rig.pytest_plugin import mock_rig
from pkm_rig.virtual.hil_rig import start_rig

__all__ = ["mock_rig"]  # the fixture, also where the package is not installed

ROOT = Path(__file__).parents[3]
HOW_TO = ROOT / "docs" / "how-to" / "test-a-controller.md"
TOKEN = "0123456789abcdef"


def test_the_plugin_imports_nothing_for_work_and_is_announced():
    script = "import pkm_rig.pytest_plugin, sys; print(*(m for m in sys.modules if '.' not in m))"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True, cwd=ROOT
    )
    assert not {"numpy", "scipy", "can", "pymodbus", "mock_devices", "sqlalchemy"} & set(done.stdout.split())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"]["pytest11"] == {"pkm_rig.pytest_plugin": "pkm_rig.pytest_plugin"}


def test_the_controller_of_the_how_to_passes_its_tests(tmp_path):
    """As a user has it: two files in a folder of their own."""
    blocks = dict(re.findall(r"<!-- (\w+\.py) -->\n```python\n(.*?)```", HOW_TO.read_text(encoding="utf-8"), re.DOTALL))
    assert sorted(blocks) == ["controller.py", "test_controller.py"]
    assert not re.search(r"pkm_rig|mock_devices|drivers", blocks["controller.py"])
    for name, text in blocks.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-W",
        "error",
        "-p",
        "pkm_rig.pytest_plugin",
        "-p",
        "no:cacheprovider",
        str(tmp_path),
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=300, check=False, cwd=tmp_path,
        env={"PYTHONPATH": f"{ROOT}:{tmp_path}", "PATH": "", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 passed" in done.stdout


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    with start_rig(
        tmp_path_factory.mktemp("hil"), effects=("backlash=2e-5,place=left",), faults=("serial-late@900",), seed=3
    ) as started:
        yield started


def test_a_rig_says_what_it_is(rig):
    status = rig.status()
    assert status["effects"] == ["backlash=2e-5,place=left"]
    assert status["faults"] == ["serial-late@900"]
    assert status["struck"] == []
    assert list(status["drives"]) == list(rig.node_ids) == ["left", "right"]
    assert rig.rig_file.is_file()


def places(rig):
    plant = rig.mock.plant
    return [(s.polar.hz_rad, s.polar.v_rad, s.polar.distance_m) for s in plant.sightings(1000.0)]


def apart(one, other):
    return max(abs(a - b) for first, second in zip(one, other, strict=True) for a, b in zip(first, second, strict=True))


def test_effects_temperatures_and_payloads_change_what_is_seen_while_it_runs(rig):
    rig.clear_effects()
    plain = places(rig)
    rig.effect("link_stiffness=0.7,place=left_upper")
    assert apart(places(rig), plain) > 1e-6
    rig.clear_effects()
    assert places(rig) == plain
    before_c = rig.mock.plant.thermal.sensor_c("columns", 1000.0)
    rig.warm("columns", 2.0)
    assert rig.mock.plant.thermal.sensor_c("columns", 1000.0) == pytest.approx(before_c + 2.0)
    assert apart(places(rig), plain) > 5e-6
    rig.warm("columns", -2.0)
    assert apart(places(rig), plain) < 1e-12
    rig.payload(2)
    assert rig.status()["payload"] == 2
    assert apart(places(rig), plain) > 1e-6
    rig.payload(0)
    assert apart(places(rig), plain) < 1e-12


@pytest.mark.parametrize(
    "line",
    [
        "effect", "effect nonsense=1", "effect backlash", "payload", "payload 9", "payload -1", "payload x",
        "temperature", "temperature columns", "temperature columns nan", "temperature columns 1000",
        "temperature roof 1",
        "interlock", "interlock guard", "interlock door open", "interlock guard closed", "fault none x", "reboot",
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_line_and_changes_nothing(rig, line):
    before = {key: value for key, value in rig.status().items() if key != "t_rig_s"}
    with pytest.raises(InputError) as refused:
        rig.tell(line)
    assert len(str(refused.value).splitlines()) == 1
    assert {key: value for key, value in rig.status().items() if key != "t_rig_s"} == before


def test_a_machine_without_a_mock_rig_is_refused_and_no_file_stays(tmp_path):
    with pytest.raises(InputError, match="there are planar4"), start_rig(tmp_path, "no-such"):
        pass
    with pytest.raises(InputError, match="nonsense"), start_rig(tmp_path, effects=("nonsense=1",)):
        pass
    assert list(tmp_path.iterdir()) == []


def test_another_machine_has_its_own_drives(mock_rig):
    rig = mock_rig("gough8", time_scale=5.0)
    assert len(rig.node_ids) == 8
    rig.effect("backlash=2e-5,place=leg1")
    with pytest.raises(InputError, match="guide_straightness"):
        rig.effect("guide_straightness=2e-5,place=leg1")


# --- the control port


@pytest.fixture
def port():
    lines = []

    def execute(line):
        lines.append(line)
        if line == "bad":
            raise ValueError("no\nsuch line")
        return f"did {line}"

    served = ControlPort(0, TOKEN, execute)
    yield served, lines
    served.close()


@contextmanager
def connected(served):
    with socket.create_connection(("127.0.0.1", served.port), timeout=10.0) as line, line.makefile("rwb") as stream:

        def say(text):
            stream.write(text if isinstance(text, bytes) else f"{text}\n".encode())
            stream.flush()
            return stream.readline().decode()

        yield say


def test_lines_are_answered_after_the_token(port):
    served, lines = port
    with connected(served) as say:
        assert say(f"token {TOKEN}") == "ok: connected\n"
        assert say("status") == "ok: did status\n"
        assert say("bad") == "not done: no such line\n"
        assert say("status") == "ok: did status\n"
    assert lines == ["status", "bad", "status"]
    assert served.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize(
    "first",
    ["status", TOKEN, f"token {TOKEN}x", f"token {TOKEN[:-1]}", "token ", "POST / HTTP/1.1", "token é", b"\xff\xfe\n"],
)
def test_without_the_token_nothing_is_carried_out(port, first):
    served, lines = port
    with connected(served) as say:
        assert say(first).startswith("not done")
        with pytest.raises((ConnectionError, AssertionError)):
            assert say("status") != ""
    assert lines == []


def test_a_line_that_is_too_long_ends_the_connection(port):
    served, lines = port
    with connected(served) as say:
        say(f"token {TOKEN}")
        with suppress(ConnectionError):
            assert say("x" * MOST_BYTES) == ""
    assert lines == []


def test_there_are_few_connections(port):
    served, _ = port
    held = []
    for _ in range(MOST_CONNECTIONS):
        manager = connected(served)
        held.append(manager)
        assert manager.__enter__()(f"token {TOKEN}") == "ok: connected\n"
    with connected(served) as say:
        assert "too many" in say(f"token {TOKEN}")
    for manager in held:
        manager.__exit__(None, None, None)


def test_a_short_token_is_refused():
    with pytest.raises(ValueError, match="16 characters"):
        ControlPort(0, "short", str)
