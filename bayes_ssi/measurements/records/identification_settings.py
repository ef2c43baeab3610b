"""The numbers that decide what is identified from a record, and what is said of it, with reasons.

Bandwidths are half-power bandwidths; a width or a share is relative to the frequency where nothing
else is said; evidences are in nats.
"""

import math
from dataclasses import dataclass

# What the command line calls each method, and how it is called in tables.
BAYESIAN_FFT = "bayesian-fft"
METHOD_NAMES = {
    BAYESIAN_FFT: "Bayesian FFT",
    "next-era": "NExT-ERA",
    "ssi-cov": "SSI-cov",
    "fdd": "FDD",
    "tfie": "TFIE",
}


@dataclass(frozen=True)
class BandFitSettings:
    """Priors of the model of a band, when a climb to it ends, and which modes it keeps."""

    damping: float = 0.015  # most probable before
    log_damping_sd: float = 1.0
    most_damping: float = 0.15  # structures are damped less
    shape_sd: float = 1.0  # of a shape beside its largest part
    phase_sd: float = 0.1  # of what is out of phase in it
    background_sds: tuple[float, float, float] = (10.0, 0.3, 0.1)  # it, its change, its bend
    coherence_sd: float = 0.3  # of forces coherent with the background, over the most that can be
    neighbour_sd: float = 10.0  # of forces of neighbours, over the quiet background
    direct_sds: tuple[float, float, float] = (2.0, 1.0, 0.5)  # direct motion, its change, its bend
    # Of the largest over the smallest that a mode may have; the prior is flat in the logarithm.
    log_range_of_forces: float = math.log(1e4)
    least_forces: float = 1e-4  # over the quiet background; priors of smaller ones stay
    flat_precision: float = 1e-8  # of flat priors: it keeps curvatures positive
    settled_gain: float = 0.01  # nats of a step with which a climb ends
    most_steps: int = 40
    arrived_gain: float = 0.5  # nats that Newton's step would gain where a climb has not arrived

    # What modes and explanations must gain to be kept, in nats, and where a mode or two are tried.
    nats_of_a_mode: float = 3.0  # without a clear peak: one in e³ is there; also of one source
    nats_of_phases: float = 5.0  # sensors are in step but for few records
    # One peak in a thousand has a second mode that shows as no peak of its own, and a false pair
    # misleads more than a missed one.
    nats_of_a_pair: float = 7.0
    nats_of_one_band: tuple[float, float] = (-8.0, 50.0)  # at most, of what drives all
    share_of_orders: float = 0.5  # beyond which a pole is tried where there is no peak, too
    damping_of_spikes: float = 0.01  # below: perhaps of a spike of a wider resonance
    most_modes: int = 8  # of a band; more are not looked for
    least_separation: float = 0.2  # of two modes, over their mean bandwidth
    shared_peak: float = 3.0  # times the sum of half bandwidths: modes that are closer share a peak
    pair_reach: float = 1.25  # half bandwidths from the one mode: farther off there were a peak
    pair_splits: tuple[float, ...] = (0.5, 1.0)  # dampings to either side, at first
    pair_damping: float = 0.7  # over the one mode's, at first
    first_steps_of_pairs: int = 8  # of all starts
    pairs_to_the_top: int = 3  # the best of the starts


FIT = BandFitSettings()
