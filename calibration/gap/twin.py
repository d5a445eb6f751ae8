"""The twin: the fitted model of a machine with the effects that a diagnosis found, to be simulated again.

It holds the campaign's own moments, by which the effects' forms are defined; what lies outside of them is held at
their limits. It is data, not code: effects are named, and their forms built anew.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibration.effects.base import Setting
from calibration.effects.catalogue import Catalogue, load_catalogue
from calibration.frame import Frame
from calibration.gap.baseline import Baseline, Seen
from calibration.gap.channels import Channels
from calibration.gap.moments import ARRAYS, History, Moments, held, joined
from calibration.gap.search import Cause
from calibration.gap.setting import setting_from
from calibration.machine import Array, Machine, parse_machine
from calibration.model import Model, Systematic
from calibration.parameters import ParameterSet
from calibration.toml_file import InputError
from calibration.visits import Visits

FORMAT = 1


class _Asked:
    """Asks and keeps the answers."""

    def __init__(self, ask: Callable[..., Sequence[tuple[float, float]]]) -> None:
        self._ask = ask
        self.answers: tuple[tuple[float, ...], ...] = ()

    def __call__(self, *question: Any) -> Sequence[tuple[float, float]]:
        answer = self._ask(*question)
        self.answers = (*self.answers, tuple(float(value) for value, _ in answer))
        return answer


class _Told:
    """Gives the answers that were kept, in their order."""

    def __init__(self, answers: tuple[tuple[float, ...], ...]) -> None:
        self._answers = iter(answers)

    def __call__(self, *_question: Any) -> list[tuple[float, float]]:
        return [(value, 1.0) for value in next(self._answers, ())]


@dataclass(frozen=True)
class Added:
    """An effect of the twin: where, which columns of its forms, their coefficients.

    periods_m, onsets_s: what stood out in the campaign when the forms were built, question by question.
    """

    effect: str
    place: int
    columns: tuple[int, ...]
    coefficients: tuple[float, ...]
    periods_m: tuple[tuple[float, ...], ...]
    onsets_s: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Twin:
    """theta (p,): deviations of the machine's parameters; mounted_m (smrs, 3); campaign: moments that define the forms."""

    machine: Machine
    theta: Array
    frame: Frame
    mounted_m: Array
    campaign: Moments
    added: tuple[Added, ...]
    catalogue: Catalogue

    @classmethod
    def of(cls, baseline: Baseline, causes: Sequence[Cause], setting: Setting) -> Twin:
        """The twin of a diagnosed recording."""
        machine, added = baseline.machine, []
        for cause in causes:
            place = cause.effect.places(machine).index(cause.place)
            asked, onsets = _Asked(setting.periods), _Asked(setting.onsets)
            cause.effect.forms(replace(setting, periods=asked, onsets=onsets), place)
            coefficients = tuple(float(c) for c in cause.best.coefficients)
            columns = cause.best.form.columns
            added.append(Added(cause.effect.name, place, columns, coefficients, asked.answers, onsets.answers))
        flat = baseline.columns.reshape(-1, baseline.columns.shape[2])
        found = flat.T @ baseline.apply(baseline.residual).ravel()
        parameters = len(baseline.poses.model.parameters)
        theta = found[:parameters] * baseline.sigma[:parameters]
        catalogue = Catalogue(tuple(cause.effect for cause in causes))
        return cls(machine, theta, baseline.frame, baseline.mounted_m, baseline.moments, tuple(added), catalogue)

    def places_m(self, moments: Moments) -> Array:
        """Places (n, smrs, 3) of all reflectors in the machine's frame."""
        count, smrs = len(moments), len(self.machine.smrs)
        seen = self._seen(moments, np.arange(smrs))
        out = self._modelled(seen)
        for added, shape in zip(self.added, self._shapes(moments), strict=True):
            channels = Channels(seen)
            for act, coefficient in zip(shape, added.coefficients, strict=True):
                for channel, values in act:
                    out += coefficient * channels.shift_m(channel) * np.repeat(values, smrs)[:, None]
        return out.reshape(count, smrs, 3)

    def _modelled(self, seen: Seen) -> Array:
        """Places (n, 3) by the model alone."""
        out = np.empty((len(seen.smr), 3))
        for i, smr in enumerate(self.machine.smrs):
            rows = np.flatnonzero(seen.smr == i)
            visit = seen.visit[rows]
            if smr.on == "floor":
                out[rows] = self.mounted_m[i]
            elif smr.on == "platform":
                out[rows] = seen.poses.point(self.mounted_m[i])[0][visit]
            else:
                out[rows] = seen.poses.carried(smr.drive, self.mounted_m[i])[0][visit]
        return out

    def _seen(self, moments: Moments, smrs: Array) -> Seen:
        """Every reflector at every moment."""
        model = Model(ParameterSet.of(self.machine), Systematic())
        target = np.zeros((len(moments), 6))
        target[:] = self.machine.workspace.mean(axis=1)
        visits = Visits(
            moments.drives, target, moments.payload_kg, moments.payload_com_m,
            {name: t for name, t in moments.temperatures_c.items() if name != "air"},
        )  # fmt: skip
        poses = model.predict(self.theta, visits)
        if not np.all(poses.rest.converged):
            raise InputError("twin: the model finds no equilibrium for a moment; check the drive coordinates")
        n, k = len(moments), len(smrs)
        seen = Seen(
            self.machine, moments, np.tile(smrs, n), np.repeat(np.arange(n), k), poses, self.frame, self.mounted_m,
            np.zeros((n * k, 3)),
        )  # fmt: skip
        places = self._modelled(seen)
        on_floor = np.array([s.on == "floor" for s in self.machine.smrs])[seen.smr]
        visit = np.where(on_floor, -1, seen.visit)
        return replace(seen, visit=visit, position_m=self.frame.to_station(places))

    def _shapes(self, moments: Moments) -> list[tuple[tuple[tuple[str, Array], ...], ...]]:
        """The acts of each added effect at the moments: forms are built over the campaign and them together."""
        joined = joined(self.campaign, held(self.campaign, moments))
        first = len(self.campaign)
        every = self._seen(joined, np.zeros(1, dtype=np.intp))
        out = []
        for added in self.added:
            effect = next(e for e in self.catalogue.effects if e.name == added.effect)

            told = setting_from(every, Channels(every), _Told(added.periods_m), _Told(added.onsets_s))
            acts = effect.forms(told, added.place).acts
            out.append(tuple(tuple((channel, shape[first:]) for channel, shape in acts[c]) for c in added.columns))
        return out

    def to_data(self) -> dict[str, Any]:
        """Plain data for a JSON file."""
        m = self.campaign
        return {
            "format": FORMAT,
            "theta": self.theta.tolist(),
            "frame": {"rotation": self.frame.rotation.tolist(), "translation_m": self.frame.translation_m.tolist()},
            "mounted_m": self.mounted_m.tolist(),
            "added": [
                {
                    "effect": a.effect,
                    "place": a.place,
                    "columns": list(a.columns),
                    "coefficients": list(a.coefficients),
                    "periods_m": [list(p) for p in a.periods_m],
                    "onsets_s": [list(o) for o in a.onsets_s],
                }
                for a in self.added
            ],
            "history": {"arrived_s": m.history.arrived_s.tolist(), "drives": m.history.drives.tolist()},
            "moments": {name: np.asarray(getattr(m, name)).tolist() for name in ARRAYS},
            "temperatures_c": {name: t.tolist() for name, t in m.temperatures_c.items()},
            "start_s": m.start_s,
        }

    @classmethod
    def from_data(cls, machine_text: str, data: Mapping[str, Any], catalogue: Catalogue | None = None) -> Twin:
        """The twin of what `to_data` gave. InputError in one line where it is not fit."""
        machine = parse_machine(machine_text, "twin")
        catalogue = catalogue or load_catalogue()
        try:
            twin = _read(machine, data, catalogue)
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"twin: {type(error).__name__}: {error}; make it again with diagnose --add") from None
        for added in twin.added:
            if added.effect not in catalogue.names:
                raise InputError(f"twin: unknown effect '{added.effect}'; name its file with --effects")
        return twin


