"""What may be diagnosed, and what the calibration with its priors takes out of a recording."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings.remarks import _far_off
from calibration.diagnosis.linear_model import LinearModel, linearise_recording, usable_rows
from calibration.recording.header import DeclaredLevels
from calibration.recording.recording import make_recording
from calibration.reduction.left_out import GIANT
from mock_devices.settings import DisturbanceLevels
from tests.calibration.diagnosis.campaigns import changed, moved, plant, recorded, simulated


def chi2_ratio(linear: LinearModel) -> float:
    return float(
        linear.residual.ravel() @ MarginalLikelihood.of(linear).weighted_residual.ravel() / linear.residual.size
    )


def refused(recording, match: str) -> None:
    with pytest.raises(InputError, match=match) as caught:
        diagnose(recording)
    assert "\n" not in str(caught.value)


def test_what_is_held_stays_and_the_rest_is_fitted_beside_it():
    recording = simulated("planar4", 40, seed=3)
    free = linearise_recording(recording)
    held = {name: 0.5 * free.sigma[free.names.index(name)] for name in free.names[:2]}
    linear = linearise_recording(recording, held=held)
    np.testing.assert_allclose(linear.values[:2], list(held.values()), rtol=1e-12)
    assert np.all(free.values[:2] != linear.values[:2])
    assert np.any(np.abs(linear.values - free.values)[2:] > 0.01 * free.sigma[2 : len(free.values)])


@pytest.mark.parametrize("name", ["planar4", "delta8", "gough8"])
def test_machines_within_their_tolerances_are_explained_down_to_noise(name):
    """The true machine is drawn within the tolerances and solved as a whole, not linearised."""
    linear = linearise_recording(simulated(name, 40, seed=3))
    spread = np.sqrt(2.0 / linear.residual.size)
    assert chi2_ratio(linear) == pytest.approx(1.0, abs=5.0 * spread)


def test_declared_nuisance_is_explained_and_undeclared_is_not():
    levels = DisturbanceLevels(drift_m=1e-5, reseat_m=8e-6, reversal_m=5e-6, temperature_k=0.05)
    recording = recorded(plant(60, nuisance=levels, seed=2))
    silent = replace(recording, file=replace_nuisance(recording.file))
    declared, undeclared = (chi2_ratio(linearise_recording(r)) for r in (recording, silent))
    assert declared == pytest.approx(1.0, abs=0.15)
    assert undeclared > declared + 0.1


def replace_nuisance(file):
    return file.model_copy(update={"nuisance": type(file.nuisance)()})


def displaced(recording, seat, along, shift_m: float, seed: int = 7):
    """The recording with reflectors seated anew: `seat` gives each reading a key, all of one key move together, along
    directions (3, k) in the station's frame."""
    rng, moved = np.random.default_rng(seed), {}
    place = np.stack([recording[name] for name in ("x_m", "y_m", "z_m")], axis=1).copy()
    for row in range(len(place)):
        if (key := seat(row)) is not None:
            place[row] += moved.setdefault(key, along @ (shift_m * rng.standard_normal(along.shape[1])))
    distance = np.linalg.norm(place, axis=1)
    return changed(
        recording, x_m=place[:, 0], y_m=place[:, 1], z_m=place[:, 2], slope_distance_m=distance,
        hz_rad=np.arctan2(place[:, 0], place[:, 1]) % (2.0 * np.pi), v_rad=np.arccos(place[:, 2] / distance),
    )  # fmt: skip


@pytest.mark.parametrize(("on", "level_m"), [("platform", 3e-4), ("slider", 2e-5), ("floor", 2e-5)])
def test_reflectors_are_put_back_anywhere_and_in_any_direction(on, level_m):
    """Those on sliders at an exchange of payload, those in floor nests at each check; those on the platform, which have
    seats in the plane of the machine anyway, also across it, where ranges of 0.1 mm hardly show it."""
    recording = recorded(plant(60, seed=2))
    recording = replace(
        recording, file=recording.file.model_copy(update={"nuisance": DeclaredLevels(reseat_m=level_m)})
    )
    smr, payload = recording["smr"], recording["payload"]
    exchange = np.cumsum(np.diff(payload, prepend=payload[0]) != 0.0)
    of = {s.name: s.on for s in recording.machine.smrs}
    time = exchange if on != "floor" else recording["nest_check"]
    across = linearise_recording(recording, judge=False).frame.rotation[:, 2:]
    along = across if on == "platform" else np.eye(3)
    seated = displaced(recording, lambda row: (smr[row], time[row]) if of[smr[row]] == on else None, along, level_m)
    silent = replace(seated, file=replace_nuisance(seated.file))

    def chi2_of_these(one) -> float:
        linear = linearise_recording(one, judge=False)
        rows = [of[name] == on for name in smr[linear.rows]]
        return float(np.mean((linear.residual * MarginalLikelihood.of(linear).weighted_residual)[rows]))

    declared, undeclared = chi2_of_these(seated), chi2_of_these(silent)
    assert declared == pytest.approx(1.0, abs=0.25)
    assert undeclared > 1.5


