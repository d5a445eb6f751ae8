"""The events: what happens, what the watcher has to do, and which tables the drives have to use afterwards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Literal

from benchmarks.watch_events.scene import CLOSED, WEEK_S, Scene
from calibration.machine.description import shipped_machine

Line = dict[str, Any]
Tables = Literal["new", "former"]
SLIGHT_RAD, HARD_RAD, LOST_M = 2.0e-5, 6.0e-4, 3.0e-5
WIDER = "[recalibration.envelope]\ntable_m = 3e-4\n"  # 7 K are 0.13 mm at the ends of the drives' travel
EXPIRED = '[[certificates]]\ninstrument = "station"\nnumber = "T-17"\ndue = %s\n'


@dataclass(frozen=True)
class Event:
    """An event: what it is, what is done and seen (the decisive lines of the journal), which tables stay.

    says: words that the last line has to contain. top: further lines of the rig file.
    """

    name: str
    act: Callable[[Scene], list[Line]]
    done: tuple[str, ...]
    says: str
    tables: Tables
    top: str = ""


def _look(scene: Scene, *done: str) -> list[Line]:
    """Start the watcher and wait for what it decides."""
    scene.watch()
    return [scene.wait_for(*done)]


def _replaced(scene: Scene) -> list[Line]:
    scene.mock.tell("drive replace left 2e-5")
    return _look(scene, "calibration", "proposal", "refused", "failed")


def _knocked(lean_rad: float) -> Callable[[Scene], list[Line]]:
    def act(scene: Scene) -> list[Line]:
        scene.mock.tell(f"column knock left {lean_rad!r}")
        return _look(scene, "calibration", "proposal", "refused", "failed")

    return act


def _proposed(scene: Scene) -> list[Line]:
    """The proposal waits: further looks do nothing."""
    lines = _knocked(HARD_RAD)(scene)
    return [*lines, scene.wait_for("skipped", after=len(scene.lines()))] if lines[0]["done"] == "proposal" else lines


def _manual(scene: Scene) -> list[Line]:
    scene.mock.tell("automatic off")
    skipped = _look(scene, "skipped", "check", "failed")
    scene.mock.tell("automatic on")
    return [*skipped, scene.wait_for("check", "failed", after=len(scene.lines()))]


def _expired(scene: Scene) -> list[Line]:
    lines = _look(scene, "skipped", "check", "failed")
    scene.settle()
    return [*lines, *scene.lines()[1:]]


def _window(scene: Scene) -> list[Line]:
    """Closed while a check is due; then it opens, and what was missed is done once."""
    always = 'windows = [{ begin = "00:00", end = "00:00" }]'
    day = f"{datetime.now(UTC) + timedelta(seconds=WEEK_S, days=3):%a}".lower()
    scene.edit(always, CLOSED % day)
    _look(scene, "skipped", "check", "failed")
    scene.edit(CLOSED % day, always)
    scene.wait_for("check", "failed", after=1)
    scene.settle()
    return scene.lines()


def _power(scene: Scene, done: str) -> list[Line]:
    """All devices lose their power while tables are on trial, and have it again."""
    scene.watch()
    scene.wait_for_trial()
    scene.mock.kill()
    failed = scene.wait_for("failed")
    scene.mock.start()
    return [failed, scene.wait_for(done, "proposal", "refused", after=len(scene.lines()))]


def _power_full(scene: Scene) -> list[Line]:
    scene.mock.tell(f"column knock left {SLIGHT_RAD!r}")
    return _power(scene, "calibration")


def _lost(scene: Scene) -> None:
    scene.mock.tell(f"drive recount left {LOST_M!r}")
    scene.note("reference lost", "left")


def _reference(scene: Scene) -> list[Line]:
    _lost(scene)
    return _look(scene, "calibration", "proposal", "refused", "failed")


def _power_partial(scene: Scene) -> list[Line]:
    _lost(scene)
    return _power(scene, "calibration")


def _reseated(scene: Scene) -> list[Line]:
    scene.mock.tell("station move 0.01 -0.005 0.02 0.002")
    return _look(scene, "check", "calibration", "proposal", "refused", "failed")


def _warmer(scene: Scene) -> list[Line]:
    for part in ("struts", "columns", "base", "platform"):
        scene.mock.tell(f"temperature {part} 7")
    return _look(scene, "calibration", "proposal", "refused", "failed")


def _other_machine(scene: Scene) -> list[Line]:
    text = shipped_machine("planar4").read_text(encoding="utf-8").replace("left_upper", "left_top")
    (scene.folder / "renamed.toml").write_text(text, encoding="utf-8")
    scene.edit('machine = "planar4"', 'machine = "renamed.toml"')
    lines = _look(scene, "skipped", "check", "calibration", "proposal", "failed")
    scene.settle()
    return [*lines, *scene.lines()[1:]]


def _clock(scene: Scene) -> list[Line]:
    scene.watch(-86400.0)
    lines = [scene.wait_for("failed", "check", "skipped", "calibration")]
    scene.settle()
    return [*lines, *scene.lines()[1:]]


def _computer(scene: Scene) -> list[Line]:
    """The watcher's computer loses its power while tables are on trial; it is started again."""
    scene.mock.tell(f"column knock left {SLIGHT_RAD!r}")
    scene.watch()
    scene.wait_for_trial()
    scene.kill_watch()
    return _look(scene, "calibration", "proposal", "refused", "failed")


def _yesterday() -> str:
    return f"{datetime.now(UTC) - timedelta(days=1):%Y-%m-%d}"


def events() -> tuple[Event, ...]:
    """All of them."""
    return (
        Event("drive replaced", _replaced, ("calibration",), "drive replaced", "new"),
        Event("column knocked", _knocked(SLIGHT_RAD), ("calibration",), "check", "new"),
        Event("column knocked hard", _proposed, ("proposal", "skipped"), "waits for approval", "former"),
        Event("PLC in manual mode", _manual, ("skipped", "check"), "fit", "former"),
        Event("certificate expired", _expired, ("skipped",), "has expired", "former", EXPIRED % _yesterday()),
        Event("window closed, then open", _window, ("skipped", "check"), "fit", "former"),
        Event("power lost in a calibration", _power_full, ("failed", "calibration"), "", "new"),
        Event("reference lost", _reference, ("calibration",), "drive offset", "new"),
        Event("power lost in a partial one", _power_partial, ("failed", "calibration"), "drive offset", "new"),
        Event("station set up anew", _reseated, ("check",), "fit", "former"),
        Event("7 K warmer", _warmer, ("calibration",), "expansion", "new", WIDER),
        Event("another machine file", _other_machine, ("skipped",), "begins anew", "former"),
        Event("clock set back", _clock, ("failed",), "the clock was set back", "former"),
        Event("computer lost in a calibration", _computer, ("calibration",), "", "new"),
    )
