"""What to measure when a calibration is due: as little as the reasons allow."""

from __future__ import annotations

from dataclasses import dataclass

from calibration.intervals.facts import EventFact, Extent

DRIVE_OFFSET_VISITS = 10
EXPANSION_VISITS = 12
LEAST_VERIFICATION_POSES = 12


@dataclass(frozen=True)
class Measurement:
    """What to measure: its extent, the drives concerned, how many visits (None: the rig file's), and why."""

    extent: Extent
    drives: tuple[str, ...]
    visits: int | None
    reason: str


def what_to_measure(due_rules: tuple[str, ...], events: tuple[EventFact, ...]) -> Measurement:
    """The least that answers the rules that say due, given the events since the last calibration.

    After a lost reference alone: the offsets of those drives; after a change of temperature alone: expansion; else
    everything. Both at once is everything: one would be taken for the other.
    """
    lost = tuple(dict.fromkeys(e.part for e in events if e.kind == "reference lost"))
    other = [e.kind for e in events if e.kind not in ("reference lost", "tolerance changed")]
    rules = set(due_rules)
    if rules == {"event"} and lost and all(lost) and not other:
        return Measurement(
            "drive offset", lost, DRIVE_OFFSET_VISITS, f"only the reference of {', '.join(lost)} was lost"
        )
    if rules == {"temperature"} and not lost and not other:
        return Measurement("expansion", (), EXPANSION_VISITS, "only the temperature has changed")
    return Measurement("full", (), None, "the cause may be anywhere: " + ", ".join(sorted(rules) or ["asked for"]))
