"""The diagnoser is shut in: what it can open, in each way that the system allows, and what a leak does."""

from __future__ import annotations

import sys

import pytest

from benchmarks.withheld import sealed_diagnoser
from benchmarks.withheld.run import main
from benchmarks.withheld.sealed_diagnoser import ROOT, WAYS, Leak, NotSealed, SealedDiagnoser, secret_paths

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="namespaces and Landlock are Linux's")
STAND_IN = "stand_in:diagnose"


@pytest.fixture(scope="module", params=WAYS)
def shut_in(request):
    try:
        diagnoser = SealedDiagnoser(sys.__stderr__, STAND_IN, way=request.param)
    except Leak:
        raise
    except NotSealed:
        pytest.skip(f"no {request.param} here")
    yield diagnoser
    diagnoser.close()


def opened(diagnoser, *paths, modules=()):
    return diagnoser._ask(probe=[str(path) for path in paths], modules=list(modules))["opened"]


def test_neither_checkout_nor_plant_nor_truths_can_be_opened(shut_in, tmp_path):
    truth = tmp_path / "truth.json"
    truth.write_text("{}")
    assert all(path.exists() for path in secret_paths())
    assert {ROOT, ROOT / "mock_devices", ROOT / "runs"} <= set(secret_paths())
    assert opened(shut_in, *secret_paths(), truth, "/proc/1/root", "/home", tmp_path) == []
    assert opened(shut_in, modules=("mock_devices", "benchmarks", "pkm_rig", "drivers")) == []
    # That something can be opened shows that the reader reads.
    assert opened(shut_in, "/dev/null", modules=("numpy", "calibration")) == ["/dev/null", "numpy", "calibration"]


def test_a_leak_ends_the_run_before_a_recording_is_given(shut_in):
    with pytest.raises(Leak, match=r"the diagnoser can open .*; nothing is scored"):
        SealedDiagnoser(sys.__stderr__, STAND_IN, way=shut_in.way, show=[ROOT / "mock_devices"])


def test_the_wheel_holds_neither_plant_nor_checks():
    wheel = sealed_diagnoser.unpacked_wheel(STAND_IN)
    held = {path.name for path in wheel.iterdir()}
    assert held == {"calibration", "withheld_diagnoser", "withheld_diagnoser-0.dist-info"}
    helpers = {path.stem for path in (wheel / "withheld_diagnoser").glob("*.py")}
    assert helpers == {*sealed_diagnoser.HELPERS, "stand_in", "__init__"}
    assert (wheel / "calibration" / "machine" / "data" / "planar4.toml").is_file()
    assert sealed_diagnoser.unpacked_wheel(STAND_IN) == wheel


def test_without_a_way_nothing_is_scored(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(sealed_diagnoser, "WAYS", ())
    arguments = ["--seed", "7", "--n", "4", "--kinds", "null", "--out", str(tmp_path / "out"), "--lanes", "1"]
    assert main([*arguments, "--diagnose", STAND_IN]) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("withheld: the diagnoser cannot be shut in here")
    assert "--unsealed" in message
    with pytest.raises(SystemExit):
        main(["--final", "--unsealed"])
    assert "--unsealed is no final run" in capsys.readouterr().err
