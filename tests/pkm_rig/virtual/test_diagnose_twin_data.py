"""A twin's data comes from a file: whatever it holds, it is a twin or it is one line."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.diagnosis.diagnose import diagnose_and_add
from calibration.diagnosis.twin import plain_data
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.api import Departure
from calibration.effects.catalogue import load_catalogue
from calibration.machine.description import load_machine, shipped_machine
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording
from mock_devices.effects import EffectChoice
from mock_devices.machine_file import read_machine_file
from mock_devices.recordings.design import DesignOptions, draw_design
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.settings import MockSettings

MACHINE = shipped_machine("planar4")
CATALOGUE = load_catalogue()
BAD = (None, "x", [], {}, [[]], [1.0, "x"], float("inf"), float("nan"), -1, 10**400, 0.5, 1e300)


@pytest.fixture(scope="module")
def made():
    """A twin with an effect that has forces, periods and a past, and its data as a file has them."""
    design = draw_design(read_machine_file(MACHINE), np.random.default_rng(2), DesignOptions(visits=40, poses=30))
    settings = MockSettings(seed=2, effects=(EffectChoice("screw_periodic_error", 8e-5, "left"),))
    made = SimulatedCampaign(MACHINE, settings, design).record()
    columns = {n: c.astype(str if c.dtype.kind in "US" else np.float64) for n, c in made.columns.items()}
    recording = Recording(RecordingFile(**made.header), load_machine(MACHINE), columns)
    _, twin = diagnose_and_add(recording)
    assert twin.added
    return twin, json.loads(json.dumps(twin.to_data(), allow_nan=False))


def leaves(data, path=()):
    """Places in the data: every key, and the last entry of every list."""
    if path:
        yield path
    if isinstance(data, dict):
        for key in data:
            yield from leaves(data[key], (*path, key))
    elif isinstance(data, list) and data:
        yield from leaves(data[-1], (*path, len(data) - 1))


def changed(data, path, value=None, *, without=False):
    out = copy.copy(data)
    at = out
    for step in path[:-1]:
        at[step] = copy.copy(at[step])
        at = at[step]
    if without:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return out


def _one_line(error):
    assert "\n" not in str(error)
    assert len(str(error)) < 500
    return True


def refused_or_sound(twin, data):
    """Whether it is refused, in one line; what is not is used."""
    try:
        other = Twin.from_data(twin.machine.text, data, CATALOGUE)
        places = other.places_m(twin.campaign.context, np.array([0, len(twin.campaign.context) - 1]))
    except InputError as error:
        return _one_line(error)
    assert np.all(np.isfinite(places))
    return False


def test_what_was_written_is_read(made):
    twin, data = made
    again = Twin.from_data(twin.machine.text, data)
    m = twin.campaign.context
    rows = np.arange(0, len(m), 7)
    np.testing.assert_allclose(again.places_m(m, rows), twin.places_m(m, rows), atol=1e-12)
    assert again.to_data() == twin.to_data()


def test_over_what_periods_were_asked_is_kept(made):
    twin, data = made
    other = copy.deepcopy(data)
    other["added"][0]["periods_asked"] += [[0, 2e-4, 6e-2, 0.0, 1.0], [0, 2e-4, 6e-2, -1.0, 1.0]]
    other["added"][0]["periods_m"] += [[0.011], []]
    again = Twin.from_data(twin.machine.text, other)
    assert again.to_data() == other
    answers = again.added[0].answers.periods_m
    assert answers[0, 2e-4, 6e-2, (0.0, 1.0)] == (0.011,)


def test_moments_at_which_strengths_change_are_kept(made):
    """And former files, which have none, are read."""
    twin, data = made
    (added,) = data["added"][:1]
    asked = {"strength_onsets_asked": ["a.0.0", "a.0.1"], "strength_onsets_s": [[300.0, 900.0], []]}
    machine = twin.campaign.machine
    again = plain_data.from_data(machine, {**data, "added": [added | asked]}, CATALOGUE)
    assert again[2][0].answers.strength_onsets_s == {"a.0.0": (300.0, 900.0), "a.0.1": ()}
    assert plain_data.to_data(*again)["added"][0] == added | asked
    former = {key: value for key, value in added.items() if not key.startswith("strength_onsets")}
    again = plain_data.from_data(machine, {**data, "added": [former]}, CATALOGUE)
    assert again[2][0].answers.strength_onsets_s == {}


def test_the_period_of_a_phase_is_kept(made):
    """And former files, whose departures have none, are read."""
    twin, data = made
    (added,), departures = data["added"][:1], [[0, "phase.left", 3, 0.011], [1, "travel.right", 0]]
    again = plain_data.from_data(
        twin.campaign.machine, {**data, "added": [with_departures(added, departures)]}, CATALOGUE
    )
    read = again[2][0].departures
    assert read == (Departure(0, "phase.left", 3, 0.011), Departure(1, "travel.right", 0))
    assert plain_data.to_data(*again)["added"][0]["departures"][0] == departures[0]


def with_departures(added, departures):
    """The data of an effect of the twin with others than its own departures, each with a coefficient."""
    own, more = len(added["columns"]), [1e-6] * len(departures)
    return {
        **added,
        "departures": departures,
        "coefficients": [*added["coefficients"][:own], *more],
        "column_rms": [*added["column_rms"][:own], *more],
    }


def test_a_file_that_was_written_with_other_columns_is_refused(made):
    """Numbers of columns mean what the catalogue makes of them: another version's coefficients would move at random."""
    twin, data = made
    other = copy.deepcopy(data)
    other["added"][0]["columns"] = [column + 1 for column in data["added"][0]["columns"]]
    with pytest.raises(InputError, match="other columns in this version; make it again with diagnose --add"):
        Twin.from_data(twin.machine.text, other)
    with pytest.raises(InputError, match="format '2' is not known; make it again"):
        Twin.from_data(twin.machine.text, data | {"format": 2})


