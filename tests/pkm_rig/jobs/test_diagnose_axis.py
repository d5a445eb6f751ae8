"""`diagnose` of one axis: what it prints for programs and for people."""

from __future__ import annotations

import json

import jsonschema
import numpy as np
import pytest

from calibration.recording.axis_header import AxisFile
from calibration.recording.axis_recording import write_axis_folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A second encoder that is half a millisecond late."""
    path = tmp_path_factory.mktemp("axis") / "late"
    time = np.arange(400) * 0.01
    noise = 1e-4 * np.random.default_rng(1).standard_normal(400)
    motor = 20.0 * np.sin(2.5 * time + 0.8 * np.sin(1.1 * time))
    spike = 5.0 * (np.arange(400) == 150)
    late = 20.0 * np.sin(2.5 * (time - 5e-4) + 0.8 * np.sin(1.1 * (time - 5e-4)))
    file = AxisFile(format=1, name="late", simulated=True, kind="rotary", time_unit="s", position_unit="deg")
    columns = {"time": time, "command": motor, "motor_position": motor, "second_position": late + noise + spike}
    write_axis_folder(file, columns, path)
    return path


def test_the_command_names_the_delay(run, folder, request):
    result = json.loads(run("diagnose", folder, "--json").stdout)
    schema = request.config.rootpath / "docs" / "reference" / "axis-diagnosis.schema.json"
    jsonschema.validate(result, json.loads(schema.read_text(encoding="utf-8")))
    assert result["simulated"]
    assert {result["verdict"], *result["equivalent"]} >= {"delay", "viscous"}
    main = result["effects"][0]
    assert main["value"] == pytest.approx(5e-4, abs=4.0 * main["u"])
    (wrong,) = result["left_out"]
    assert (wrong["time_s"], wrong["samples"], wrong["position"]) == (pytest.approx(1.5), 1, "second")
    assert wrong["off"] == pytest.approx(np.radians(5.0), rel=1e-2)
    shown = run("diagnose", folder).stdout
    assert "note: 1 wrong sample left out: at 1.5 s" in shown
    assert "SIMULATED" in shown
    assert f"verdict: {result['verdict']}" in shown
    assert "compliance: no torque or force was recorded" in shown


@pytest.mark.parametrize("option", ["--add", "--thorough"])
def test_what_is_for_machines_is_refused(run, folder, option):
    done = run("diagnose", folder, option)
    assert done.returncode == 2
    assert "are for machines" in done.stderr
