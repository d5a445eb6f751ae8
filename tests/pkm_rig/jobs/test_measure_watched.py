"""A machine that its own control moves, over the wire: the station sees it stand, the control corrects by itself."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calibration.base.errors import InputError
from drivers.errors import DeviceError
from pkm_rig.errors import CampaignRefused, CorrectionGrows
from pkm_rig.jobs.control_files import Choice, write_control_files
from pkm_rig.jobs.measure import measure
from pkm_rig.jobs.measure_watched import measure_watched
from pkm_rig.jobs.nc_program import NcChoice
from pkm_rig.jobs.verify_folders import largest_error_poses, verify_folders
from pkm_rig.rig.config import demo_rig_path, load_rig
from pkm_rig.rig.schedule import calibration_blocks
from pkm_rig.store.store import open_store
from tests.pkm_rig.conftest import SHORT, Stopped, mock_and_rig, short_rig_file, silent, stop_after
from tests.pkm_rig.jobs.watched_rig import controlled_rig, operator

POSES = 8


@pytest.fixture(scope="module")
def rig_of():
    return short_rig_file(5, calibration_poses=POSES)


@pytest.fixture(scope="module")
def chain(rig_of, tmp_path_factory):
    """The whole way: measured without, identified and written as CSV, loaded into the control, measured with."""
    file, machine = rig_of
    folder = tmp_path_factory.mktemp("chain")
    said = []
    with open_store(folder / "runs") as store:
        with controlled_rig(file, machine, folder) as (player, rig):
            before = measure_watched(rig, store, operator(player, said), silent)
        recording = store.recording(before)
        corrections = {
            n: Path(write_control_files(recording, n, folder / "runs", Choice("csv"), silent)["folder"]) for n in (0, 2)
        }
        first = largest_error_poses(recording)
        with controlled_rig(file, machine, folder, first=first, corrections=corrections, start_s=3e3) as (player, rig):
            after = measure_watched(rig, store, operator(player, said), silent, before=recording)
        yield store, recording, store.recording(after), corrections, said, folder


def test_the_whole_way_is_accepted_at_both_payloads(chain):
    _, before, after, _, said, _ = chain
    result = verify_folders(before, after)
    assert result["accepted"]
    assert result["first_poses"]["poses"] == list(largest_error_poses(before))
    assert [entry["payload_kg"] for entry in result["payloads"]] == [0.0, 400.0]
    for entry in result["payloads"]:
        assert entry["after"]["position_rms_m"] < 0.7 * entry["before"]["position_rms_m"]
    assert "the error is smaller at the first poses: going on" in said


def test_a_campaign_says_that_no_drive_was_read(chain, rig_of):
    store, before, *_ = chain
    file, machine = rig_of
    assert before.file.drive_positions == "commanded"
    assert store.events(before.file.campaign, "settings")[0].data["moved_by_control"] is True
    visits = {(v.pose, v.pass_): v for block in calibration_blocks(machine, file.campaign) for v in block.visits}
    rows = np.flatnonzero(np.asarray(before["phase"]) == "calibration")
    assert len(rows) == 5 * len(visits)
    for row in rows:
        planned = visits[int(before["pose"][row]), int(before["pass"][row])]
        for index, name in enumerate(machine.drive_names):
            assert before[f"{name}_actual_m"][row] == planned.drives_m[index] == before[f"{name}_commanded_m"][row]
            assert before[f"{name}_direction"][row] == planned.direction[index]
        assert before["payload"][row] == planned.payload


def negated(folder, to):
    """The same correction with the other sign."""
    to.mkdir()
    for path in folder.glob("[lr]*.csv"):
        turned = re.sub(r"^(\d.*,)([-+0-9.e]+)$", lambda m: m[1] + repr(-float(m[2])), path.read_text(), flags=re.M)
        (to / path.name).write_text(turned, encoding="utf-8")
    return to


def test_a_wrong_sign_is_seen_after_three_poses(chain, rig_of, tmp_path):
    store, before, _, corrections, *_ = chain
    file, machine = rig_of
    wrong = {n: negated(folder, tmp_path / f"wrong-{n}") for n, folder in corrections.items()}
    first = largest_error_poses(before)
    with controlled_rig(file, machine, tmp_path, first=first, corrections=wrong, start_s=3e3) as (player, rig):
        with pytest.raises(CorrectionGrows, match=r"sign or unit: at poses .* times \(about twice: the sign\)"):
            measure_watched(rig, store, operator(player), silent, before=before)
        assert player.visit == 4  # started again while the nests are measured, and that is all
    begun = store.recording(store.campaigns()[-1].campaign)
    assert set(begun["pose"][np.asarray(begun["phase"]) == "calibration"]) == set(first)


@pytest.fixture
def begun(rig_of, tmp_path):
    """A store, and what starts a short campaign in it with a control of its own."""
    file, machine = rig_of
    with open_store(tmp_path / "runs") as store:

        def run(notify=operator, progress=silent, resume=None, start_s=0.0, **more):
            with controlled_rig(file, machine, tmp_path, start_s=start_s, **more) as (player, rig):
                measure_watched(rig, store, notify(player), progress, resume)

        yield store, run


def started_at(number):
    """An operator who starts the program at another visit than he is told."""

    def of(player):
        hear = operator(player)
        return lambda line: player.start(number) if "start the program at N1" in line else hear(line)

    return of


def test_a_pose_that_is_not_the_next_one_is_refused_by_its_number(begun, rig_of):
    store, run = begun
    file, machine = rig_of
    visits = [v for block in calibration_blocks(machine, file.campaign) for v in block.visits]
    expected = f"at pose {visits[3].pose} .N.*, but pose {visits[0].pose} .N1. is next; have the program go on at N1"
    with pytest.raises(CampaignRefused, match=expected):
        run(started_at(4))
    phases = np.asarray(store.recording(store.campaigns()[-1].campaign)["phase"])
    assert set(phases) == {"nests"}


def test_a_visit_in_which_the_session_ended_is_measured_anew(begun):
    store, run = begun
    with pytest.raises(Stopped):
        run(progress=stop_after(7))
    campaign = store.campaigns()[-1].campaign
    before = store.recording(campaign)
    assert set(before["visit"][np.asarray(before["phase"]) == "calibration"]) == {0.0, 1.0}
    said = []
    with pytest.raises(Stopped):
        run(lambda player: operator(player, said), stop_after(10), campaign, start_s=600.0)
    assert "the station watches: start the program at N2" in said
    again = store.recording(campaign)
    measured = np.asarray(again["phase"]) == "calibration"
    anew, given_up = (measured & (again["visit"] == visit) for visit in (2.0, 1.0))
    assert set(again["replaces_visit"][anew]) == {1.0}
    assert set(again["pose"][anew]) == set(again["pose"][given_up])
    assert np.count_nonzero(anew) == 5


def test_a_dwell_that_is_too_short_is_told(begun):
    _, run = begun
    with pytest.raises((CampaignRefused, DeviceError)) as refused:
        run(choice=NcChoice(dwell_s=8.0))
    assert re.search("has left pose|moved by|is next|no reflector|was found", str(refused.value))


def test_a_machine_that_does_not_come_is_not_waited_for_for_ever(begun, monkeypatch):
    monkeypatch.setattr("pkm_rig.rig.control_watch.LONGEST_WAIT_S", 120.0)
    _, run = begun
    with pytest.raises(CampaignRefused, match=r"N1: the machine did not come to stand at pose .* within 2 min"):
        run(lambda _player: silent)


def test_both_ways_of_measuring_keep_to_themselves(chain, rig_of):
    store, before, *_ = chain
    file, machine = rig_of
    with mock_and_rig(file, machine, start_s=1e5) as (_, rig):
        with pytest.raises(InputError, match="begun with --moved-by-control"):
            measure(rig, store, silent, silent, before.file.campaign)
        with pytest.raises(TypeError):
            measure_watched(rig, store, silent, silent)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--rig", "embedded", "--moved-by-control"), "no control moves the embedded mock machine"),
        (("--rig", "embedded", "--first", "x"), "--first is for --moved-by-control"),
        (("--rig", "embedded", "--moved-by-control", "--dry-run"), "takes neither"),
        (("--rig", "embedded", "--moved-by-control", "--first", "nobody"), "nobody"),
    ],
)
def test_what_cannot_be_is_one_line(run, tmp_path, arguments, complaint):
    done = run("measure", *arguments, "--out", tmp_path / "runs")
    assert done.returncode == 2
    assert complaint in done.stderr.splitlines()[-1]


def test_a_hexapod_whose_control_commands_the_tool_is_measured(tmp_path):
    """Six legs, led by its own control along lines of the tool: every visit is found and is the one of the program."""
    path = demo_rig_path("stewart6")
    file, machine = load_rig(path)
    short = {**SHORT, "calibration_poses": 4, "readings_per_smr": 1}
    file = file.model_copy(update={"campaign": file.campaign.model_copy(update=short)})
    choice = NcChoice(coordinates="tool")
    with (
        open_store(tmp_path / "runs") as store,
        controlled_rig(file, machine, tmp_path, choice=choice, path=path) as (player, rig),
    ):
        recording = store.recording(measure_watched(rig, store, operator(player), silent))
    assert recording.file.drive_positions == "commanded"
    calibration = recording.rows("calibration")
    planned = {(v.pose, v.pass_): v for block in calibration_blocks(machine, file.campaign) for v in block.visits}
    assert set(zip(calibration["pose"].tolist(), calibration["pass"].tolist(), strict=True)) == set(planned)
    assert set(calibration["payload"].tolist()) == {0.0, 2.0}
