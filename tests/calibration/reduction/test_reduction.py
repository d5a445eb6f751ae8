"""Reduction and identification on recordings of the independent plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.identification.calibration import identify_recording
from calibration.identification.model_comparison import model_comparison
from calibration.reduction.figures import noise_floor
from calibration.reduction.nest_checks import drop_unclosed_readings, nest_shift, usable_readings
from calibration.reduction.reduction import reduce
from tests.pkm_rig.plant_recording import plant_of, record

SIZE = {"calibration_poses": 24, "nest_every_visits": 6}


@pytest.fixture(scope="module")
def recording():
    return record(4, **SIZE)


@pytest.fixture(scope="module")
def reduction(recording):
    return reduce(recording)


def test_range_constant_is_found_within_its_uncertainty():
    deviations = []
    for seed in range(1, 13):
        plant, _ = plant_of(seed)
        result = reduce(record(seed, calibration_poses=6, nest_every_visits=3))
        deviations.append((result.range_constant_m - plant.truth.range_constant_m) / result.range_constant_u_m)
    # 12 deviations in units of their uncertainty: the RMS of a normal sample lies within 0.5 and 1.6 (99.9 %).
    assert 0.45 < np.sqrt(np.mean(np.square(deviations))) < 1.7


def test_nothing_is_dropped_from_a_clean_recording(reduction):
    assert reduction.dropped == dict.fromkeys(reduction.dropped, 0)
    assert reduction.poses.measured.all()


def test_noise_floor_agrees_with_the_stated_accuracy(reduction):
    floor = noise_floor(reduction)
    assert floor is not None
    stated = np.sqrt(np.mean(np.trace(reduction.poses.covariance[:, :2, :2], axis1=1, axis2=2)))
    # 48 degrees of freedom in two coordinates: within 35 % (99.99 %), the covariance includes the drift's.
    assert 0.6 * stated < floor.position_rms_m < 1.35 * stated


def test_a_bumped_station_takes_out_the_readings_since_the_last_good_check(recording):
    total = int(recording["nest_check"].max())
    bumped = record(4, bump_m=3e-4, bump_at_check=total, **SIZE)
    _, shifts = nest_shift(bumped)
    assert shifts[-1] > 2.5e-4
    assert (shifts[:-1] < bumped.file.nest_limit_m).all()
    keep = usable_readings(bumped)
    last_good = bumped["nest_check"] == total - 1
    nests = np.asarray(bumped["phase"]) == "nests"
    assert not keep[last_good & ~nests].any()
    assert keep[last_good & nests].all()
    assert keep[bumped["nest_check"] < total - 1].all()
    assert reduce(bumped).dropped["failed nest check"] == np.count_nonzero(~keep)


def test_readings_whose_closing_check_was_left_out_are_none_of_a_diagnosis(recording):
    nests = np.asarray(recording["phase"]) == "nests"
    open_ = (recording["nest_check"] == 2) & ~nests
    kept = ~(nests & (recording["nest_check"] == 3))
    broken = recording.take(kept)
    left = drop_unclosed_readings(broken)
    assert open_.any()
    assert len(broken) - len(left) == np.count_nonzero(open_)
    assert not set(recording["uid"][open_]) & set(left["uid"])
    assert len(drop_unclosed_readings(recording)) == len(recording)


def test_one_wild_reading_is_gated_wherever_it_stands_in_its_visit():
    for smr in ("P1", "P2", "P3"):

        def spoil(row, smr=smr):
            if row["phase"] == "calibration" and row["smr"] == smr and row["visit"] == 7.0:
                row["x_m"] += 4e-4

        result = reduce(record(4, spoil=spoil, **SIZE))
        assert result.dropped["innovation gate"] == 1
        kept = result.observations.smr[result.observations.visit == 7]
        assert result.recording.machine.smrs.index(result.recording.machine.smr(smr)) not in kept


def test_prediction_at_an_unmeasured_payload_reaches_the_floor_and_beats_one_rigid_geometry(recording):
    calibration = identify_recording(recording)
    full = reduce(recording, calibration.reduction)
    floor = noise_floor(full)
    comparison = model_comparison(calibration, full, 1)
    assert comparison["deformation_aware"].position_rms_m < 1.4 * floor.position_rms_m
    for name in ("leave_out_link", "equal_weight_closure"):
        assert comparison[name].position_rms_m > comparison["deformation_aware"].position_rms_m


def test_later_readings_do_not_change_what_was_identified(recording):
    alone = recording.rows("calibration", "nests")
    last = alone["nest_check"][np.asarray(alone["phase"]) == "calibration"].max() + 1
    keep = alone["nest_check"] <= last
    alone = alone.take(keep)
    np.testing.assert_array_equal(
        identify_recording(alone, baselines=False).fit.unknowns,
        identify_recording(recording, baselines=False).fit.unknowns,
    )


def test_a_recording_without_an_unloaded_calibration_is_refused(recording):
    keep = recording["payload"] > 0
    loaded = recording.take(keep)
    with pytest.raises(InputError, match="without payload"):
        reduce(loaded)


def changed(recording, columns):
    return replace(recording, columns={**recording.columns, **columns})


def test_millimetres_taken_for_metres_are_named(recording):
    wide = {c: recording[c] * 1e3 for c in ("x_m", "y_m", "z_m")}
    with pytest.raises(InputError, match=r"reflectors P1 and P2 are .* positions are in millimetres; state metres"):
        reduce(changed(recording, wide))
    with pytest.raises(InputError, match=r"drive left: .* looks as if it were in millimetres"):
        reduce(changed(recording, {"left_actual_m": recording["left_actual_m"] * 1e3}))


def test_mixed_up_reflectors_are_named(recording):
    smr = np.asarray(recording["smr"]).copy()
    smr[smr == "P3"], smr[np.asarray(recording["smr"]) == "P1"] = "P1", "P3"
    with pytest.raises(InputError, match="check which reflector is which"):
        reduce(changed(recording, {"smr": smr}))


def test_poses_from_one_corner_are_named():
    whole = record(4, **{**SIZE, "calibration_poses": 40})
    corner = (whole["target_x_m"] < -0.2) | (np.asarray(whole["phase"]) != "calibration")
    few = whole.take(corner)
    with pytest.raises(InputError, match=r"all poses lie in one corner: x covers \d+ % of the workspace"):
        identify_recording(few, baselines=False)


def test_swapped_reflectors_of_equal_spacing_are_named(recording):
    """P1 and P2 lie alike about P3: only where the commanded poses put them tells."""
    smr = np.asarray(recording["smr"]).copy()
    smr[smr == "P1"], smr[np.asarray(recording["smr"]) == "P2"] = "P2", "P1"
    with pytest.raises(InputError, match="check which reflector is which"):
        identify_recording(changed(recording, {"smr": smr}), baselines=False)
