"""The result of a comparison. Terms are those of docs/reference/definitions.md; units are in the names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from calibration.base.arrays import Array


@dataclass(frozen=True)
class ChangedQuantity:
    """One number of a change, after minus before, with its standard uncertainty and SI unit ('1' for a ratio)."""

    name: str
    value: float
    u: float
    unit: str


@dataclass(frozen=True)
class WorkspaceChange:
    """What changes of the machine do to its tool point, the drives where they were, over a grid of the workspace.

    tool_m (n, 3): where; shift_m (n, 3): after minus before, machine's frame. rms_m, max_m: of the shift's length, with
    the standard uncertainty of the first. rest_rms_m: RMS once a rigid motion is taken off, as a new workpiece zero
    does. shown (n,): the points of the level that a picture shows.
    """

    tool_m: Array
    shift_m: Array
    shown: Array
    rms_m: float
    u_rms_m: float
    max_m: float
    rest_rms_m: float


@dataclass(frozen=True)
class FoundChange:
    """A change that is considered present.

    structure, place: what changed where; of_machine: false for reflectors and nests. quantities: its numbers.
    raw_sigma, visible_sigma: RMS shift of the readings after, in sigma, before and after everything that the campaigns
    leave open is fitted again. workspace: None for what is not of the machine.
    """

    structure: str
    place: str
    of_machine: bool
    probability: float
    place_probability: float
    quantities: tuple[ChangedQuantity, ...]
    raw_sigma: float
    visible_sigma: float
    workspace: WorkspaceChange | None


@dataclass(frozen=True)
class Comparison:
    """The whole result. verdict: a structure, 'nothing' or 'unknown'; place: of the first change, else empty.

    equivalent: structures and places that the readings cannot tell from the verdict; matters_sigma: largest RMS
    difference of their predictions. ranking: probability by structure, 'nothing' and 'unknown' included. changes: the
    strongest first, at most three; empty for nothing and unknown. workspace: of all changes of the machine together.
    hidden_m: RMS of a smooth change of the tool's place that would still be undetected (95 %). scatter: of the readings
    of each campaign about their own fit, over the stated. readings: how many of each were used.
    """

    before: str
    after: str
    verdict: str
    place: str
    equivalent: tuple[tuple[str, str], ...]
    matters_sigma: float
    ranking: Mapping[str, float]
    changes: tuple[FoundChange, ...]
    workspace: WorkspaceChange | None
    hidden_m: float
    scatter: tuple[float, float]
    readings: tuple[int, int]
    remarks: tuple[str, ...] = ()

    @property
    def machine_changed(self) -> bool:
        """Whether the machine itself has changed, as far as is known; what is unknown may be the machine."""
        return self.verdict == "unknown" or any(change.of_machine for change in self.changes)
