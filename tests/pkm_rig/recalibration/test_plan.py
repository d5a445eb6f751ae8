"""What a run would do, from what is stored alone; postponing; journal, notification, units, watching."""

from __future__ import annotations

import json
import re
import sys
from datetime import UTC, datetime, timedelta

import pytest

from calibration.base.errors import InputError
from calibration.intervals.drift import DriftSettings
from calibration.intervals.prediction import PredictionSettings
from calibration.machine.description import shipped_machine
from drivers.errors import DeviceError
from pkm_rig.errors import StoreError
from pkm_rig.jobs.interval_settings import interval_settings
from pkm_rig.jobs.life_record import utc_text
from pkm_rig.recalibration.decisions import note, postpone
from pkm_rig.recalibration.journal import journal_path, last_entry, send_notification, write_line
from pkm_rig.recalibration.run import Recalibration, RunResult, plan
from pkm_rig.recalibration.situation import read_situation, require_decidable_check
from pkm_rig.recalibration.units import unit_texts, write_units
from pkm_rig.recalibration.watch import Watcher, watch
from pkm_rig.rig.config import load_rig
from pkm_rig.store.life import add_to_life, life_rows
from pkm_rig.store.store import hold_existing_store, open_existing_store
from tests.pkm_rig.recalibration.rigs import ALWAYS, CALIBRATED_S, RIG, keep_store, write_rig

DAY_S = 86400.0


@pytest.fixture
def out(tmp_path):
    return keep_store(tmp_path)


def what(path, out, days=0.0, *, scheduled=True):
    with open_existing_store(out) as store:
        situation, file = read_situation(store, path, CALIBRATED_S + days * DAY_S)
    return plan(situation, file, scheduled=scheduled)


def never():
    raise AssertionError("no device is to be touched")


def job_at(path, out, store, now_s, connect, notify):
    return Recalibration(path, out, store, connect, notify, lambda *_: None, lambda: now_s)


def noted(path, out, event="collision", part="left"):
    with hold_existing_store(out) as store:
        situation, _ = read_situation(store, path, CALIBRATED_S)
        note(store, situation, event, part, "tester", "seen")


def test_nothing_is_due_until_a_check_is(out):
    path = write_rig(out, ALWAYS)
    assert what(path, out, 1.0).what == "nothing"
    assert what(path, out, 8.0).what == "check"
    assert what(path, out, 366.0).what == "check"
    assert "366 days since calibration" in what(path, out, 366.0).why


@pytest.mark.parametrize(
    ("lines", "top", "hindrance"),
    [
        ((), "", "no maintenance window is stated"),
        (('windows = [{ days = ["sat"], begin = "02:00", end = "03:00" }]',), "", "the next window opens 20"),
        (
            (ALWAYS,),
            '[[certificates]]\ninstrument = "station"\nnumber = "7"\ndue = 2020-01-04\n',
            r"the certificate of station \(7\) has expired on 2020-01-04; have it renewed",
        ),
    ],
)
def test_scheduled_work_is_skipped_with_its_reason(out, lines, top, hindrance):
    path = write_rig(out, *lines, top=top)
    intended = what(path, out, 8.0)
    assert intended.what == "skipped"
    assert re.match(hindrance, intended.why)


def test_somebody_at_the_machine_needs_no_window(out):
    path = write_rig(out)
    assert what(path, out, 8.0, scheduled=False).what == "check"


def test_an_event_asks_for_a_calibration_that_has_to_be_granted(out):
    path = write_rig(out, ALWAYS, "alone = true")
    noted(path, out)
    intended = what(path, out, 0.0)
    assert "event: collision left" in intended.why
    with open_existing_store(out) as store:
        situation, _ = read_situation(store, path, CALIBRATED_S)
    assert (situation.state, situation.verdict.measurement.extent) == ("due", "full")
    assert situation.check_is_due is False or intended.what in ("check", "calibration")


def test_a_lost_reference_asks_for_that_drive_alone(out):
    path = write_rig(out, ALWAYS)
    noted(path, out, "reference lost", "right")
    with open_existing_store(out) as store:
        situation, _ = read_situation(store, path, CALIBRATED_S)
    measurement = situation.verdict.measurement
    assert (measurement.extent, measurement.drives, measurement.visits) == ("drive offset", ("right",), 10)