@pytest.mark.parametrize("bad", BAD, ids=lambda v: f"{str(v)[:8]}")
def test_any_wrong_value_is_one_line(made, bad):
    twin, data = made
    refused = [refused_or_sound(twin, changed(data, path, bad)) for path in leaves(data)]
    assert sum(refused) > 0.3 * len(refused)


def test_anything_that_is_missing_is_one_line(made):
    """But for following errors and breaks, which files of older versions do not have."""
    twin, data = made
    refused = {path: refused_or_sound(twin, changed(data, path, without=True)) for path in leaves(data)}
    assert not refused.pop(("moments", "following_error_m"))
    assert not refused.pop(("breaks_s",))
    assert all(refused[(key,)] for key in data if key != "breaks_s")
    assert all(refused[path] for path in refused if path[0] in ("fit", "linear_at", "moments", "history"))


@pytest.mark.parametrize("data", [None, [], "x", 3, {}, {"format": 1}])
def test_what_is_no_twin_at_all_is_one_line(made, data):
    assert refused_or_sound(made[0], data)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("fit", "frame", "rotation"), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]),
        (("fit", "frame", "rotation"), [[2.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0]]),
        (("moments", "arrival", 0), -1),
        (("moments", "arrival", 0), 10**6),
        (("added", 0, "place"), 2),
        (("added", 0, "place"), -1),
        (("added", 0, "columns", 0), 999),
        (("added", 0, "columns", 0), -1),
        (("added", 0, "coefficients"), [1e-6]),
        (("added", 0, "coefficients", 0), 1e300),
        (("added", 0, "periods_m", 0, 0), 0),
        (("added", 0, "periods_m"), []),
        (("added", 0, "periods_asked"), []),
        (("added", 0, "periods_asked", 0, 0), 0.5),
        (("added", 0, "periods_asked", 0), [0, 1e-3, 1e-2, 1.0]),
        (("added", 0, "periods_asked", 0), [0, 1e-3, 1e-2, 1.0, 1.0, 1.0]),
        (("added", 0, "periods_asked", 0), [0, 1e-3, 1e-2, 1.0, "x"]),
        (("added", 0, "onsets_asked"), [["travel.left"]]),
        (("added", 0, "strength_onsets_asked"), [3.0]),
        (("added", 0, "strength_onsets_asked"), ["no.answer"]),
        (("added", 0, "strength_onsets_s"), [[1.0, "x"]]),
        (("added", 0, "effect"), "no\nsuch"),
        (("start_s",), "soon"),
        (("fit", "values", 0), 1e4),
        (("visit", 0), 5),
        (("smr", 0), 99),
        (("temperatures_c",), {}),
        (("history",), {"arrived_s": [], "drives": []}),
        (("moments", "drives"), [[1.1, 1.1]]),
    ],
)
def test_values_that_contradict_each_other_are_one_line(made, path, value):
    twin, data = made
    assert refused_or_sound(twin, changed(data, path, value))


def test_a_machine_file_of_another_machine_is_one_line(made):
    _, data = made
    for name in ("hexaglide", "rrr3"):
        text = shipped_machine(name).read_text(encoding="utf-8")
        with pytest.raises(InputError) as caught:
            Twin.from_data(text, data)
        assert "\n" not in str(caught.value)
