"""The general functions of every effect, as a list that people can read; of what they are functions is found by trial.

    python -m tests.calibration.effects.general_functions     # writes the list anew; its changes belong in the commit

General functions are what stays where an effect's forms are left out (benchmarks/withheld/left_out_forms.py), so a
change of them changes what that check measures: nobody should make one without noticing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from calibration.diagnosis.effect_inputs import inputs_of_recording
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.effects.api import Effect, EffectInputs
from calibration.effects.catalogue import load_catalogue
from calibration.effects.columns import Contributions
from calibration.recording.header import KnownTable
from mock_devices.recordings.design import DesignOptions
from tests.calibration.diagnosis.campaigns import plant, recorded

LIST = Path(__file__).parent / "general_functions.txt"
RENEW = "python -m tests.calibration.effects.general_functions"
HEAD = f"""\
General functions of each effect at its first place, on planar4: columns without a name, and curves.
How many columns act through which channels, and of what they are functions. Written by
    {RENEW}
"""
OF_READING = {
    "t_s": "time", "speed_m_per_s": "speed", "dwell_s": "rest", "payload_kg": "payload",
    "payload_com_m": "payload's centre", "exchanges": "exchanges", "air_refractivity": "air",
}  # fmt: skip
OF_DRIVE = {"drives": "travel", "direction": "side", "velocity_m_per_s": "velocity", "torque": "torque"}
OF_DRIVE |= {"following_error_m": "following error"}


def typical_inputs(visits: int = 40) -> EffectInputs:
    """Of a small recording of the plant that varies everything, temperatures and known tables added.

    Periods and moments, which its noise would decide, are given.
    """
    design = DesignOptions(fly_share=0.2)
    likelihood = MarginalLikelihood.of(linearise_recording(recorded(plant(visits, design=design)), judge=False))
    inputs = inputs_of_recording(likelihood, {})
    hours = inputs.context.elapsed_s / 3600.0
    temperatures = {s: 22.0 + np.sin((3 + k) * hours) for k, s in enumerate(inputs.context.temperatures_c)}
    tables = tuple(
        KnownTable(drive=inputs.drive(0), generation=g, own_m=(0.0, 2.0), corrections_m=((1e-5,), (end_m,)))
        for g, end_m in ((3, 3e-5), (4, -2e-5))
    )
    return replace(
        inputs,
        context=replace(inputs.context, temperatures_c=temperatures, known_tables=tables),
        periods=lambda drive, shortest_m, longest_m, over=(): ((float(np.sqrt(shortest_m * longest_m)), 1.0),),
        onsets=lambda channels: ((600.0, 0.6), (1200.0, 0.4)),
    )


def listed(inputs: EffectInputs) -> str:
    """The list."""
    changed = dict(_with_one_thing_changed(inputs))
    parts = [HEAD]
    for effect in load_catalogue().effects:
        curves = sum(not curve.form for curve in effect.curves(inputs, 0))
        lines = [f"{count:4d} through {what}" for what, count in sorted(_general(effect, inputs, changed).items())]
        lines += [f"{curves:4d} curves"] if curves else []
        parts.append("\n".join((effect.name, *(lines or ["   none"]))) + "\n")
    return "\n".join(parts)


def _general(effect: Effect, inputs: EffectInputs, changed: dict[str, EffectInputs]) -> Counter[str]:
    """How many columns without a name act through some channels and are functions of some coordinates."""
    built = effect.forms(inputs, 0)
    numbers = [k for k, form in enumerate(built.named) if not form]
    depend: list[list[str]] = [[] for _ in numbers]
    for name, others in changed.items():
        again = effect.forms(others, 0).contributions
        if len(again) != len(built.contributions):
            raise ValueError(f"{effect.name} has as many columns as {name} has values; the list cannot show that")
        for of_column, k in zip(depend, numbers, strict=True):
            if not _alike(built.contributions[k], again[k]):
                of_column.append(name)
    return Counter(
        f"{' + '.join(channel for channel, _ in built.contributions[k])} over {', '.join(names) or 'nothing'}"
        for k, names in zip(numbers, depend, strict=True)
    )


def _alike(one: Contributions, other: Contributions) -> bool:
    return all(
        np.allclose(a, b, rtol=1e-9, atol=1e-12 * float(np.max(np.abs(a), initial=0.0)))
        for (_, a), (_, b) in zip(one, other, strict=True)
    )


def _with_one_thing_changed(inputs: EffectInputs) -> Iterator[tuple[str, EffectInputs]]:
    """The inputs with the values of one coordinate moved on by some readings: it has the same values, elsewhere."""
    context = inputs.context

    def moved(values: np.ndarray) -> np.ndarray:
        return np.roll(values, 7, axis=0)

    for field, name in OF_READING.items():
        yield name, replace(inputs, context=replace(context, **{field: moved(getattr(context, field))}))
    for field, name in OF_DRIVE.items():
        for drive, of_drive in enumerate(inputs.machine.drive_names):
            values = getattr(context, field).copy()
            values[:, drive] = moved(values[:, drive])
            yield f"{name} of {of_drive}", replace(inputs, context=replace(context, **{field: values}))
    for sensor, values in context.temperatures_c.items():
        temperatures = {**context.temperatures_c, sensor: moved(np.asarray(values))}
        yield f"temperature of {sensor}", replace(inputs, context=replace(context, temperatures_c=temperatures))
    history = replace(context.history, drives=moved(context.history.drives))
    yield "way", replace(inputs, context=replace(context, history=history))
    for of_model in fields(inputs):
        values = getattr(inputs, of_model.name)
        if isinstance(values, np.ndarray):
            yield of_model.name, replace(inputs, **{of_model.name: moved(values)})


if __name__ == "__main__":
    LIST.write_text(listed(typical_inputs()), encoding="utf-8")
