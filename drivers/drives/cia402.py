"""The state machine of CiA 402 as pure functions: state from statusword, next controlword towards a state."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """States of the power drive system."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY_TO_SWITCH_ON = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"


# mask, value, state; the quick stop bit (5) is undefined in the four states with the shorter mask
_PATTERNS = (
    (0x4F, 0x00, State.NOT_READY),
    (0x4F, 0x40, State.SWITCH_ON_DISABLED),
    (0x6F, 0x21, State.READY_TO_SWITCH_ON),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.OPERATION_ENABLED),
    (0x6F, 0x07, State.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, State.FAULT_REACTION),
    (0x4F, 0x08, State.FAULT),
)

# controlwords
DISABLE_VOLTAGE = 0x0000
QUICK_STOP = 0x0002
SHUTDOWN = 0x0006
SWITCH_ON = 0x0007
ENABLE_OPERATION = 0x000F
NEW_SET_POINT = 0x001F  # enable operation with bit 4; bit 5 (at once) and bit 6 (relative) stay 0
START_HOMING = 0x001F  # the same bit in homing mode
FAULT_RESET = 0x0080

# statusword bits
TARGET_REACHED = 1 << 10
LIMIT_ACTIVE = 1 << 11
SET_POINT_ACKNOWLEDGED = 1 << 12
FOLLOWING_ERROR = 1 << 13

HOMING_ATTAINED = 1 << 12  # the same bits in homing mode
HOMING_ERROR = 1 << 13
FOLLOWS_TARGET = 1 << 12  # in cyclic synchronous position mode

PROFILE_POSITION, HOMING, CYCLIC_POSITION = 1, 6, 8

_TOWARDS_OPERATION = {
    State.SWITCH_ON_DISABLED: SHUTDOWN,
    State.READY_TO_SWITCH_ON: SWITCH_ON,
    State.SWITCHED_ON: ENABLE_OPERATION,
    State.QUICK_STOP_ACTIVE: DISABLE_VOLTAGE,
}


def state_of(statusword: int) -> State:
    """The state in a statusword; one that matches none counts as not ready."""
    for mask, value, state in _PATTERNS:
        if statusword & mask == value:
            return state
    return State.NOT_READY


def controlword_to_enable(state: State) -> int | None:
    """The next controlword on the way to operation enabled.

    None if there is nothing to send: already there, still starting, or in fault, which the user resets.
    """
    return _TOWARDS_OPERATION.get(state)


def controlword_to_disable(state: State) -> int | None:
    """The next controlword on the way to switch on disabled; None when there is nothing to send."""
    on = (
        State.READY_TO_SWITCH_ON,
        State.SWITCHED_ON,
        State.OPERATION_ENABLED,
        State.QUICK_STOP_ACTIVE,
    )
    return DISABLE_VOLTAGE if state in on else None
