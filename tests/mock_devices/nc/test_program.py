"""The mock control's reader of programs: what it takes, and what it refuses, with the line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_devices.nc.program import ProgramError, Step, parse_program, read_program

TEXT = """(visits of rig x, machine y: 2)
(commanded are drives, without correction: Y1=,Y2= in mm and degrees)
G21 G90 G94
(payload 2: plates, 400 kg)
M0 (put it on)
N1 (pose 7, pass 0)
G1 Y1=-1.5 Y2=20 F600
G4 P2.5
N2 (pose 7, pass 1)
G1 Y1=0.000001 Y2=.5 F30000
M0 (measured; start goes on)
M2
M99 this is never reached
"""


def test_a_program_is_read_step_by_step():
    program = parse_program(TEXT)
    assert (program.axes, program.commands) == (("Y1", "Y2"), "drives")
    assert program.steps == (
        Step("stop", 0, payload=2),
        Step("move", 1, (-1.5, 20.0), 600.0),
        Step("dwell", 1, dwell_s=2.5),
        Step("move", 2, (0.000001, 0.5), 30000.0),
        Step("stop", 2),
    )
    assert program.begin_of(2) == 3
    with pytest.raises(ValueError, match="no N3"):
        program.begin_of(3)


def test_a_program_of_the_tool_says_so():
    text = "(commanded are tool point and A, B, C, without correction: X)\nN1\nG1 X1 Y2 Z3 A4 B5 C6 F1\nM30\n"
    program = parse_program(text)
    assert program.commands == "tool"
    assert program.steps[0].words == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("G1 X1", "line 1: G1 needs F above zero"),
        ("G1 F100", "line 1: G1 of nothing"),
        ("G4 P0", "line 1: G4 needs P above zero"),
        ("X1 Y2", "line 1: X: a place without G1"),
        ("G2 X1 F1", "line 1: G2 is not known"),
        ("G1 X1 Xe5 F1", "line 1: 'Xe5 F1' is no word"),
        ("G1 X1 F1\nG1 Y1 F1", "line 2: G1 of Y; every move names the same axes"),
        ("G1 X1 F1", "it does not end with M2"),
        ("hello", "line 1: 'hello' is no word"),
    ],
)
def test_what_is_no_program_is_refused_with_its_line(line, complaint):
    with pytest.raises(ProgramError, match=complaint):
        parse_program(line)


@given(st.text(alphabet="NGMFPXYZ0123456789.-= ()\n", max_size=200))
def test_any_text_is_a_program_or_refused(text):
    try:
        program = parse_program(text)
    except ProgramError:
        return
    assert all(len(step.words) == len(program.axes) for step in program.steps if step.kind == "move")


def test_what_is_not_ascii_is_named_by_its_file(tmp_path):
    path = tmp_path / "visits.ngc"
    path.write_bytes(b"G1 X\xff")
    with pytest.raises(ProgramError, match=r"visits\.ngc: not ASCII"):
        read_program(path)
