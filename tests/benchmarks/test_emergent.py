"""The plant in MuJoCo: what emerges is what mechanics says, and a run goes on where it was stopped."""

from __future__ import annotations

import json
import sys
from collections import Counter
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.emergent import run
from benchmarks.emergent.campaign import FIRST_S
from benchmarks.emergent.cases import SEED, plan
from benchmarks.emergent.drive_model import Arrival, Drive, DrivePart, approach
from benchmarks.emergent.faults import INSIDE, OUTSIDE, draw_fault, drive_parts, strut_parts
from benchmarks.emergent.machines import NOMINAL, draw_machine, machine_file
from benchmarks.emergent.making import make_case
from benchmarks.emergent.sizes import Sizes
from benchmarks.emergent.statics import drives_of, hang
from benchmarks.emergent.strut_model import StrutParts, Struts
from benchmarks.independent import make_all as making
from benchmarks.independent.recordings import digest_of, is_even
from benchmarks.independent.truths import read_truths
from calibration.effects.catalogue import load_catalogue
from calibration.machine.description import load_machine
from calibration.recording.folder import read_folder
from tests.kept_results import until_stopped

AT_REST = np.array([0.3])
LOAD_N = -200.0


def settled(part, direction, dwell_s=AT_REST, speed=0.12, load_n=LOAD_N):
    """Where the carriage is over its command after one approach, in um, and the motor's force in N."""
    rest = Drive(part).visit(Arrival(1.0, direction, speed, load_n), np.array(dwell_s))
    return rest.carriage_m * 1e6, rest.motor_n


# --- drives


@pytest.mark.parametrize("direction", [1, -1])
def test_a_play_stands_open_by_half_on_either_side_and_keeps_it_for_a_second(direction):
    drive = Drive(DrivePart(play_m=15e-6, friction_n=1200.0))
    at = drive.visit(Arrival(1.0, direction, 0.12, LOAD_N), AT_REST).carriage_m[0]
    deflected = (LOAD_N - direction * 1200.0) / DrivePart().stiffness_n_per_m
    assert at - deflected == pytest.approx(-direction * 7.5e-6, abs=0.1e-6)
    later = drive.hold(1.0, LOAD_N).carriage_m[0]
    assert later == pytest.approx(at, abs=0.02e-6)


def test_a_play_falls_to_the_side_of_a_weight_that_friction_does_not_hold():
    below, _ = settled(DrivePart(play_m=15e-6, friction_n=300.0), -1, load_n=-800.0)
    assert below[0] == pytest.approx(-7.5, abs=0.5)


@pytest.mark.parametrize("direction", [1, -1])
def test_wind_up_is_the_force_over_the_stiffness(direction):
    at, motor = settled(DrivePart(stiffness_n_per_m=4e7, friction_n=500.0), direction)
    assert at[0] == pytest.approx((LOAD_N - direction * 500.0) / 4e7 * 1e6, abs=0.1)
    assert motor[0] == pytest.approx(-LOAD_N + direction * 520.0, abs=5.0)  # 20 N of the motor's own


def test_settling_decays_with_the_time_of_the_integral_action():
    part = DrivePart(gain_n_per_m=5e6, friction_n=400.0, integral_s=0.2, integral_in_motion=False)
    at, _ = settled(part, 1, [0.2, 0.4, 0.6])
    assert -60.0 < at[0] < -20.0
    assert at[1] / at[0] == pytest.approx(np.exp(-1.0), abs=0.04)
    assert at[2] / at[1] == pytest.approx(np.exp(-1.0), abs=0.04)
    good, _ = settled(replace(part, gain_n_per_m=2e7, integral_s=0.03), 1, [0.2])
    assert abs(good[0]) < 1.0


def test_stick_slip_leaves_at_most_the_friction_over_the_stiffness():
    drive = Drive(DrivePart(stiffness_n_per_m=1e7, friction_n=400.0, weakening=0.5, balance=1.0))
    left = [
        drive.visit(Arrival(1.0 + 0.01 * k, side, speed, LOAD_N), AT_REST).carriage_m[0]
        for k, (side, speed) in enumerate([(1, 0.04), (-1, 0.12), (1, 0.3)])
    ]
    assert np.all(np.abs(left) <= 40.5e-6)
    assert np.ptp(np.abs(left)) > 1e-6  # another share of it each time


