"""The CiA 402 power state machine: pure functions of state and controlword."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """States of CiA 402; the value is the statusword's state bits (0, 1, 2, 3, 5, 6)."""

    NOT_READY_TO_SWITCH_ON = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION_ACTIVE = 0x0F
    FAULT = 0x08


class Command(Enum):
    """Device control commands of the controlword."""

    SHUTDOWN = "shutdown"
    SWITCH_ON = "switch on"
    ENABLE_OPERATION = "enable operation"
    DISABLE_VOLTAGE = "disable voltage"
    QUICK_STOP = "quick stop"
    FAULT_RESET = "fault reset"


NEW_SET_POINT = 0x0010
CHANGE_IMMEDIATELY = 0x0020
RELATIVE = 0x0040
FAULT_RESET = 0x0080
HALT = 0x0100

STATE_MASK = 0x006F
VOLTAGE_ENABLED = 0x0010
REMOTE = 0x0200
TARGET_REACHED = 0x0400
INTERNAL_LIMIT = 0x0800
SET_POINT_ACKNOWLEDGE = 0x1000
FOLLOWING_ERROR = 0x2000

POWERED = frozenset({State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE})

_S, _C = State, Command
_TRANSITIONS: dict[tuple[State, Command], State] = {
    (_S.SWITCH_ON_DISABLED, _C.SHUTDOWN): _S.READY_TO_SWITCH_ON,
    (_S.READY_TO_SWITCH_ON, _C.SWITCH_ON): _S.SWITCHED_ON,
    (_S.READY_TO_SWITCH_ON, _C.ENABLE_OPERATION): _S.SWITCHED_ON,  # the next controlword enables
    (_S.READY_TO_SWITCH_ON, _C.DISABLE_VOLTAGE): _S.SWITCH_ON_DISABLED,
    (_S.READY_TO_SWITCH_ON, _C.QUICK_STOP): _S.SWITCH_ON_DISABLED,
    (_S.SWITCHED_ON, _C.ENABLE_OPERATION): _S.OPERATION_ENABLED,
    (_S.SWITCHED_ON, _C.SHUTDOWN): _S.READY_TO_SWITCH_ON,
    (_S.SWITCHED_ON, _C.DISABLE_VOLTAGE): _S.SWITCH_ON_DISABLED,
    (_S.SWITCHED_ON, _C.QUICK_STOP): _S.SWITCH_ON_DISABLED,
    (_S.OPERATION_ENABLED, _C.SWITCH_ON): _S.SWITCHED_ON,
    (_S.OPERATION_ENABLED, _C.SHUTDOWN): _S.READY_TO_SWITCH_ON,
    (_S.OPERATION_ENABLED, _C.DISABLE_VOLTAGE): _S.SWITCH_ON_DISABLED,
    (_S.OPERATION_ENABLED, _C.QUICK_STOP): _S.QUICK_STOP_ACTIVE,
    (_S.QUICK_STOP_ACTIVE, _C.ENABLE_OPERATION): _S.OPERATION_ENABLED,
    (_S.QUICK_STOP_ACTIVE, _C.DISABLE_VOLTAGE): _S.SWITCH_ON_DISABLED,
    (_S.FAULT, _C.FAULT_RESET): _S.SWITCH_ON_DISABLED,
}


def command_of(controlword: int, previous: int) -> Command:
    """The command of a controlword; the fault reset is a rising edge of bit 7."""
    if controlword & FAULT_RESET and not previous & FAULT_RESET:
        return Command.FAULT_RESET
    if not controlword & 0x02:
        return Command.DISABLE_VOLTAGE
    if not controlword & 0x04:
        return Command.QUICK_STOP
    if not controlword & 0x01:
        return Command.SHUTDOWN
    return Command.ENABLE_OPERATION if controlword & 0x08 else Command.SWITCH_ON


def next_state(state: State, controlword: int, previous: int) -> State:
    """State after a controlword; commands that a state does not know leave it as it is."""
    return _TRANSITIONS.get((state, command_of(controlword, previous)), state)


def after_fault(state: State) -> State:
    """State after a fault was found: the reaction first if the drive is powered."""
    return State.FAULT_REACTION_ACTIVE if state in POWERED else State.FAULT


def statusword(
    state: State,
    *,
    target_reached: bool = False,
    set_point_acknowledged: bool = False,
    following_error: bool = False,
    internal_limit: bool = False,
) -> int:
    """The statusword of a state. Bit 5 (quick stop) is part of the state's bits."""
    word = state.value | VOLTAGE_ENABLED | REMOTE
    word |= TARGET_REACHED if target_reached else 0
    word |= SET_POINT_ACKNOWLEDGE if set_point_acknowledged else 0
    word |= FOLLOWING_ERROR if following_error else 0
    word |= INTERNAL_LIMIT if internal_limit else 0
    return word
