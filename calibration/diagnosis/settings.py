"""The numbers that decide a verdict, each with its source.

Where the source is "tuned", the value was chosen on simulated rigs with known truth (`benchmarks.withheld.make_set`)
without the final variants of the mock plant, which are reserved for scoring (docs/decisions/0007-marginal-evidence.md,
docs/explanation/withheld.md). No value belongs to a single effect. Log evidence is in natural logarithms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array


@dataclass(frozen=True)
class VerdictSettings:
    """Thresholds of the search for causes, of its probabilities, and of what counts as equivalent."""

    # The search for causes.
    max_causes: int = 3
    """Effects that are included at most. Source: as many as a report lists and a user can act on."""
    detection_threshold: float = 6.0
    """Log evidence below which no effect is included. Source: tuned."""
    worth_refining: float = 0.0
    """The same at a further place, below which it is not refined: a law may explain what no column of it does. Source:
    computing time."""
    least_gain_of_channel: float = 8.0
    """Log evidence by which what is anew at each visit must explain more than any function at other channels. Source:
    tuned; of four pins by chance 37 to 220, of effects of no catalogue -15 to 6, of sliders by chance 11 to 15."""
    min_gain_share: float = 0.006
    """Log evidence that a further cause must add, over what is explained already. Source: tuned."""
    min_gain_share_same_part: float = 0.03
    """The same through a channel through which a cause acts already, and at a further place of an effect: the rest may
    be that cause's model error. Source: tuned."""
    further_cause_penalty: float = 10.0
    """Log evidence that each further cause costs, as several effects together mimic a single one. Source: tuned."""
    further_cause_penalty_share: float = 0.005
    """The same, over what is explained with it. Source: tuned."""
    further_cause_penalty_share_same_part: float = 0.02
    """The same through a channel through which a cause acts already. Source: tuned."""
    leaders: int = 3
    """Of the ranking, with how many the search begins where one cause is not enough. Source: computing time; no
    more of 60 pairs were right with 4."""
    leaders_share: float = 0.65
    """Of what is explained, what such an effect must explain alone. Source: computing time."""
    leaders_share_if_much_is_left: float = 0.45
    """The same where half of what would make it `unknown` is left. Source: tuned; computing time."""
    search_work: float = 3.6e6
    """Readings times columns that steps add, of all searches for causes: beyond it, and for most beyond a part, none
    begins. Source: computing time, about 3 s for 1e6."""
    residual_search_threshold: float = 4.0
    """Log evidence of the best non-parametric alternative below which the search ends. Source: tuned."""
    refined_share: float = 0.6
    """Departures of an effect, its curves and further places are looked for above this share of the strongest effect's
    log evidence; where a law of struts leads, other laws are above the detection threshold. Source: computing time; no
    more single effects or pairs of the mock were right with 0.4."""
    curve_fit_share_at_place: float = 0.8
    """The same, and curves, among the places of one effect. Source: as above."""
    curve_fit_margin_at_place: float = 5.0
    """Log evidence below the strongest place's, down to which places are refined in any case. Source: as above."""

    # Probabilities.
    none_prior_log_odds: float = 8.0
    """Prior log odds of `none` against any effect at all. Source: tuned to the rate of false alarms; fitted ones are
    larger still, and hide small effects."""
    excess_threshold: float = 12.0
    """Excess log evidence of the best non-parametric alternative at which `unknown` has even odds. Source: tuned."""
    excess_share: float = 0.022
    """Increase of that threshold with the explained log evidence: model error of a correct effect. Source: tuned."""
    strong_evidence: float = 6500.0
    """Explained log evidence beyond which it increases twice as fast, as in what is so strong model errors stand out of
    the noise wholly. Source: tuned."""
    excess_exponent: float = 0.8
    """Power of what is left over, in units of that threshold, with which the odds of `unknown` grow: model errors and
    effects of no catalogue are of any size, so what tells them apart is its logarithm. Source: tuned; within the range
    of the fit (docs/decisions/0058-by-its-logarithm.md)."""
    least_left_over: float = 0.03
    """What counts as left over, in the same units, where nothing is: an effect of no catalogue may be imitated by a
    known one. Source: as above."""
    departure_share: float = 0.12
    """Of the log evidence that unexpected departures from forms add, what counts as excess. Source: tuned."""
    temperature_share: float = 0.003
    """Increase, with the strongest log evidence, of the temperature that divides differences of log evidence, because
    no basis set is exact. Source: tuned to calibrated probabilities."""
    misleading_probability: float = 0.15
    """Probability that the effect acts in a way that none of its basis sets has, so that differences of log evidence
    mislead. Source: tuned, also on archives of another simulator; within the range of the fit."""
    misleading_temperature_share: float = 0.17
    """Increase of the temperature in that case. Source: as above."""

    # How far effects depart from their forms.
    smooth_departures: tuple[float, float] = (0.05, 0.15)
    """Standard deviations, over the form, of smooth departures from it that are tried. Source: tuned."""
    dependence_shares: tuple[float, float] = (0.4, 1.0)
    """The same of dependences on coordinates with which the effect's strength may vary wholly. Source: as in the prior
    of the form itself."""
    departures_by_visit: tuple[float, float] = (0.15, 0.6)
    """The same of what differs from visit to visit. Source: tuned."""

    # Uncertainty of sizes.
    u_of_form: float = 0.11
    """Standard uncertainty of what is seen of an effect, over its size, as no form is exact. Source: tuned."""
    u_of_absorbed: float = 0.55
    """The same of what the calibration absorbs of it, which follows from the form alone. Source: tuned."""

    # Equivalent effects.
    equivalent_sigma: float = 0.3
    """RMS difference of two predictions below which effects are equivalent. Source: definition of *equivalent* in
    docs/reference/definitions.md and docs/explanation/diagnosis.md."""
    distinguishable: float = 10.0
    """Log evidence below the verdict's at which the data exclude an effect. Source: tuned."""
    distinguishable_share: float = 0.01
    """The same, over the verdict's own log evidence. Source: tuned."""
    max_compared: int = 6
    """Effects next in the ranking that are compared with the verdict. Source: computing time."""

    def threshold_of_excess(self, explained: Array | float) -> Array:
        """Excess log evidence of an alternative beside effects that explain so much, at which `unknown` has even
        odds; of one diagnosis or of several at once."""
        positive = np.maximum(explained, 0.0)
        strong = np.maximum(positive - self.strong_evidence, 0.0)
        return np.asarray(self.excess_threshold + self.excess_share * (positive + strong))

    def odds_of_unknown(self, left_over: Array | float) -> Array:
        """Odds that what acts is of no catalogue, given what is left over beside effects, in units of the threshold of
        the excess; of one diagnosis or of several at once."""
        least = self.least_left_over
        return np.asarray(((np.maximum(left_over, 0.0) + least) / (1.0 + least)) ** self.excess_exponent)


VERDICT = VerdictSettings()

FITTED = (
    "none_prior_log_odds",
    "excess_threshold",
    "excess_share",
    "excess_exponent",
    "least_left_over",
    "departure_share",
    "misleading_probability",
    "misleading_temperature_share",
    "smooth_departures",
    "departures_by_visit",
    "u_of_form",
    "u_of_absorbed",
)
"""What `make fit-verdict` fits: sizes of departures and at most ten constants, none of which belongs to one effect. Of
the departures, whose two sizes keep their ratio, one factor each; those of sizes follow from sizes that were stated,
all others from the evidence that a diagnosis keeps."""