def test_postponing_takes_name_reason_and_an_end_ahead(out):
    path = write_rig(out, ALWAYS)
    now = datetime.fromtimestamp(CALIBRATED_S, UTC)
    with hold_existing_store(out) as store:
        situation, _ = read_situation(store, path, now.timestamp())
        for until, complaint in (
            ("tomorrow", "is no date"),
            ("2019-12-31", "within the next year"),
            (f"{now + timedelta(days=800):%F}", "within the next year"),
        ):
            with pytest.raises(InputError, match=complaint):
                postpone(store, situation, "tester", "a fair", until)
        end = postpone(store, situation, "tester", "a fair", f"{now + timedelta(days=9):%F}")
        later, file = read_situation(store, path, now.timestamp() + 8.0 * DAY_S)
        assert plan(later, file, scheduled=True).why.startswith("postponed until")
        assert plan(later, file, scheduled=False).what == "check"
        over, file = read_situation(store, path, now.timestamp() + 11.0 * DAY_S)
        assert plan(over, file, scheduled=True).what == "check"
        (row,) = [r for r in life_rows(store, "machine_events", RIG) if r.kind == "postponed"]
    assert (row.data["who"], row.data["why"]) == ("tester", "a fair")
    assert datetime.fromisoformat(end).timestamp() == row.data["until_utc_s"]


def test_a_clock_that_was_set_back_is_refused(out):
    path = write_rig(out, ALWAYS)
    with open_existing_store(out) as store, pytest.raises(InputError, match="the clock was set back"):
        read_situation(store, path, CALIBRATED_S - 400.0 * DAY_S)


def test_what_cannot_be_judged_leaves_one_line(out):
    path, said = write_rig(out, ALWAYS), []
    with hold_existing_store(out) as store:
        job = job_at(path, out, store, CALIBRATED_S - 400.0 * DAY_S, never, said.append)
        for _ in range(2):
            with pytest.raises(InputError, match="the clock was set back"):
                job.run(scheduled=True, command="watch", quiet=True)
    (line,) = journal_path(out, RIG).read_text().splitlines()
    assert (json.loads(line)["done"], json.loads(line)["alarm"]) == ("failed", True)
    assert "the clock was set back" in json.loads(line)["why"]


def test_an_interrupted_run_leaves_its_line(out):
    path = write_rig(out, ALWAYS)

    def interrupted():
        raise KeyboardInterrupt

    with hold_existing_store(out) as store:
        job = job_at(path, out, store, CALIBRATED_S + 8.0 * DAY_S, interrupted, print)
        with pytest.raises(KeyboardInterrupt):
            job.run(scheduled=True)
    assert last_entry(out, RIG)["done"] == "interrupted"
    assert last_entry(out, RIG)["why"] == "interrupted before it was done (a check is due)"


def test_what_fails_again_for_the_same_reason_is_said_once(out):
    path = write_rig(out, ALWAYS)

    def silent_devices():
        raise DeviceError("plc", "127.0.0.1:1", "does not answer", "switch it on")

    with hold_existing_store(out) as store:
        job = job_at(path, out, store, CALIBRATED_S + 8.0 * DAY_S, silent_devices, print)
        results = [job.run(scheduled=True, command="watch", quiet=True) for _ in range(3)]
    assert {result.done for result in results} == {"failed"}
    assert len(journal_path(out, RIG).read_text().splitlines()) == 1


def test_another_machine_file_begins_a_history_that_nobody_begins_alone(out):
    path = write_rig(out, ALWAYS, "alone = true")
    text = shipped_machine("planar4").read_text(encoding="utf-8").replace("left_upper", "left_top")
    (out / "renamed.toml").write_text(text, encoding="utf-8")
    path.write_text(path.read_text().replace('machine = "planar4"', 'machine = "renamed.toml"'))
    with open_existing_store(out) as store:
        situation, _ = read_situation(store, path, CALIBRATED_S + 60.0)
    (remark,) = situation.as_dict()["remarks"]
    assert "another machine file, or other parameters, than before (planar4/" in remark
    intended = what(path, out)
    assert intended.what == "skipped"
    assert intended.why.startswith(f"{remark}; the first one is made by hand")
    assert what(path, out, scheduled=False).what == "calibration"