def test_an_integral_action_against_friction_that_falls_with_speed_hunts():
    part = DrivePart(
        motor_friction_n=1200.0, motor_weakening=0.7, gain_n_per_m=6e6, integral_s=0.02, friction_n=30.0, balance=1.0
    )
    at, _ = settled(part, 1, np.arange(0.2, 1.3, 0.1))
    assert np.ptp(at) > 100.0


def test_a_cable_that_drags_remembers_which_way_it_was_pulled_and_the_motor_does_not_feel_it():
    good = DrivePart(friction_n=10.0, balance=1.0)
    drive = Drive(replace(good, bracket_n_per_m=2e5, cable_n=8.0, cable_n_per_m=80.0))
    rests = [drive.visit(Arrival(place, 1, 0.12, 0.0), AT_REST) for place in (1.0, 1.3, 1.25)]
    at = [rest.carriage_m[0] * 1e6 for rest in rests]
    began = -approach(Arrival(1.0, 1, 0.12, 0.0), 0.0)[0][0]  # of the last part of an approach, before the target
    assert at[0] == pytest.approx(80.0 * began / 2e5 * 1e6, abs=0.2)  # slack until then
    assert at[1] == pytest.approx(40.0, abs=1.0)  # all of its friction over the bracket's stiffness
    assert at[2] == pytest.approx(20.0, abs=1.0)  # half of it is given back on the way of 50 mm
    _, motor = settled(good, 1, load_n=0.0)
    assert rests[1].motor_n[0] == pytest.approx(motor[0], abs=10.0)


def test_a_tooth_that_broke_off_lifts_the_carriage_above_it_and_is_pushed_along():
    drive = Drive(DrivePart(tooth_m=5e-5, tooth_reach_m=0.1, friction_n=10.0, balance=1.0))
    places = (1.0, 1.05, 1.3, 1.2, 1.1)
    rests = [drive.visit(Arrival(place, 1, 0.12, 0.0), AT_REST) for place in places]
    at = [rest.carriage_m[0] * 1e6 for rest in rests]
    began = -approach(Arrival(1.0, 1, 0.12, 0.0), 0.0)[0][0]  # of the last part of an approach, before the target
    lies = np.array([1.0 - began, 1.0 - began, 1.2, 1.2, 1.1 - began + 0.1])  # pushed by the third and the last way
    expected = 50.0 * np.cos(0.5 * np.pi * (lies - places) / 0.1) ** 2
    np.testing.assert_allclose(at, expected, atol=0.1)
    assert expected.max() > 49.0
    assert expected.min() < 1.0
    assert rests[0].motor_n[0] == pytest.approx(rests[2].motor_n[0], abs=20.0)


def test_a_loose_clamp_gives_way():
    tight, _ = settled(DrivePart(clamp_n=2000.0, clamp_n_per_m=1.5e7), 1, load_n=-800.0)
    loose, _ = settled(DrivePart(clamp_n=300.0, clamp_n_per_m=1.5e7), 1, load_n=-800.0)
    assert abs(tight[0]) < 1.0
    assert loose[0] < -20.0


@pytest.mark.parametrize("speed", [0.04, 0.3])
def test_an_approach_ends_at_the_target_and_at_rest(speed):
    places, speeds = approach(Arrival(1.0, -1, speed, 0.0), 1e-5)
    assert (places[-1], speeds[0]) == (pytest.approx(0.0, abs=1e-12), 0.0)
    assert np.max(np.abs(speeds)) == pytest.approx(speed)
    np.testing.assert_allclose(np.cumsum(0.5 * (speeds[1:] + speeds[:-1])) * 1e-3, places[1:] - places[0], atol=1e-6)


# --- struts


def hanging(parts, payload=1, machine=NOMINAL):
    """Drives, the pose by hand, and the pose by MuJoCo, at one place."""
    drives = drives_of(machine, np.array([0.1]), np.array([0.05]))
    pose, tension = hang(machine, drives, np.array([payload]))
    return drives[0], pose[0], tension[0], Struts(machine, parts).rest(drives[0], pose[0], payload)


