"""Which effects of a catalogue the readings can show, and why not the others."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from calibration.diagnosis.channel_responses import UNKNOWN_CHANNEL
from calibration.effects.api import Effect, EffectInputs
from calibration.effects.catalogue import Catalogue
from calibration.effects.partial_context import NotRecorded, PartialContext

NO_INSTRUMENT = "no station measured reflectors; nothing that was read responds to it"


def detectable_effects(inputs: EffectInputs, catalogue: Catalogue) -> tuple[list[Effect], dict[str, str]]:
    """The effects that the campaign can show; for the others, by name, the reason why not."""
    reasons = {effect.name: _why_untested(inputs, effect) for effect in catalogue.effects}
    detectable = [effect for effect in catalogue.effects if reasons[effect.name] is None]
    return detectable, {name: reason for name, reason in reasons.items() if reason is not None}


def _why_untested(inputs: EffectInputs, effect: Effect) -> str | None:
    """Why the readings cannot show an effect; None if they can."""
    not_said = inputs.context.not_said
    if not not_said:
        return effect.untested(inputs)
    if _acts_on_instrument_only(inputs, effect):
        return NO_INSTRUMENT
    try:
        if "t_s" in not_said:
            _build(effect, _without(inputs, ("t_s",)))
        return effect.untested(_without(inputs, inputs.context.missing))
    except NotRecorded as error:
        return str(error)


def _without(inputs: EffectInputs, names: Collection[str]) -> EffectInputs:
    """The inputs without some fields of the context that the readings do not say."""

    def onsets(_channels: Sequence[str]) -> Sequence[tuple[float, float]]:
        raise NotRecorded(inputs.context.not_said["t_s"])

    return replace(
        inputs,
        context=PartialContext.of(inputs.context, names),
        onsets=onsets if "t_s" in names else inputs.onsets,
    )


def _build(effect: Effect, inputs: EffectInputs) -> None:
    """Build all basis sets of an effect and its curves: it may then ask for what is not there."""
    for place in range(len(effect.places(inputs.machine))):
        effect.forms(inputs, place)
        for curve in effect.curves(inputs, place):
            curve.tangent(curve.starts[0])


def _acts_on_instrument_only(inputs: EffectInputs, effect: Effect) -> bool:
    """Whether nothing that was read responds to any channel of an effect: it acts on a station or on reflectors."""
    if any(channel.startswith("station.") for channel in inputs.channels):
        return False
    if effect.place == "smr":
        return True
    if not effect.places(inputs.machine):
        return False
    acting = {channel for column in effect.forms(inputs, 0).contributions for channel, _ in column}
    known = {*inputs.channels}
    return bool(acting) and not any(c in known or c.startswith(UNKNOWN_CHANNEL) for c in acting)