def test_drift_and_prediction_are_as_the_rig_file_says(out):
    path = write_rig(
        out,
        "[recalibration.check]\nlooks = [4, 8]",
        "[recalibration.drift]\nwalk_per_sqrt_week = 0.5\nper_k = 0.1\ninstrument = 7.0",
        "[recalibration.prediction]\nhorizon_days = 100\ncoverage = 0.9\nact_by = 0.05\ntrend = 0.2\nfastest_weeks = 9",
    )
    settings = interval_settings(load_rig(path)[0].recalibration)
    assert settings.drift == DriftSettings(0.5, 0.1, 7.0, full_poses=8)
    expected = PredictionSettings(100.0 * DAY_S, coverage=0.9, act_by=0.05, trend=0.2, fastest_weeks=9.0)
    assert settings.prediction == expected
    default = interval_settings(load_rig(write_rig(out))[0].recalibration)
    assert (default.drift, default.prediction) == (DriftSettings(), PredictionSettings())


def test_a_tolerance_below_2_u_is_refused_with_the_figure(out):
    path = write_rig(out, ALWAYS)
    with hold_existing_store(out) as store:
        situation, _ = read_situation(store, path, CALIBRATED_S)
        last = situation.history.last_calibration
        check = {
            "id": "k1", "t_utc_s": CALIBRATED_S + 10.0, "calibration": last.id, "instrument": last.instrument,
            "error": {"position_m": 1e-6, "u_m": 2e-5}, "watched": ["drive_offset.left"], "change": [0.0],
            "change_u": [1e-6], "reference_u": [1e-6], "error_per_change": [1.0], "independent": 1.0,
            "temperature_c": 20.0, "poses": 6, "operating_h": 1.0, "duration_s": 200.0,
        }  # fmt: skip
        add_to_life(store, "checks", rig=RIG, machine=situation.key, kind="fit", data=check, campaign="k1")
        with pytest.raises(InputError, match=r"tolerance 60.0 um is below 2 U = 80.0 um"):
            read_situation(store, path, CALIBRATED_S + 20.0)


def test_before_the_first_check_a_tolerance_below_its_2_u_is_refused(out):
    path = write_rig(out, ALWAYS)
    path.write_text(path.read_text().replace("tolerance_m = 60e-6", "tolerance_m = 9e-6"))
    with open_existing_store(out) as store:
        situation, _ = read_situation(store, path, CALIBRATED_S)
        with pytest.raises(InputError, match=r"tolerance 9\.0 um is below 2 U = 1\d\.\d um of the check"):
            require_decidable_check(store, path, situation)
        path.write_text(path.read_text().replace("tolerance_m = 9e-6", "tolerance_m = 18e-6"))
        wider, _ = read_situation(store, path, CALIBRATED_S)
        require_decidable_check(store, path, wider)


def test_a_tolerance_of_the_rig_file_counts_before_any_command_has_connected(out):
    path = write_rig(out, ALWAYS)
    with hold_existing_store(out) as store:
        key = read_situation(store, path, CALIBRATED_S)[0].key
        told = {"created": utc_text(CALIBRATED_S - 99.0), "campaign": None}
        add_to_life(
            store, "machine_events", rig=RIG, machine=key, kind="tolerance changed", data={"position_m": 5e-5}, **told
        )
        machine = read_situation(store, path, CALIBRATED_S)[0].history.machine
    assert machine.tolerance_m(CALIBRATED_S - 50.0) == 5e-5
    assert machine.tolerance_m(CALIBRATED_S) == 60e-6


def test_without_a_tolerance_nothing_can_be_judged(out):
    path = write_rig(out)
    path.write_text(path.read_text().replace("tolerance_m = 60e-6", ""))
    with open_existing_store(out) as store, pytest.raises(InputError, match=r"recalibration\.tolerance_m is missing"):
        read_situation(store, path, CALIBRATED_S)


def test_a_skipped_run_leaves_one_line_and_tells_the_command(out):
    told = out / "told.txt"
    program = f"import sys; open({str(told)!r}, 'a').write(sys.stdin.read())"
    path = write_rig(out, f"notify = [{json.dumps(sys.executable)}, '-c', {json.dumps(program)}]")

    with hold_existing_store(out) as store:
        job = Recalibration(path, out, store, never, print, lambda *_: None, lambda: CALIBRATED_S + 8.0 * DAY_S)
        result = job.run(scheduled=True, command="watch", quiet=True)
        again = job.run(scheduled=True, command="watch", quiet=True)
    assert result.done == again.done == "skipped"
    (line,) = told.read_text().splitlines()
    entry = json.loads(line)
    assert entry == last_entry(out, RIG)
    assert (entry["command"], entry["done"], entry["state"]) == ("watch", "skipped", "fit")
    assert entry["why"].startswith("no maintenance window is stated")


