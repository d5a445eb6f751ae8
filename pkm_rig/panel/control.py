"""Which page commands the rig, and the second press that names what will move."""

from __future__ import annotations

import hmac
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from calibration.base.errors import InputError

VALID_S = 60.0
LEAST_S = 0.5  # a double click is no second press
AnyAction = TypeVar("AnyAction")


class NotInControl(InputError):
    """Another page has control, or none."""


class Control:
    """One page at a time commands; all others look on. Pages are named by what their server calls them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holder: str | None = None
        self.changes = 0

    @property
    def holder(self) -> str | None:
        """The page that has control."""
        return self._holder

    def take(self, page: str) -> str | None:
        """Give a page control; returns the page that has lost it thereby."""
        with self._lock:
            before, self._holder = self._holder, page
            if before == page:
                return None
            self.changes += 1
            return before

    def leave(self, page: str) -> None:
        """A page gives control up, or is closed: nobody has it then, and whatever is under way goes on."""
        with self._lock:
            if self._holder == page:
                self._holder = None
                self.changes += 1

    def require(self, page: str) -> None:
        """Raise NotInControl unless this page has control."""
        if self._holder != page:
            raise NotInControl("this page does not have control; take it first")


@dataclass(frozen=True)
class Prepared(Generic[AnyAction]):
    """What a first press asked for: what is to be done, that in words, and the secret of its second press."""

    action: AnyAction
    text: str
    secret: str
    page: str
    asked_s: float


class Presses(Generic[AnyAction]):
    """First and second presses: a second one counts once, for its own page, not at once and not late.

    A first press makes every earlier one void.
    """

    def __init__(self, control: Control, now_s: Callable[[], float] = time.monotonic) -> None:
        self._control, self._now_s = control, now_s
        self._lock = threading.Lock()
        self._prepared: Prepared[AnyAction] | None = None

    def first(self, page: str, action: AnyAction, text: str) -> Prepared[AnyAction]:
        """A first press; NotInControl from a page without control."""
        self._control.require(page)
        prepared = Prepared(action, text, secrets.token_urlsafe(16), page, self._now_s())
        with self._lock:
            self._prepared = prepared
        return prepared

    def second(self, page: str, secret: str) -> AnyAction:
        """What was asked for; InputError, and nothing is done, unless this is the second press of this page."""
        with self._lock:
            self._control.require(page)
            prepared = self._prepared
            if prepared is None or prepared.page != page or not hmac.compare_digest(prepared.secret, secret):
                raise InputError("this was pressed before, or is not what was asked for last; begin again")
            waited_s = self._now_s() - prepared.asked_s
            if waited_s < LEAST_S:
                raise InputError("pressed twice at once; read what will move, then press again")
            self._prepared = None
        if waited_s > VALID_S:
            raise InputError(f"asked for {waited_s:.0f} s ago; begin again")
        return prepared.action
