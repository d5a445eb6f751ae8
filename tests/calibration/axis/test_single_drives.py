"""Drives with a play, with friction that is uneven, or with the motor's torque: named right, with their size."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks import single_drives
from benchmarks.single_drives import CAUSES, diagnosed, main, row

SEED = 12  # of drives with the motor's torque a third have a compliance outside U (axis.md)
NAMES = ("play, motor's torque", "uneven Coulomb, no torque", "compliance, motor's torque", "delay")
K = 3.0
MOTOR = "compliance, motor's torque"
QUIET = replace(CAUSES[MOTOR].flaws, noise_rad=3e-6, white_rad=3e-7)


@pytest.fixture(scope="module")
def found():
    """Every drive moved for ten seconds, integrated at once."""
    flaws = [CAUSES[name].flaws for name in NAMES]
    return dict(zip((*NAMES, "quiet"), diagnosed([*flaws, QUIET], SEED), strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_the_cause_is_named_with_its_size(found, name):
    cause, diagnosis = CAUSES[name], found[name]
    size = cause.size(cause.flaws)
    main_effect = diagnosis.effects[0]
    assert diagnosis.verdict in cause.names
    assert main_effect.effect == diagnosis.verdict
    assert main_effect.size.value == pytest.approx(size, abs=K * main_effect.size.u)
    assert main_effect.size.u < 0.2 * size


def test_what_accelerates_the_motor_does_not_wind_up_the_drive(found):
    """Three sevenths of what moves the masses stay in the motor: taken for wind-up, a quarter would be missing."""
    size = CAUSES[MOTOR].size(QUIET)
    assert found["quiet"].verdict == "compliance"
    assert found["quiet"].effects[0].size.value == pytest.approx(size, rel=0.1)


def test_friction_is_no_cause_where_the_torque_has_too_little_of_it(found):
    """300 Nm would have to wind up half a milliradian, and the same compliance would show in all of the torque."""
    assert "coulomb" in found["play, motor's torque"].not_tested


def test_sizes_of_other_units_than_the_flaw():
    compliance, play = CAUSES[MOTOR], CAUSES["play, motor's torque"]
    assert compliance.size(compliance.with_factor(2.0)) == pytest.approx(0.5e-6)
    assert play.size(play.with_factor(0.5)) == pytest.approx(2.5e-4)


def test_a_row_counts_what_is_right_and_what_is_named(found):
    """The diagnoses of two causes as if they were of one."""
    play = "play, motor's torque"
    flaws = [CAUSES[play].flaws, CAUSES[play].flaws]
    numbers = row(play, [found[play], found["delay"]], flaws)[len(play) :].split()
    assert numbers[:4] == ["2", "1", "2", "0"]
    assert row("noise only", [found["delay"]], flaws[:1]).split()[2:] == ["1", "0", "1", "0"]


@pytest.mark.parametrize(
    ("bad", "said"), [("--n=0", "--n is 0; give"), ("--n=-1", "--n is -1"), ("--seed=-1", "--seed")]
)
def test_numbers_of_which_no_table_can_be_made_are_one_line(capsys, bad, said):
    with pytest.raises(SystemExit) as ended:
        main([bad])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err.splitlines()[-1]


def test_a_stopped_table_goes_on_after_its_last_line(tmp_path, capsys, monkeypatch):
    left = iter(["noise", "delay"])

    def one_more(name, n, rng):
        return f"{name} {n} {next(left, None) or pytest.fail('made again')}"

    monkeypatch.setattr(single_drives, "CAUSES", {"delay": CAUSES["delay"]})
    monkeypatch.setattr(single_drives, "row_of_drives", one_more)
    for _ in range(2):
        assert main(["--n=1", f"--out={tmp_path}"]) == 0
        assert capsys.readouterr().out.splitlines()[1:] == ["noise only 1 noise", "delay 1 delay"]