def test_springs_alone_hang_where_statics_says():
    machine = draw_machine(np.random.default_rng(4))
    for payload in (0, 2):
        _, pose, _, rest = hanging(StrutParts(), payload, machine)
        np.testing.assert_allclose(rest.pose, pose, atol=2e-9)


def test_a_soft_strut_is_two_springs_in_a_row_until_its_stop():
    soft = 5e7
    _, _, _, rest = hanging(StrutParts(soft_n_per_m=(soft, np.inf, np.inf, np.inf)))
    stiffness = NOMINAL.stiffness_n_per_m.copy()
    stiffness[0] = 1.0 / (1.0 / stiffness[0] + 1.0 / soft)
    _, pose, _, _ = hanging(StrutParts(), machine=replace(NOMINAL, stiffness_n_per_m=stiffness))
    np.testing.assert_allclose(rest.pose, pose, atol=2e-8)


def test_a_pin_stands_at_the_wall_that_the_strut_pulls_it_to():
    wide = 2e-5
    _, _, tension, rest = hanging(StrutParts(clearance_m=(0.0, wide, 0.0, 0.0)))
    length = NOMINAL.length_m.copy()
    length[1] += wide * np.sign(tension[1])
    _, pose, other, _ = hanging(StrutParts(), machine=replace(NOMINAL, length_m=length))
    assert np.sign(other[1]) == np.sign(tension[1])  # still pulled the same way
    np.testing.assert_allclose(rest.pose, pose, atol=3e-7)


def test_a_soft_column_yields_to_the_struts():
    drives, pose, tension, rest = hanging(StrutParts(column_n_per_m=(5e7, np.inf)))
    way = pose[:2] + NOMINAL.platform_m[:2] - NOMINAL.base_m[:2] - NOMINAL.carriages_m(drives)[0]
    pull = np.sum(tension[:2] * way[:, 0] / np.linalg.norm(way, axis=1))
    assert rest.carriages[0, 0] == pytest.approx(pull / 5e7, rel=0.1)
    assert rest.carriages[1, 0] == 0.0


# --- cases


def test_the_plan_has_its_kinds_at_even_numbers_and_names_of_the_catalogue():
    cases = plan()
    assert Counter(case.kind for case in cases) == {"single": 120, "pair": 30, "null": 30, "outside": 20}
    assert len({case.name for case in cases}) == 200
    assert all(is_even(case.name) for case in cases)
    kinds = Counter(case.kind for case in cases[:100])
    assert (kinds["single"], kinds["null"]) == (60, 15)
    assert cases == plan()
    others = plan(1)
    assert Counter(case.causes for case in others) == Counter(case.causes for case in cases)
    assert not {case.seed for case in others} & {case.seed for case in cases}
    known, rng = load_catalogue().names, np.random.default_rng(1)
    assert all(draw_fault(cause, rng).effect in known for cause in INSIDE)
    assert not any(draw_fault(cause, rng).effect in known for cause in OUTSIDE)


@pytest.mark.parametrize("cause", [*INSIDE, *OUTSIDE])
def test_a_repaired_part_differs_from_a_faulty_one(cause):
    fault = draw_fault(cause, np.random.default_rng(2))
    faulty, good = ((drive_parts([fault], of), strut_parts([fault], of)) for of in ((), (fault,)))
    assert faulty != good
    assert fault.sized(1.5) != fault


def test_a_case_made_twice_is_the_same_and_can_be_read(tmp_path):
    play = next(case for case in plan() if case.causes == ("play",))
    for folder in ("one", "two"):
        make_case(play, tmp_path / folder, every=45)
    one, two = (
        {file.name: file.read_bytes() for file in (tmp_path / folder / play.name).iterdir()}
        for folder in ("one", "two")
    )
    assert one == two
    (tmp_path / "one" / play.name / "entry.json").unlink()
    (tmp_path / "one" / play.name / "arrays.npz").unlink()
    recording = read_folder(tmp_path / "one" / play.name)
    machine = tmp_path / "machine.toml"
    machine.write_text(machine_file())
    assert [smr.name for smr in load_machine(machine).smrs] == ["P1", "P2", "P3", "SL", "SR", "N1", "N2"]
    assert recording["dwell_s"].min() == FIRST_S