@pytest.mark.parametrize("hours", [0.3, 1.0, 2.0])
def test_drift_has_the_declared_variance(hours):
    """A random walk: the declared level after one hour over two axes, and the station's own."""
    levels = DisturbanceLevels(drift_m=2e-5)
    linear = linearise_recording(recorded(plant(80, nuisance=levels)))
    columns = [k for k, name in enumerate(linear.names) if name.startswith("drift.station.x")]
    metres = np.linalg.solve(linear.whiten, linear.columns[:, :, columns])
    variance = np.sum(metres[:, 0] ** 2, axis=1)
    elapsed = linear.context.elapsed_s / 3600.0
    own = linear.recording.file.station.accuracy.drift_m_per_sqrt_h
    near = np.abs(elapsed - min(hours, 0.9 * elapsed.max())) < 0.05 * elapsed.max()
    expected = (own**2 + levels.drift_m**2 / 2.0) * elapsed[near]
    assert variance[near] == pytest.approx(expected, rel=0.1)


def test_reseating_begins_with_an_exchange(wandering, small):
    columns = [k for k, name in enumerate(small.names) if name.startswith("reseat.smr.P1.x")]
    assert len(columns) == len(np.unique(small.context.exchanges)) - 1
    metres = np.linalg.solve(small.whiten, small.columns[:, :, columns])
    size = np.linalg.norm(metres, axis=1)
    p1 = (small.smr == 0) & (small.visit >= 0)
    assert np.all(size[small.context.exchanges == 0.0] == 0.0)
    assert np.sum(size[p1 & (small.context.exchanges > 0.0)] ** 2, axis=1) == pytest.approx(
        wandering.file.nuisance.reseat_m**2
    )


def test_rows_that_a_diagnosis_uses(wandering):
    phase = np.asarray(wandering["phase"])
    flags, compensation = np.zeros(len(wandering)), np.zeros(len(wandering))
    pose = np.flatnonzero(phase == "calibration")
    flags[pose[:7]], compensation[pose[7:9]] = 1.0, 2.0
    later = phase.copy().astype("U30")
    later[pose[-5:]] = "verification_after"
    kept = usable_rows(changed(wandering, flags=flags, compensation=compensation, phase=later))
    assert set(kept) == set(range(len(wandering))) - set(pose[:9]) - set(pose[-5:])


def test_rows_and_readings_belong_together(wandering, small):
    names = np.array([s.name for s in small.machine.smrs])[small.smr]
    assert np.array_equal(names, np.asarray(wandering["smr"])[small.rows])
    assert np.array_equal(small.position_m, wandering.positions_m[small.rows])
    assert np.array_equal(small.visit < 0, np.asarray(wandering["phase"])[small.rows] == "nests")


def shifted(recording, rows, metres):
    """A recording with some readings off across the line of sight."""
    x = recording["x_m"].copy()
    x[rows] += metres
    return changed(recording, x_m=x)


def test_few_readings_that_are_far_off_change_little():
    recording = recorded(plant(80))
    on_platform = np.flatnonzero(np.char.startswith(np.asarray(recording["smr"]), "P"))
    rows = np.random.default_rng(2).choice(on_platform, 3, replace=False)
    diagnosis = diagnose(shifted(recording, rows, 1.5e-4))
    assert diagnosis.verdict == "none"
    assert not any("too many to be left out" in remark for remark in diagnosis.remarks)
    uids = np.asarray(recording["uid"]).tolist()
    found = {uids.index(reading.name): reading for reading in diagnosis.left_out}
    assert set(found) == set(rows.tolist())
    for row, reading in found.items():
        assert (reading.of, reading.visit) == (recording["smr"][row], recording["visit"][row])
        assert reading.t_rig_s == recording["t_rig_s"][row]
        assert 1.3e-4 < reading.size < 4e-4  # with the noise along the line of sight
        assert (reading.unit, reading.reason) == ("m", "diagnosis gate")
        assert 6.0 < reading.sigmas < 40.0


@pytest.mark.parametrize(("share", "size_m"), [(0.25, 1e-3), (0.3, 1e-2)])
def test_many_readings_that_are_far_off_are_kept_and_remarked(share, size_m):
    """A quarter off by a millimetre, or more by more: all others are off as well."""
    recording = recorded(plant(80))
    rng = np.random.default_rng(2)
    on_platform = np.flatnonzero(np.char.startswith(np.asarray(recording["smr"]), "P"))
    rows = rng.choice(on_platform, round(share * len(recording)), replace=False)
    linear = linearise_recording(shifted(recording, rows, size_m * rng.standard_normal(len(rows))))
    assert len(linear.left_out) < 0.02 * len(recording)
    (remark,) = _far_off(linear)
    count, total, nearest, farthest = (int(number) for number in re.findall(r"\d+", remark))
    assert 0.025 * total < count == linear.far_off.size
    assert total == len(linear.residual)
    assert 6 <= nearest < farthest
    assert "so they were kept; unless an effect that is named explains them, check" in remark


