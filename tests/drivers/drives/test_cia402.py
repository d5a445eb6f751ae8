"""The state machine against the table of the standard."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.drives.cia402 import (
    DISABLE_VOLTAGE,
    ENABLE_OPERATION,
    SHUTDOWN,
    SWITCH_ON,
    State,
    controlword_to_disable,
    controlword_to_enable,
    state_of,
)

# bits 6, 5, 3, 2, 1, 0 of the statusword, x: not looked at (CiA 402-2, table of statusword states)
STANDARD = {
    State.NOT_READY: "0x0000",
    State.SWITCH_ON_DISABLED: "1x0000",
    State.READY_TO_SWITCH_ON: "010001",
    State.SWITCHED_ON: "010011",
    State.OPERATION_ENABLED: "010111",
    State.QUICK_STOP_ACTIVE: "000111",
    State.FAULT_REACTION: "0x1111",
    State.FAULT: "0x1000",
}
BITS = (6, 5, 3, 2, 1, 0)

# (state, bits 7 3 2 1 0 of the controlword) -> next state: the transitions that the driver uses
TRANSITIONS = {
    (State.SWITCH_ON_DISABLED, SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.READY_TO_SWITCH_ON, SWITCH_ON): State.SWITCHED_ON,
    (State.SWITCHED_ON, ENABLE_OPERATION): State.OPERATION_ENABLED,
    **{
        (state, DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED
        for state in (
            State.READY_TO_SWITCH_ON,
            State.SWITCHED_ON,
            State.OPERATION_ENABLED,
            State.QUICK_STOP_ACTIVE,
        )
    },
}


def _by_the_standard(statusword: int) -> State | None:
    for state, pattern in STANDARD.items():
        if all(p == "x" or int(p) == statusword >> bit & 1 for p, bit in zip(pattern, BITS, strict=True)):
            return state
    return None


@given(st.integers(0, 0xFFFF))
def test_states(statusword: int) -> None:
    assert state_of(statusword) is (_by_the_standard(statusword) or State.NOT_READY)


@given(st.sampled_from(State))
def test_the_way_up_ends_in_operation(state: State) -> None:
    stuck = {State.NOT_READY, State.FAULT, State.FAULT_REACTION}
    for _ in range(len(State)):
        word = controlword_to_enable(state)
        if word is None:
            break
        state = TRANSITIONS[state, word]
    assert state is State.OPERATION_ENABLED or state in stuck


@given(st.sampled_from(State))
def test_the_way_down_is_one_step(state: State) -> None:
    word = controlword_to_disable(state)
    if word is not None:
        assert TRANSITIONS[state, word] is State.SWITCH_ON_DISABLED
        assert word & 0x10 == 0


@pytest.mark.parametrize("state", list(State))
def test_no_controlword_starts_a_motion(state: State) -> None:
    for word in (controlword_to_enable(state), controlword_to_disable(state)):
        assert word is None or word & 0x10 == 0
