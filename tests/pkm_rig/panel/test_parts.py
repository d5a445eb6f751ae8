"""What pages show and take, without a browser: the machine's picture, uploads, files by id, the running estimate."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.identification.calibration import identify_recording
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.inverse import nominal_drives, platform_poses
from pkm_rig.jobs.running_estimate import estimate_so_far
from pkm_rig.jobs.session import open_rig
from pkm_rig.panel.actions import MOST_UPLOAD_BYTES, Action, read_visits, what_moves
from pkm_rig.panel.files import next_measurements, picture_of, pictures_of, report_of, report_url
from pkm_rig.panel.server import LOOPBACK, Place, require_nicegui, require_place
from pkm_rig.panel.trend import trend_svg
from pkm_rig.panel.work import Work
from pkm_rig.results.estimate import Estimate
from pkm_rig.rig.config import demo_rig_path, embedded_rig_path, load_rig
from pkm_rig.rig.live import Live
from pkm_rig.rig.tool_place import places, platform_pose
from pkm_rig.rig.visits_file import with_visits
from pkm_rig.store.store import open_store
from tests.pkm_rig.plant_recording import record


@dataclass(frozen=True)
class Shown:
    """A page that only looks on."""

    work: Work
    has_control: bool = False

    def press(self, action):
        raise AssertionError(action)

    say = pause = press


VISITS = "[campaign]\n[[campaign.visits]]\ntarget = [0.1, 0.2]\n[[campaign.visits]]\ntarget = [0.2, 0.1]\n"


@pytest.mark.parametrize("name", ["planar4", "delta6", "stewart6", "rrr3"])
def test_the_machine_is_found_from_its_drives(name):
    machine = load_machine(shipped_machine(name))
    low, high = machine.commanded_limits.T
    for share in (0.2, 0.5, 0.9):
        pose = platform_poses(machine, (low + share * (high - low))[None])[0]
        drives = nominal_drives(machine, pose[None])[0]
        found = platform_pose(machine, drives)
        assert found is not None
        np.testing.assert_allclose(found, pose, atol=2e-4)
        parts = places(machine, drives, found)
        lengths = np.linalg.norm(parts.struts[:, 0] - parts.struts[:, 1], axis=1)
        sliders = np.array([machine.drive_kinds[d] != "leg" if d >= 0 else True for d in machine.strut_drive])
        np.testing.assert_allclose(lengths[sliders], machine.nominal.length_m[sliders], atol=2e-3)


def test_drives_that_no_pose_has_give_no_place():
    machine = load_machine(shipped_machine("planar4"))
    assert platform_pose(machine, np.array([50.0, -50.0])) is None


def test_the_picture_has_less_than_a_hundred_objects():
    view = pytest.importorskip("pkm_rig.panel.machine_view", reason="NiceGUI, the extra [ui], is not installed")
    file, machine = load_rig(embedded_rig_path())
    live = Live()
    live.aiming_at("P1")
    live.going_to(np.array([0.1, 0.1, 0.0, 0.0, 0.0, 0.0]), 7)
    scene = view.Scenes(machine, file).of(live.snapshot())
    assert 10 < len(scene["lines"]) + len(scene["balls"]) + 1 < 100
    assert [ball[3] for ball in scene["balls"] if ball[1] == "target"] == ["target 7"]
    assert sum(line[2] == "sight" for line in scene["lines"]) == 1
    assert sum(line[2] == "strut" for line in scene["lines"]) == 4
    mesh = view.mesh_of(np.zeros((4, 3)), np.array([0.0, 1e-5, 2e-5, 4e-5]), 2)
    assert mesh["shares"] == [0.0, 0.25, 0.5, 1.0]


def test_what_is_shown_already_is_neither_computed_nor_sent_again(tmp_path, monkeypatch):
    """A page is drawn in the process that supervises the rig."""
    pytest.importorskip("nicegui", reason="NiceGUI, the extra [ui], is not installed")
    require_nicegui()
    from nicegui import Client, ui  # noqa: PLC0415
    from nicegui.page import page  # noqa: PLC0415

    from pkm_rig.panel import machine_view  # noqa: PLC0415
    from pkm_rig.panel.measure_view import MeasureView  # noqa: PLC0415

    work = Work(embedded_rig_path(), tmp_path, open_rig)
    row = {"sequence": 0, "phase": "calibration", "smr": "P1", "pose": 0, "slope_distance_m": 3.0, "t_rig_s": 0.0}
    with Client(page("/"), request=None) as client:
        view = MeasureView(Shown(work))
        monkeypatch.delattr(machine_view, "nominal_drives")  # what does not move has been solved for
        sent = client.outbox.updates
        for sequence in (1, 2):
            work.live.reading({**row, "sequence": sequence}, np.zeros(3))
            work.live.notify("see `pkm-rig tables`")
            view.refresh(work.live.snapshot())
            assert {ui.table, ui.label} <= {type(element) for element in sent.values()}
            sent.clear()
            view.refresh(work.live.snapshot())
            assert not dict(sent)
    work.close()


PLANAR = load_machine(shipped_machine("planar4"))
TABLE = (
    "target_x_m,target_y_m,payload,speed_m_per_s,left_direction,right_direction\n0.1,0.2,0,,1,-1\n0.2,0.1,2,0.3,1,1\n"
)


def test_an_upload_is_read_as_the_command_reads_it(tmp_path):
    assert len(read_visits("next.toml", VISITS.encode(), PLANAR).file.campaign.visits) == 2
    found = read_visits("Table.CSV", TABLE.encode(), PLANAR).file.campaign.visits
    assert [visit.target for visit in found] == [(0.1, 0.2), (0.2, 0.1)]
    assert [visit.direction for visit in found] == [(1, -1), (1, 1)]
    assert [(visit.payload, visit.speed_m_per_s, visit.dwell_s) for visit in found] == [(0, None, None), (2, 0.3, None)]
    (tmp_path / "table.csv").write_text(TABLE, encoding="utf-8")
    file, machine = load_rig(embedded_rig_path())
    assert with_visits(file, tmp_path / "table.csv", machine).campaign.visits == found
    assert (
        "payloads, one after the other: none, plates 400 kg"
        in what_moves(Action("measure", visits=read_visits("t.csv", TABLE.encode(), machine)), file, machine).lower()
    )


@pytest.mark.parametrize(
    ("path", "said"),
    [(embedded_rig_path(), "Compensation tables are written"), (demo_rig_path("rrr4"), "This computer corrects")],
)
def test_the_second_press_says_what_corrects(path, said):
    assert said in what_moves(Action("calibrate"), *load_rig(path))
    assert "Compensation is switched off" in what_moves(Action("measure"), *load_rig(path))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "nothing in it; it needs a header and rows"),
        ("target_x_m,target_z_m\n0,0\n", "no column 'target_y_m'"),
        ("target_x_m,target_y_m,path\n0,0,1\n", "unknown column 'path'"),
        ("target_x_m,target_y_m\n", "no rows"),
        ("target_x_m,target_y_m\n0,nan\n", "line 2, column 'target_y_m': 'nan' is not finite"),
        ("target_x_m,target_y_m,left_direction\n0,0,1\n", "no column 'right_direction'"),
        ("target_x_m,target_y_m,left_direction,right_direction\n0,0,1,2\n", "line 2, direction"),
        ("target_x_m,target_y_m,payload\n0,0,0.5\n", "is not a count"),
        ("target_x_m,target_y_m,speed_m_per_s\n0,0,9\n", "line 2, speed_m_per_s: .* less than or equal to 2"),
        ("target_x_m,target_y_m\n" + "0,0\n" * 2001, "more than 2000 visits"),
    ],
)
def test_what_is_no_table_of_visits_is_refused_in_one_line(text, complaint):
    with pytest.raises(InputError, match=complaint) as refused:
        read_visits("t.csv", text.encode(), PLANAR)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("data", "complaint"),
    [
        (b"x" * (MOST_UPLOAD_BYTES + 1), "more than"),
        (b"\xff\xfe", "not UTF-8"),
        (b"campaign = ", "not TOML"),
        (b"[campaign]\nvisits = []\n", "visits"),
        (VISITS.encode() + b"[station]\nport = '/dev/ttyS0'\n", "unknown key"),
        (b"[campaign]\nvisits = " + b"[" * 5000, "nested|TOML|deep"),
    ],
)
def test_what_is_no_campaign_file_is_refused_in_one_line(data, complaint):
    with pytest.raises(InputError, match=complaint) as refused:
        read_visits("next.toml", data, PLANAR)
    assert "\n" not in str(refused.value)


def test_files_are_found_by_campaigns_of_the_store_only(tmp_path):
    out = tmp_path / "runs"
    recording = record(3)
    campaign = recording.file.campaign
    with open_store(out) as store:
        store.add_recording(recording)
    (tmp_path / "report.html").write_text("secret", encoding="utf-8")
    (out / campaign / "diagnosis").mkdir(parents=True)
    (out / campaign / "report.html").write_text("report", encoding="utf-8")
    (out / campaign / "diagnosis" / "error-map.png").write_bytes(b"png")
    (out / campaign / "diagnosis" / "time-line.png").symlink_to(tmp_path / "report.html")
    (out / campaign / "diagnosis" / "next-1-a.toml").write_text(VISITS, encoding="utf-8")
    (out / "other").mkdir()
    (out / "other" / "report.html").write_text("other", encoding="utf-8")
    assert report_of(out, campaign) == (out / campaign / "report.html").resolve()
    assert pictures_of(out, campaign) == ["error-map"]  # what leads elsewhere is not there
    assert [visits.name for visits in next_measurements(out, campaign, PLANAR)] == ["next-1-a"]
    for name in ("..", "../..", "other", "", "/etc", f"{campaign}/.."):
        assert report_of(out, name) is None
        assert next_measurements(out, name, PLANAR) == []
    for name in ("../report", "../../report", "next-1-a.toml", ""):
        assert picture_of(out, campaign, name) is None
    assert report_of(tmp_path / "nowhere", campaign) is None
    assert report_url("a/../b c") == "/campaign/a%2F..%2Fb%20c/report"


def test_beyond_loopback_only_tls_is_served():
    for host in LOOPBACK:
        require_place(Place(host))
    for host in ("0.0.0.0", "192.168.1.5", "rig.example"):
        with pytest.raises(InputError, match="only over TLS"):
            require_place(Place(host))
    with pytest.raises(InputError, match="both"):
        require_place(Place(certificate=embedded_rig_path()))
    with pytest.raises(InputError, match="every address"):
        require_place(Place("0.0.0.0", certificate=embedded_rig_path(), key=embedded_rig_path()))
    with pytest.raises(InputError, match="certificate"):
        require_place(Place("rig.example", certificate=embedded_rig_path(), key=embedded_rig_path()))


def test_what_a_campaign_has_told_so_far_is_what_identification_says():
    recording = record(3)
    estimate = Estimate.of_dict(json.loads(json.dumps(estimate_so_far(recording).as_dict())))
    fit = identify_recording(recording, baselines=False).fit
    shares = fit.theta_u / fit.model.parameters.sigma
    assert estimate.readings == len(recording)
    assert estimate.share_left == pytest.approx(float(np.prod(shares) ** (1.0 / shares.size)))
    assert estimate.share_left < 1.0
    assert estimate.field_error_m.shape == (estimate.columns**2,)
    with pytest.raises(InputError):
        estimate_so_far(recording.take(np.arange(3)))


def test_a_diagnosis_in_a_few_lines_says_what_an_effect_takes_away_only_where_there_is_one():
    view = pytest.importorskip("pkm_rig.panel.history_view", reason="NiceGUI, the extra [ui], is not installed")
    effect = {"effect": "backlash", "place": "left", "value": 2e-5, "u": 1e-6, "unit": "m", "probability": 0.97}
    found = {
        "verdict": "backlash", "effects": [effect], "gap": {"before_m": 4e-6, "after_m": 2.3e-6},
        "next_measurement": [{"name": "random poses", "adds": "poses off the campaign's", "minutes": 47.2}],
    }  # fmt: skip
    assert view.diagnosis_lines(found) == [
        "diagnosis: backlash",
        "backlash at left, 20.0 +- 2.0 um, probability 0.97",
        "gap on withheld data: 4.0 um, 2.3 um with it",
        "to measure next: random poses: poses off the campaign's, 47 min",
    ]
    nothing = view.diagnosis_lines(found | {"verdict": "none", "effects": []})
    assert nothing[:2] == ["diagnosis: no effect beyond the model", "gap on withheld data: 4.0 um"]


def test_the_trend_is_made_of_numbers():
    assert trend_svg([], []) == ""
    drawn = trend_svg([30, 60, 120], [0.9, 0.5, 0.25])
    assert drawn.count("<circle") == 3
    assert "after 120 readings: 25 %" in drawn
