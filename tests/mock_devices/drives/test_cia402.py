"""The power state machine by CiA 402, as properties over any sequence of controlwords."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from mock_devices.drives import cia402
from mock_devices.drives.cia402 import Command, State, after_fault, command_of, next_state, statusword

WORDS = st.lists(st.one_of(st.integers(0, 0xFFFF), st.sampled_from([0, 2, 6, 7, 0x0F, 0x1F, 0x80])), max_size=30)
ENABLING = (Command.SHUTDOWN, Command.SWITCH_ON, Command.ENABLE_OPERATION)


def run(words, start=State.SWITCH_ON_DISABLED):
    state, previous, trail = start, 0, [(start, None)]
    for word in words:
        command = command_of(word, previous)
        state = next_state(state, word, previous)
        trail.append((state, command))
        previous = word
    return trail


def test_the_usual_way_up_and_down():
    states = [state for state, _ in run([0x06, 0x07, 0x0F, 0x07, 0x06, 0x00])]
    assert states == [
        State.SWITCH_ON_DISABLED,
        State.READY_TO_SWITCH_ON,
        State.SWITCHED_ON,
        State.OPERATION_ENABLED,
        State.SWITCHED_ON,
        State.READY_TO_SWITCH_ON,
        State.SWITCH_ON_DISABLED,
    ]


@given(WORDS)
def test_operation_is_never_enabled_but_from_switched_on_or_quick_stop(words):
    trail = run(words)
    for (before, _), (state, command) in pairwise(trail):
        if state is State.OPERATION_ENABLED and before is not state:
            assert before in (State.SWITCHED_ON, State.QUICK_STOP_ACTIVE)
            assert command is Command.ENABLE_OPERATION


@given(WORDS)
def test_enabling_takes_at_least_three_controlwords_that_rise_through_the_states(words):
    trail = run(words)
    enabled = [i for i, (state, _) in enumerate(trail) if state is State.OPERATION_ENABLED]
    if enabled:
        commands = [command for _, command in trail[1 : enabled[0] + 1]]
        assert Command.SHUTDOWN in commands
        assert commands[-1] is Command.ENABLE_OPERATION
        assert len(commands) >= 3


@given(WORDS)
def test_a_fault_is_always_reachable_and_only_a_reset_leaves_it(words):
    state = after_fault(run(words)[-1][0])
    assert state in (State.FAULT, State.FAULT_REACTION_ACTIVE)
    for word in (0x00, 0x06, 0x07, 0x0F):
        assert next_state(State.FAULT, word, 0) is State.FAULT
    assert next_state(State.FAULT, 0x80, 0x00) is State.SWITCH_ON_DISABLED
    assert next_state(State.FAULT, 0x80, 0x80) is State.FAULT
    assert next_state(State.FAULT_REACTION_ACTIVE, 0x80, 0x00) is State.FAULT_REACTION_ACTIVE


@given(st.sampled_from(State), st.booleans(), st.booleans(), st.booleans())
def test_the_statusword_tells_the_state_and_nothing_else_changes_its_bits(state, reached, taken, error):
    word = statusword(state, target_reached=reached, set_point_acknowledged=taken, following_error=error)
    assert word & cia402.STATE_MASK == state.value
    assert State(word & cia402.STATE_MASK) is state
    assert bool(word & cia402.TARGET_REACHED) is reached
    assert bool(word & cia402.SET_POINT_ACKNOWLEDGE) is taken
    assert bool(word & cia402.FOLLOWING_ERROR) is error
    assert word & cia402.REMOTE


@given(st.integers(0, 0xFFFF), st.integers(0, 0xFFFF))
def test_every_controlword_is_a_command(word, previous):
    assert isinstance(command_of(word, previous), Command)
