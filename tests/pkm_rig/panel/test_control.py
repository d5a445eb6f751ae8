"""Control and the second press."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.base.errors import InputError
from pkm_rig.panel.control import LEAST_S, VALID_S, Control, NotInControl, Presses


class Clock:
    def __init__(self):
        self.now_s = 0.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def at():
    clock, control = Clock(), Control()
    control.take("a")
    return clock, control, Presses(control, clock)


def test_a_second_press_does_what_was_asked_for_once(at):
    clock, _, presses = at
    asked = presses.first("a", "home", "drive left moves")
    clock.now_s = 1.0
    assert presses.second("a", asked.secret) == "home"
    with pytest.raises(InputError, match="pressed before"):
        presses.second("a", asked.secret)


def test_a_double_click_is_no_second_press(at):
    clock, _, presses = at
    asked = presses.first("a", "home", "")
    clock.now_s = 0.9 * LEAST_S
    with pytest.raises(InputError, match="at once"):
        presses.second("a", asked.secret)


def test_a_late_second_press_is_none(at):
    clock, _, presses = at
    asked = presses.first("a", "home", "")
    clock.now_s = VALID_S + 1.0
    with pytest.raises(InputError, match="begin again"):
        presses.second("a", asked.secret)


def test_a_page_that_has_lost_control_presses_in_vain(at):
    clock, control, presses = at
    asked = presses.first("a", "home", "")
    clock.now_s = 1.0
    assert control.take("b") == "a"
    with pytest.raises(NotInControl):
        presses.second("a", asked.secret)
    with pytest.raises(InputError):
        presses.second("b", asked.secret)  # the press of another page
    with pytest.raises(NotInControl):
        presses.first("a", "home", "")


def test_a_page_that_is_gone_leaves_control_to_nobody(at):
    _, control, _ = at
    control.leave("b")
    assert control.holder == "a"
    control.leave("a")
    assert control.holder is None


ORDERS = st.tuples(st.sampled_from(["take", "leave", "first", "second"]), st.sampled_from("ab"), st.floats(0.0, 2.0))


@given(st.lists(ORDERS, max_size=40))
def test_whatever_is_pressed_only_the_controller_s_last_first_press_is_done_and_once(orders):
    clock, control = Clock(), Control()
    presses, asked, done = Presses(control, clock), None, []
    for number, (order, page, wait_s) in enumerate(orders):
        clock.now_s += wait_s
        if order == "take":
            control.take(page)
        elif order == "leave":
            control.leave(page)
        elif order == "first" and control.holder == page:
            asked = (presses.first(page, number, ""), clock.now_s)
        elif order == "second" and asked is not None:
            prepared, since_s = asked
            try:
                done.append(presses.second(page, prepared.secret))
            except InputError:
                continue
            assert control.holder == page == prepared.page
            assert clock.now_s - since_s >= LEAST_S
            assert done[-1] == prepared.action
    assert len(done) == len(set(done))