def test_geometry_hides_what_it_can_absorb():
    from benchmarks.emergent.campaign import draw_campaign  # noqa: PLC0415

    campaign = draw_campaign(NOMINAL, "oneway", np.random.default_rng(3)).thinned(4)
    sizes = Sizes(NOMINAL, campaign, 2e-6, 4e-6, np.array([0.3, -0.2, 3.0]))
    shifted = np.tile([2e-5, 1e-5, 0.0], (len(campaign.of_reading[0]), 1))
    assert min(sizes.raw(shifted)) > 2.0
    assert max(sizes.visible(shifted)) < 0.01


# --- a run


@pytest.fixture
def scored(monkeypatch):
    """Archives that were given to the scorer; it finds nothing."""
    given = []

    def score(arguments):
        folder = run.Path(arguments[arguments.index("--data") + 1])
        archive = folder / "recordings.tar.xz"
        given.append(read_truths(archive, ["rec002"]))
        results = run.Path(arguments[arguments.index("--out") + 1]) / f"code-{digest_of(archive)}" / "even"
        results.mkdir(parents=True, exist_ok=True)
        (results / "results.json").write_text('{"rows": []}')
        return 0

    monkeypatch.setattr(run.independent, "main", score)
    monkeypatch.setattr(run.independent, "code_digest", lambda _: "code")
    return given


def test_a_stopped_run_goes_on_and_says_what_it_scores_before_it_does(tmp_path, monkeypatch, capsys, scored):
    asked = []

    @contextmanager
    def stopped_at_the_second(_make, jobs, _processes):
        asked.append([one.name for one, _ in jobs])
        out = []
        for one, cases in jobs:
            out.append(Future())
            if len(asked) == 1 and one.name == "rec004":
                (cases / "rec004.part").mkdir()
                out[-1].set_exception(KeyboardInterrupt())
            else:
                run.pack.__globals__["write_case"](
                    cases / one.name, {}, {"kind": "null"}, {"clean_m": np.zeros((1, 3)), "platform": np.ones(1, bool)}
                )
                out[-1].set_result(one.name)
            if out[-1].exception():
                break
        yield out

    monkeypatch.setattr(making, "side_by_side", stopped_at_the_second)
    monkeypatch.setattr(making, "as_completed", iter)
    arguments = ["run", "--n", "3", "--out", str(tmp_path / "out"), "--log", str(tmp_path / "log")]
    monkeypatch.setattr(sys, "argv", arguments)
    assert until_stopped(run.main) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "stopped; the same command goes on from here"
    assert not (tmp_path / "log").exists()
    assert until_stopped(run.main) == 0
    assert until_stopped(run.main) == 0
    assert asked == [["rec002", "rec004", "rec006"], ["rec004", "rec006"], []]
    assert len(scored) == 2
    (line,) = (json.loads(text) for text in (tmp_path / "log").read_text().splitlines())
    assert line["catalogue"] == run.code_digest("calibration/effects")
    assert not list((tmp_path / "out").rglob("*.part"))
    monkeypatch.setattr(sys, "argv", [*arguments, "--seed", "1"])
    assert until_stopped(run.main) == 0
    assert asked[-1] == ["rec002", "rec004", "rec006"]
    assert [json.loads(text)["seed"] for text in (tmp_path / "log").read_text().splitlines()] == [SEED, 1]


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (("--n", "0"), "--n is 0; give the number of cases, 1 or more"),
        (("--n", "-1"), "--n is -1"),
        (("--seed", "-1"), "--seed must not be negative"),
    ],
)
def test_numbers_of_which_no_run_can_be_made_are_refused_before_anything_is_made(tmp_path, capsys, bad, said):
    with pytest.raises(SystemExit) as ended:
        run.main([*bad, "--out", str(tmp_path / "out"), "--log", str(tmp_path / "log")])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").touch()
    monkeypatch.setattr(sys, "argv", ["run", "--n", "1", "--out", str(tmp_path / "file")])
    assert until_stopped(run.main) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "Not a directory; name another folder" in said
