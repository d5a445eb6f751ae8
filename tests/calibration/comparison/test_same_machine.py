"""What cannot be compared is refused in one line; tables are taken off as they were put on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.comparison.compare import compare
from calibration.comparison.same_machine import require_one_machine, shared_reflectors, without_tables
from calibration.machine.description import load_machine, parse_machine, shipped_machine
from calibration.recording.header import KnownTable
from calibration.recording.recording import Recording
from tests.calibration.comparison.pairs import first, recorded


def with_machine(recording: Recording, *changes: tuple[str, str]) -> Recording:
    text = recording.machine.text
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return replace(recording, machine=parse_machine(text, "machine.toml"))


def refusal(before: Recording, after: Recording) -> str:
    with pytest.raises(InputError) as refused:
        compare(before, after)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_another_machine_is_refused():
    other = replace(recorded(), machine=load_machine(shipped_machine("delta6")))
    assert "different machines, planar4 and delta6" in refusal(first(), other)


def test_another_rig_is_refused():
    after = recorded()
    other = replace(after, file=after.file.model_copy(update={"rig": "hall-2"}))
    assert "different rigs, mock and hall-2" in refusal(first(), other)


def test_renamed_struts_are_refused():
    message = refusal(first(), with_machine(recorded(), ("left_upper", "strut_a")))
    assert "struts have other names (left_upper, strut_a)" in message
    assert "one machine file" in message


def test_other_nominal_values_are_refused():
    assert "differ in right_lower" in refusal(
        first(), with_machine(recorded(), ("base_joint_m = [1.2, -0.125, 0.0]", "base_joint_m = [1.2, -0.126, 0.0]"))
    )
    assert "differ in tolerances" in refusal(
        first(), with_machine(recorded(), ("ln_stiffness = 0.3", "ln_stiffness = 0.2"))
    )


def test_comments_and_the_order_of_tables_are_no_difference():
    require_one_machine(
        first(), with_machine(recorded(), ('format = 1\nname = "planar4"', 'name = "planar4"\nformat = 1'))
    )


def test_a_campaign_with_itself_is_refused():
    assert "the same campaign twice" in refusal(first(), first())
    imported = replace(first(), file=first().file.model_copy(update={"created": "2027-01-01T00:00:00+00:00"}))
    assert "the same campaign twice" in refusal(first(), imported)


def test_reflectors_are_shared_where_they_are_in_one_place():
    machine = first().machine
    moved = with_machine(first(), ("position_m = [-0.80, -1.10, 0.10]", "position_m = [-0.81, -1.10, 0.10]")).machine
    assert shared_reflectors(machine, machine) == {smr.name for smr in machine.smrs}
    assert shared_reflectors(machine, moved) == {smr.name for smr in machine.smrs} - {"N1"}


def table(generation: int, drive: str, partner: str) -> KnownTable:
    """Half a millimetre a metre of its own coordinate, twice that of its partner's."""
    return KnownTable.model_validate({
        "generation": generation, "drive": drive, "own_m": [0.0, 2.0], "partner": partner, "partner_m": [0.0, 2.0],
        "corrections_m": [[0.0, 2.0e-3], [1.0e-3, 3.0e-3]],
    })  # fmt: skip


def test_known_tables_are_taken_off():
    recording = first()
    file = recording.file.model_copy(update={"known_tables": (table(2, "left", "right"), table(2, "right", "left"))})
    generation = np.where(
        np.arange(len(recording)) % 3 == 0, 2.0, np.where(np.arange(len(recording)) % 3 == 1, 7.0, 0.0)
    )
    on = replace(recording, file=file, columns={**recording.columns, "compensation": generation})
    plain = without_tables(on)
    left, right = recording["left_actual_m"], recording["right_actual_m"]
    known = generation == 2.0
    assert plain["left_actual_m"][known] == pytest.approx((left + 5e-4 * left + 1e-3 * right)[known], abs=1e-15)
    assert plain["right_actual_m"][known] == pytest.approx((right + 5e-4 * right + 1e-3 * left)[known], abs=1e-15)
    assert np.array_equal(plain["left_actual_m"][~known], left[~known])
    assert np.array_equal(plain["compensation"], np.where(known, 0.0, generation))