def test_grossly_wrong_readings_are_left_out_and_nothing_else(wandering):
    """Five millimetres off, one on each part: the rest is linearised as if they had never been made."""
    on = {smr.name: smr.on for smr in wandering.machine.smrs}
    parts = np.array([on[name] for name in wandering["smr"].tolist()])
    usable = np.isin(np.arange(len(wandering)), usable_rows(wandering))
    rows = np.array([np.flatnonzero(usable & (parts == part))[7] for part in ("platform", "slider", "floor")])
    linear = linearise_recording(shifted(wandering, rows, 5e-3))
    assert linear.wrong.tolist() == sorted(rows.tolist())
    assert not set(rows.tolist()) & set(linear.rows.tolist())
    alone = linearise_recording(wandering.take(np.delete(np.arange(len(wandering)), rows)))
    # Of the temperatures that were read with them their parts' are made as well.
    np.testing.assert_allclose(linear.residual, alone.residual, atol=5e-3)


def test_what_is_wrong_beside_giants_is_found_once_these_are_gone(wandering):
    """Ten millimetres off, and at another visit a fifth of one."""
    on_platform = np.char.startswith(np.asarray(wandering["smr"]), "P")
    usable = np.isin(np.arange(len(wandering)), usable_rows(wandering))
    giant, small = np.flatnonzero(usable & on_platform)[[11, 97]]
    linear = linearise_recording(shifted(shifted(wandering, [giant], 1e-2), [small], 2e-4))
    assert linear.wrong.tolist() == sorted([giant, small])
    uid = wandering["uid"]
    found = {reading.name: (reading.reason, round(reading.size, 4)) for reading in linear.left_out}
    assert found == {uid[giant]: ("giant", 0.01), uid[small]: ("diagnosis gate", 0.0002)}


def test_a_strong_effect_of_few_readings_is_none_that_is_left_out(wandering):
    """Ten standard deviations at one visit in sixty, as after a short dwell: the rows keep their place."""
    rows = np.flatnonzero((wandering["visit"] % 60 == 7) & (np.asarray(wandering["phase"]) == "calibration"))
    assert rows.size > 0
    linear = linearise_recording(shifted(wandering, rows, 7e-5))
    assert linear.wrong.size == 0


def test_many_readings_that_are_far_off_count_fully(wandering):
    rows = np.flatnonzero((np.asarray(wandering["smr"]) == "P1") & (wandering["visit"] % 2 == 0))
    plain, far = linearise_recording(wandering), linearise_recording(shifted(wandering, rows, 1.5e-4))
    assert np.linalg.det(far.whiten) == pytest.approx(np.linalg.det(plain.whiten), rel=0.01)


def test_flagged_readings_alone_are_refused(wandering):
    refused(changed(wandering, flags=np.ones(len(wandering))), "unflagged")


def test_compensated_readings_alone_are_refused(wandering):
    refused(changed(wandering, compensation=np.ones(len(wandering))), "without compensation")


def test_nests_alone_are_refused(wandering):
    rows = np.asarray(wandering["phase"]) == "nests"
    refused(wandering.take(rows), "campaign")


@pytest.mark.parametrize("visits", [1, 2])
def test_too_few_visits_are_refused(wandering, visits):
    rows = wandering["visit"] < visits
    refused(wandering.take(rows), "campaign|pose|visit")


def test_drives_that_no_pose_has_are_refused(wandering):
    refused(changed(wandering, left_actual_m=wandering["left_actual_m"] + 5.0), "equilibrium|drive")


def test_a_missing_column_is_named(wandering):
    refused(without(wandering, "dwell_s"), "dwell_s")
    refused(without(wandering, "left_torque_ratio"), "left_torque_ratio")


def without(recording, name):
    return replace(recording, columns={n: c for n, c in recording.columns.items() if n != name})


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("column", ["x_m", "left_actual_m", "dwell_s", "struts_temperature_c"])
def test_what_is_not_finite_cannot_come_in(wandering, column, value):
    values = wandering[column].copy()
    values[3] = value
    columns = changed(wandering, **{column: values}).columns
    rows = [
        dict(zip(columns, cells, strict=True)) for cells in zip(*(c.tolist() for c in columns.values()), strict=True)
    ]
    with pytest.raises(InputError, match=f"'{column}' is not finite"):
        make_recording(wandering.file, wandering.machine, rows)


@pytest.mark.parametrize(("count", "by_m"), [(1, 10.0), (1, 3.0), (6, 1.0)])
def test_a_reading_of_quite_another_place_does_not_spoil_the_fit(count, by_m):
    """As of another reflector, or of a mirror image. Its fit would end far from every machine."""
    recording = simulated("planar4", 40, seed=3)
    rows = np.flatnonzero(recording["phase"] == "calibration")[7 : 7 + 11 * count : 11]
    linear = linearise_recording(moved(recording, rows, by_m))
    assert {reading.name for reading in linear.left_out} == set(recording["uid"][rows])
    assert all(reading.reason == GIANT for reading in linear.left_out)
    assert [reading.size for reading in linear.left_out] == pytest.approx([by_m] * count, rel=0.01)
    plain = linearise_recording(recording.take(np.setdiff1d(np.arange(len(recording)), rows)))
    np.testing.assert_allclose(linear.residual, plain.residual, atol=1e-6)