def test_a_notification_that_fails_is_said_and_stops_nothing(tmp_path):
    said = []
    assert send_notification((), "{}", said.append)
    assert not send_notification((sys.executable, "-c", "import sys; sys.exit(7)"), "{}", said.append)
    assert not send_notification((str(tmp_path / "missing"),), "{}", said.append)
    assert "ended with status 7" in said[0]
    assert "missing" in said[1]


def test_each_rig_has_its_own_journal_and_a_cut_line_is_none(tmp_path):
    write_line(tmp_path, "a", {"done": "check"})
    write_line(tmp_path, "b", {"done": "skipped"})
    assert (last_entry(tmp_path, "a"), last_entry(tmp_path, "b")) == ({"done": "check"}, {"done": "skipped"})
    with (tmp_path / "recalibration-a.jsonl").open("a") as stream:
        stream.write('{"done": ')
    assert last_entry(tmp_path, "a") == {}
    assert last_entry(tmp_path, "c") == {}


def test_units_quote_what_systemd_would_take_apart(tmp_path):
    texts = unit_texts("saw", ["/opt/pkm rig/bin", "recalibrate", "--rig", "/rigs/100%.toml", "$HOME"])
    service = texts["pkm-rig-recalibrate-saw.service"]
    assert 'ExecStart="/opt/pkm rig/bin" recalibrate --rig /rigs/100%%.toml $$HOME\n' in service
    assert "SuccessExitStatus=10" in service
    assert "Persistent=true" in texts["pkm-rig-recalibrate-saw.timer"]
    first = write_units(texts, tmp_path)
    assert write_units(texts, tmp_path) == first
    first[0].write_text("something else")
    with pytest.raises(InputError, match="says something else"):
        write_units(texts, tmp_path)


def test_watching_says_what_changes_once():
    said = []
    answers = iter([
        RunResult("saw", "nothing", "nothing is due"),
        RunResult("saw", "nothing", "nothing is due"),
        RunResult("saw", "skipped", "no window"),
        StoreError("store runs: in use by 'pkm-rig calibrate'"),
        InputError("the clock was set back"),
        RunResult("saw", "check", "the machine is fit"),
        RunResult("saw", "nothing", "nothing is due"),
    ])  # fmt: skip

    def look():
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    watcher = Watcher(look, said.append)
    for _ in range(7):
        watcher.tick()
    assert said == [
        "nothing: nothing is due",
        "skipped: no window",
        "busy: store runs: in use by 'pkm-rig calibrate'",
        "cannot tell: the clock was set back",
        "check: the machine is fit",
        "nothing: nothing is due",
    ]


def test_watching_looks_at_once_and_then_every_so_often():
    looked = []
    watch(lambda: looked.append(len(looked)), every_s=0.01, most=2)
    assert looked == [0, 1]


def test_commands_in_words(run, out):
    path = write_rig(out)
    done = run("recalibrate", "postpone", "--rig", path, "--out", out, "--until", "2099-01-01", "--who", "me")
    assert done.returncode == 2
    assert "--why says nothing" in done.stderr
    done = run("recalibrate", "check", "--dry-run", "--rig", path, "--out", out)
    assert (done.returncode, "--dry-run is for run" in done.stderr) == (2, True)
    done = run("recalibrate", "note", "--rig", path, "--out", out, "--who", "a", "--why", "b", "--event", "party")
    assert (done.returncode, "--event is one of" in done.stderr) == (2, True)
    lost = ("--event", "reference lost", "--part", "middle", "--who", "a", "--why", "b")
    done = run("recalibrate", "note", "--rig", path, "--out", out, *lost)
    assert (done.returncode, "--part middle: no such drive; there are left, right" in done.stderr) == (2, True)
    done = run("recalibrate", "approve", "--rig", path, "--out", out, "--who", "a", "--why", "b")
    assert (done.returncode, "no calibration waits for approval" in done.stderr) == (2, True)
    done = run("recalibrate", "unit", "--rig", path, "--out", out, "--folder", out)
    assert done.returncode == 0
    assert (out / f"pkm-rig-recalibrate-{RIG}.timer").is_file()
    done = run("recalibrate", "check", "--rig", path, "--out", out / "nowhere")
    assert (done.returncode, "there is no store in" in done.stderr) == (2, True)
