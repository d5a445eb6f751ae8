"""Tables that a recording knows: between their nodes, beyond them, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.interpolate import RegularGridInterpolator

from calibration.base.toml_file import parse_toml
from calibration.base.toml_text import to_toml
from calibration.recording.header import KnownTable, RecordingFile
from tests.calibration.diagnosis.campaigns import simulated

OWN_M, PARTNER_M = (0.3, 0.45, 1.0), (0.2, 0.8)
CORRECTIONS_M = ((1e-5, 2e-5), (0.0, -3e-5), (4e-5, 5e-5))
TABLE = KnownTable(
    generation=2, drive="left", own_m=OWN_M, partner="right", partner_m=PARTNER_M, corrections_m=CORRECTIONS_M
)
ALONE = KnownTable(generation=2, drive="right", own_m=PARTNER_M, corrections_m=((1e-5,), (3e-5,)))


@pytest.fixture(scope="module")
def header() -> RecordingFile:
    return simulated("planar4", 20).file


@given(st.lists(st.tuples(st.floats(-2.0, 3.0), st.floats(-2.0, 3.0)), min_size=1, max_size=20))
def test_a_table_is_bilinear_and_held_at_its_edge(points):
    own, partner = np.array(points).T
    at_edge = np.column_stack([np.clip(own, 0.3, 1.0), np.clip(partner, 0.2, 0.8)])
    expected = RegularGridInterpolator((OWN_M, PARTNER_M), np.array(CORRECTIONS_M))(at_edge)
    np.testing.assert_allclose(TABLE.correction_m(own, partner), expected, atol=1e-15)


def test_a_table_without_a_partner_depends_on_its_own_drive_alone():
    own = np.array([0.0, 0.2, 0.5, 0.8, 2.0])
    expected = [1e-5, 1e-5, 2e-5, 3e-5, 3e-5]
    np.testing.assert_allclose(ALONE.correction_m(own, np.full(5, 7.0)), expected, atol=1e-15)


@given(st.lists(st.tuples(st.floats(-2.0, 3.0), st.floats(-2.0, 3.0)), min_size=1, max_size=20))
def test_a_table_that_is_not_interpolated_has_what_its_nodes_have(points):
    own, partner = np.array(points).T
    below_m = [max((node for node in OWN_M if node <= q), default=OWN_M[0]) for q in own]
    above_m = [min((node for node in OWN_M if node >= q), default=OWN_M[-1]) for q in own]
    partner_below_m = [max((node for node in PARTNER_M if node <= q), default=PARTNER_M[0]) for q in partner]
    expected = [
        TABLE.correction_m(np.array(at), np.array(beside))
        for at, beside in ((below_m, partner), (above_m, partner), (below_m, partner_below_m))
    ]
    np.testing.assert_allclose(TABLE.at_nodes_m(own, partner), np.column_stack(expected), atol=1e-15)
    np.testing.assert_array_equal(ALONE.at_nodes_m(np.array([0.2, 0.5, 0.8]), np.zeros(3))[:, 0], [1e-5, 1e-5, 3e-5])


def test_known_tables_are_written_and_read_again(header):
    file = header.model_copy(update={"known_tables": (TABLE, ALONE)})
    assert parse_toml(to_toml(file), RecordingFile, "it") == file
    assert RecordingFile(**file.model_dump(mode="json")) == file  # as a store keeps it
    assert "known_tables" not in to_toml(header)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"own_m": (0.3, 0.3, 1.0)}, "rise"),
        ({"partner_m": (0.8, 0.2)}, "rise"),
        ({"own_m": (0.3,)}, "own_m"),
        ({"own_m": (0.3, math.nan, 1.0)}, "own_m"),
        ({"partner": None}, "go together"),
        ({"partner_m": None}, "go together"),
        ({"partner": "left"}, "the drive itself"),
        ({"corrections_m": CORRECTIONS_M[:2]}, "3 lists of 2"),
        ({"corrections_m": ((0.0,), (0.0,), (0.0,))}, "3 lists of 2"),
        ({"corrections_m": ((0.0, math.inf), *CORRECTIONS_M[1:])}, "corrections_m"),
        ({"generation": 0}, "generation"),
    ],
)
def test_a_table_that_is_none_is_refused(changes, complaint):
    with pytest.raises(ValidationError, match=complaint):
        KnownTable(**TABLE.model_dump() | changes)


def test_tables_are_of_the_drives_and_one_each(header):
    for tables, complaint in (
        ((TABLE, TABLE), "two known tables of generation 2 for 'left'"),
        ((TABLE.model_copy(update={"drive": "middle"}),), "of 'middle', the drives are left, right"),
        ((TABLE.model_copy(update={"partner": "middle"}),), "of 'middle'"),
    ):
        with pytest.raises(ValidationError, match=complaint):
            RecordingFile(**header.model_dump() | {"known_tables": tables})
