"""What effects share that set in at a moment of the campaign."""

from __future__ import annotations

from calibration.effects.api import EffectInputs, EffectParameter, varies

SHORTEST_CAMPAIGN_S = 600.0
ONSET = EffectParameter("onset_s", 0.0, 1e5, "s", "after the campaign's begin")


def untested_in_short_campaign(inputs: EffectInputs) -> str | None:
    """Why a campaign cannot show a lasting change; None if it is long enough."""
    return None if varies(inputs.context.t_s, SHORTEST_CAMPAIGN_S) else "the campaign is too short"