def _numbers(values: Any, width: tuple[int, ...]) -> Array:
    out = np.array(values, dtype=np.float64)
    if out.shape[1:] != width or not np.all(np.isfinite(out)):
        raise ValueError("an array has the wrong shape or is not finite")
    return out


def _read(machine: Machine, data: Mapping[str, Any], catalogue: Catalogue) -> Twin:
    if data["format"] != FORMAT:
        raise ValueError(f"format {data['format']!r} is not known")
    d = len(machine.drive_names)
    widths: dict[str, tuple[int, ...]] = dict.fromkeys(ARRAYS, ())
    widths |= dict.fromkeys(("drives", "direction", "velocity_m_per_s", "torque"), (d,))
    widths["payload_com_m"] = (3,)
    arrays: dict[str, Any] = {name: _numbers(data["moments"][name], widths[name]) for name in ARRAYS}
    count = len(arrays["t_s"])
    history = History(_numbers(data["history"]["arrived_s"], ()), _numbers(data["history"]["drives"], (d,)))
    arrays["arrival"] = arrays["arrival"].astype(np.intp)
    temperatures = {str(name): _numbers(t, ()) for name, t in data["temperatures_c"].items()}
    if any(len(a) != count for a in (*arrays.values(), *temperatures.values())):
        raise ValueError("columns are not of one length")
    if len(history.arrived_s) != len(history.drives) or np.any(arrays["arrival"] >= len(history.arrived_s)):
        raise ValueError("the history does not fit its moments")
    moments = Moments(history=history, temperatures_c=temperatures, start_s=float(data["start_s"]), **arrays)
    theta = _numbers(data["theta"], ())
    if len(theta) != len(ParameterSet.of(machine)):
        raise ValueError("theta is of another machine")
    frame = Frame(_numbers(data["frame"]["rotation"], (3,)), _numbers(data["frame"]["translation_m"], ()))
    mounted = _numbers(data["mounted_m"], (3,))
    if len(mounted) != len(machine.smrs) or frame.rotation.shape != (3, 3) or frame.translation_m.shape != (3,):
        raise ValueError("frame or reflectors are of another machine")
    added = tuple(
        Added(
            str(a["effect"]),
            int(a["place"]),
            tuple(int(c) for c in a["columns"]),
            tuple(_numbers(a["coefficients"], ()).tolist()),
            tuple(tuple(_numbers(p, ()).tolist()) for p in a["periods_m"]),
            tuple(tuple(_numbers(o, ()).tolist()) for o in a["onsets_s"]),
        )
        for a in data["added"]
    )
    return Twin(machine, theta, frame, mounted, moments, added, catalogue)
