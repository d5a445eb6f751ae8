"""Errors of an encoder within one period of its signals."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Deviation, Effect, EffectParameter, EffectSpec, Leg, MotionState
from mock_devices.effects.leg_memory import LegMemory, ways_m

OFFSETS, GAIN, QUADRATURE_RAD = (0.25, -0.15), 1.3, 0.2
SECOND, THIRD = 0.2, 0.1  # harmonics of an encoder's signals
HELD = 0.12  # share of a step by which a counter switches late, in either direction
BITS, FILLS = 4, (0.75, 1.0)  # of a converter; share of its range that the signals fill
IMAGES_M = (0.35, 0.9)  # travel over which the gap of a scale goes from one image of its grating to the next
SET_K, SIGNALS_K = (1.5, 4.0), 1.5  # how far from the reference signals were corrected; kelvin that give the size
DROP_M, SMEARS_M, WETTED = 0.12, 15.0, 2.0  # of a drop: half width at first; way that smears it; error at first
PERIODS, ONE_TRACK = (15, 40), 0.7  # of one track for one more of the other; error of one track over the size
CLOSE, LIFTS_KG = 0.9, (200.0, 500.0)  # contrast without payload; payload that takes all but 1 / e of it away
FULL_PAYLOAD_KG = 400.0
SQUARE = 0.4  # of half the travel: within which of its middle a twisted grating is square to its head, by lot
FOGS_S = (500.0, 1800.0)  # in which a lens is fogged most
SHADOW_RAD = 0.0711  # largest error of triangles


class Interpolation(Effect):
    """Errors within one period of the encoder's signals: offset once, unequal amplitude or phase twice a period.

    `ellipse`: the arc tangent of two signals with offsets, unequal gain and a phase that is not a quarter, as in P. L.
    M. Heydemann, "Determination and Correction of Quadrature Fringe Measurement Errors in Interferometers" (1981).
    `harmonics`: the arc tangent of two signals that are no pure sines, among what L. M. Sanchez-Brea, T. Morlanes,
    "Metrological Errors in Optical Encoders" (2008), go through: the second harmonic errs once and three times a
    period, the third four times.
    `shadow_gratings`: two gratings that cast shadows give triangles, not sines, whose arc tangent errs four times a
    period: J. Guild, "Diffraction Gratings as Measuring Scales" (1960).
    `coarse_count`: whole periods are counted and nothing in between, which leaves the sawtooth of W. R. Bennett,
    "Spectra of Quantized Signals" (1948); the counter switches late in either direction, like the trigger of O. H.
    Schmitt, "A Thermionic Trigger" (1938).
    `self_images`: the scale is not parallel to the guide, and the image of its grating changes with the gap and comes
    back at certain distances, as H. F. Talbot, "Facts Relating to Optical Science, No. IV" (1836) found. In between the
    third harmonic of the signals has the opposite sign, and with it the error four times a period.
    `few_bits`: both signals go through a converter of BITS bits before the arc tangent, which so goes in steps of
    unequal width: quantisation in W. Kester, "Analog-Digital Conversion" (2004). The RMS is that of a sine of the size.
    `warm_signals`: a stored code corrects offset and gain of the signals as they were at one temperature, and what has
    changed since then goes with the temperature: N. Hagiwara, Y. Suzuki, H. Murase, "A Method of Improving the
    Resolution and Accuracy of Rotary Encoders Using a Code Compensation Technique" (1992). The size is that of
    SIGNALS_K.
    `smeared_drop`: a drop of oil lies on the scale, and the head smears it with every metre of its way, wider with the
    root of the way and as much thinner; where it is thick it takes light from one signal: dragged films in L. Landau,
    B. Levich, "Dragging of a Liquid by a Moving Plate" (1942).
    `twisted_grating`: the scale lies twisted, and its head leans the more the farther it is from where both are square,
    so that the phase between its fields of moiré errs this way and that way on both sides: G. Oster, M. Wasserman, C.
    Zwerling, "Theoretical Interpretation of Moiré Patterns" (1964). The size is that half the travel away.
    `two_tracks`: the place is the mean of two tracks, the other one of which has one period more for some of this one,
    and both have offsets, so that the errors beat: P. Vernier, "La construction, l'usage, et les propriétés du quadrant
    nouveau de mathématique" (1631).
    `lifted_head`: the payload tilts the carriage and lifts one end of the head off the scale, where the contrast of two
    gratings falls off, so that one signal is weaker and the arc tangent errs in even harmonics: Lord Rayleigh, "On the
    Manufacture and Theory of Diffraction-Gratings" (1874). The size is the first term with FULL_PAYLOAD_KG.
    `neighbours_signal`: the cable of the next drive's encoder lies beside that of one of this one's two signals, which
    so contains some of it, and the error goes with the sum and with the difference of both phases: O. Heaviside,
    "Electrical Papers" (1892). Both scales are alike. The size is that of either.
    `leaning_head`: springs that should guide its head in parallel let that lean by the direction of the last motion,
    and so one of the signals has an offset to one side or the other: R. V. Jones, "Some Parasitic Deflexions in
    Parallel Spring Movements" (1951).
    `fogged_lens`: the lens before one of the signals is fogged after the campaign's begin, which takes its light and
    sets it off, and clears again, more slowly: J. Aitken, "On Dust, Fogs, and Clouds" (1880). The size is that with
    most fog.
    """

    def setup(self) -> None:
        """Phase of the scale; how fast its gap grows along the travel, and where that begins."""
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self.image_m = float(self.rng.uniform(*IMAGES_M))
        self.gap = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self.levels = (2**BITS - 1) / 2.0 * float(self.rng.uniform(*FILLS))  # of the signals' amplitude
        self.rms = float(np.std(self._in_steps(np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False))))
        self._ways = LegMemory(ways_m)
        self.set_k = float(self.rng.uniform(*SET_K)) * float(self.rng.choice([-1.0, 1.0]))

        middle, half = self.site.drive_range_m(self.place)
        self.drop_m = middle + half * float(self.rng.uniform(-0.5, 0.5))
        self.square_m = middle + half * float(self.rng.uniform(-SQUARE, SQUARE))
        own = self.rng.spawn(1)[0]
        self.periods = int(own.integers(PERIODS[0], PERIODS[1] + 1))
        self.beats = float(own.uniform(0.0, 2.0 * np.pi))
        self.lifts_kg = float(own.uniform(*LIFTS_KG))
        self.next_at = float(own.uniform(0.0, 2.0 * np.pi))
        self.leans_at = float(own.uniform(0.0, 2.0 * np.pi))
        self.fogs_s = float(own.uniform(*FOGS_S))

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the head smear the drop."""
        if self.variant == "smeared_drop" and drive == self.place:
            self._ways.record(leg)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider: the count is wrong, not the slider, but the drive goes by its count."""
        q = state.q_m[:, self.place]
        phase = 2.0 * np.pi * q / self.values["pitch_m"] + self.phase
        y: Array = np.sin(2.0 * phase)
        if self.variant == "offset":
            y = np.sin(phase)
        elif self.variant == "both":
            y = 0.7 * np.sin(phase) + 0.7 * np.sin(2.0 * phase + 0.8)
        elif self.variant in ("ellipse", "harmonics", "two_tracks"):
            shapes = {"ellipse": self._ellipse, "harmonics": self._harmonics, "two_tracks": self._two_tracks}
            y = shapes[self.variant](phase)
        elif self.variant in ("lifted_head", "neighbours_signal", "leaning_head", "fogged_lens"):
            by_state = {
                "lifted_head": self._lifted,
                "neighbours_signal": self._beside,
                "leaning_head": self._leant,
                "fogged_lens": self._fogged,
            }
            y = by_state[self.variant](phase, state)
        elif self.variant == "shadow_gratings":
            error = np.arctan2(np.arcsin(np.sin(phase)), np.arcsin(np.cos(phase))) - phase
            y = ((error + np.pi) % (2.0 * np.pi) - np.pi) / SHADOW_RAD
        elif self.variant == "coarse_count":
            y = 2.0 * ((phase / (2.0 * np.pi) - HELD * state.direction[:, self.place]) % 1.0) - 1.0
        elif self.variant == "self_images":
            y = np.cos(2.0 * np.pi * q / self.image_m + self.gap) * np.sin(4.0 * phase)
        elif self.variant == "few_bits":
            y = math.sqrt(0.5) * self._in_steps(phase) / self.rms
        elif self.variant == "warm_signals":
            machine = self.site.machine
            above_k = state.parts_c[machine.expansion["drives"].sensor] - machine.reference_temperature_c
            y = (above_k - self.set_k) / SIGNALS_K * (np.sin(phase) + 0.5 * np.sin(2.0 * phase + 1.0))
        elif self.variant == "smeared_drop":
            wider = np.sqrt(1.0 + self._ways.at(state, self.place)[:, 0] / SMEARS_M)
            y = WETTED / wider * np.exp(-(((q - self.drop_m) / (DROP_M * wider)) ** 2)) * np.sin(phase)
        elif self.variant == "twisted_grating":
            _, half = self.site.drive_range_m(self.place)
            y = (q - self.square_m) / half * y
        elif self.variant == "dirty_scale":  # weaker signals over part of the travel
            middle, half = self.site.drive_range_m(self.place)
            y = np.sin(phase) * (0.5 + 1.2 * np.exp(-(((q - middle) / (0.5 * half)) ** 2)))
        deviation.travel_m[:, self.place] += self.size * y

    def _in_steps(self, phase: Array) -> Array:
        """Error of the arc tangent (n,) of signals in steps, which lie on either side of zero."""
        cosine, sine = (np.floor(self.levels * x) + 0.5 for x in (np.cos(phase), np.sin(phase)))
        error = np.arctan2(sine, cosine) - phase
        return np.asarray((error + np.pi) % (2.0 * np.pi) - np.pi)

    def _two_tracks(self, phase: Array) -> Array:
        """Error of the mean of two tracks (n,) of unequal periods, over the size."""
        return np.asarray(ONE_TRACK * (np.sin(phase) + np.sin(phase * (1.0 + 1.0 / self.periods) + self.beats)))

    def _lifted(self, phase: Array, state: MotionState) -> Array:
        """Error of the arc tangent (n,) of a weaker sine, over its first term with a full payload."""
        kept, least = (CLOSE * np.exp(-kg / self.lifts_kg) for kg in (state.payload_kg, FULL_PAYLOAD_KG))
        error = np.arctan2(kept * np.sin(phase), np.cos(phase)) - phase
        return np.asarray(((error + np.pi) % (2.0 * np.pi) - np.pi) * (1.0 + least) / (1.0 - least))

    def _beside(self, phase: Array, state: MotionState) -> Array:
        """Error (n,) by some of the next drive's signal in the sine, over that of the sum of both phases."""
        others_m = state.q_m[:, (self.place + 1) % len(self.site.machine.sliders)]
        others = 2.0 * np.pi * others_m / self.values["pitch_m"] + self.next_at
        return np.asarray(2.0 * np.cos(phase) * np.sin(others))

    def _leant(self, phase: Array, state: MotionState) -> Array:
        """Error (n,) by the offset of one signal, to the side of the last motion."""
        return np.asarray(state.direction[:, self.place] * np.sin(phase + self.leans_at))

    def _fogged(self, phase: Array, state: MotionState) -> Array:
        """Error (n,) by the offset of a signal whose lens is fogged."""
        fogged = self.elapsed_s(state) / self.fogs_s
        return np.asarray(fogged * np.exp(1.0 - fogged) * np.sin(phase))

    def _harmonics(self, phase: Array) -> Array:
        """Error of the arc tangent over its first term; the sine's head is a quarter of a period behind."""
        quarter = phase - 0.5 * np.pi
        cosine, sine = (np.cos(x) + SECOND * np.cos(2.0 * x) + THIRD * np.cos(3.0 * x) for x in (phase, quarter))
        error = np.arctan2(sine, cosine) - phase
        return np.asarray(((error + np.pi) % (2.0 * np.pi) - np.pi) / (SECOND * math.sqrt(0.5)))

    def _ellipse(self, phase: Array) -> Array:
        """Error of the arc tangent over its offset: all errors in the proportion in which they may be set off."""
        cosine = np.cos(phase) + OFFSETS[0]
        sine = (np.sin(phase + QUADRATURE_RAD) + OFFSETS[1]) * GAIN
        error = np.arctan2(sine, cosine) - phase
        return np.asarray(((error + np.pi) % (2.0 * np.pi) - np.pi) / np.hypot(*OFFSETS))


EFFECTS = (
    EffectSpec(
        name="encoder_interpolation",
        kind="catalogue",
        place="drive",
        size=EffectParameter("amplitude_m", 2e-7, 5e-6, 3e-4, "of the first term"),
        variants=(
            "amplitude",
            "offset",
            "both",
            "dirty_scale",
            "ellipse",
            "harmonics",
            "shadow_gratings",
            "coarse_count",
            "self_images",
            "few_bits",
            "warm_signals",
            "smeared_drop",
            "twisted_grating",
            "two_tracks",
            "lifted_head",
            "neighbours_signal",
            "leaning_head",
            "fogged_lens",
        ),
        final="fogged_lens",
        reveals="many drive positions off a grid, by variant of the other drive, too, payload, temperature, time, "
        "direction or distance moved, SMRs on the sliders",
        make=Interpolation,
        others=(EffectParameter("pitch_m", 2e-5, 2e-4, 2e-3, "period of the encoder's signals"),),
    ),
)
