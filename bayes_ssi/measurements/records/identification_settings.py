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
class IdentificationSettings:
    """What is looked for, and what is said of the result."""

    search_factor: float = 1.6  # by which the search goes beyond its band, for the modes next to it
    fewest_lines: int = 20  # (1 / duration) below which nothing is looked for
    # ζ f T, the record's length in times in which a mode decays by e^(2π): below this the width of
    # a resonance is that of its few lines.
    shortest_decays: float = 1.0
    most_variation: float = 8.0  # power of a window over the median; beyond, loads are not steady
    shown_width: float = 0.01  # of the blocks of the spectrum that is shown
    ground_coherence: float = 0.5  # median; above it, sensors follow the ground
    ground_width: float = 0.05  # of the blocks in which coherence with the ground is judged
    most_delay_searches: int = 3  # delays are sought again where shapes still have phases
    fewest_modes_of_delays: int = 2  # the phases of one could be its own


@dataclass(frozen=True)
class ModeCandidateSettings:
    """Poles that orders agree on, and peaks of the spectra."""

    section_factor: float = 2.0  # from the lowest to the highest frequency of a section
    flank_factor: float = 1.25  # by which a section's data reach farther
    most_directions: int = 8  # of most motion, in Hankel matrices
    block_rows: int = 24  # of Hankel matrices
    highest_order: int = 24
    same_log_frequency: float = 0.015  # poles of two orders are one mode within this
    same_shape_mac: float = 0.8  # and above this
    least_share_of_orders: float = 0.3  # from which a pole may be a mode
    peak_db: float = 3.0  # by which peaks stand out
    peak_sds: float = 2.5  # standard deviations of the spectrum by which they do
    clear_peak_db: float = 6.0  # those whose mode is not left out
    clear_peak_sds: float = 4.5
    block_width: float = 0.006  # of the blocks of lines for peaks
    fewest_block_lines: tuple[int, int] = (8, 4)  # for wide and for narrow peaks
    dampings: tuple[float, float] = (0.004, 0.06)  # of poles at peaks, as of structures


@dataclass(frozen=True)
class BandSettings:
    """Blocks of lines and their spectra, which modes share a band, and how far it reaches."""

    fewest_tapers: int = 3  # of two, blocks overlap: a quarter of the information counts twice
    level_width: float = 0.001  # to either side of a line, over which a sensor's level is a mean
    fewest_level_lines: int = 8  # half lines of that mean
    quiet_share: float = 1.0 / 3.0  # of a band's blocks: its background
    # Added to every direction, as shares of its quiet power and of the mean of all: a background
    # that vanishes in some direction would explain blocks of few lines without bound.
    floor_share: float = 0.1
    mean_floor_share: float = 0.001

    # Reach beyond the modes: bandwidths, but no farther than a share of the frequency or fewer
    # bandwidths, and no less than a smaller share or so many lines.
    reach_bandwidths: float = 7.0
    widest_share: float = 0.12
    least_bandwidths: float = 2.5
    narrowest_share: float = 0.05
    fewest_lines: int = 40
    least_bandwidths_of_known_modes: float = 6.0  # once the modes of bands are known
    unexplained_reach: float = 0.6  # share to which a band is cut that is not explained
    most_sds_by_reach: float = 2.5  # between two estimates from much the same lines
    shared_band: float = 1.25  # times the sum of bandwidths: modes that are closer share a band
    # Dampings of candidates may be far off, most of all below a share of the median of all: modes
    # are grouped, and bands made, as for dampings within these.
    dampings_of_groups: tuple[float, float] = (0.004, 0.04)
    dampings_of_reach: tuple[float, float] = (0.01, 0.04)
    least_share_of_median_damping: float = 0.7
    block_over_damping: float = 0.25  # width of blocks of lines
    most_damping_of_blocks: float = 0.03
    spare_directions: int = 2  # besides those of modes and neighbours
    most_directions: int = 6  # unless there are more modes
    lines_of_a_direction: float = 10.0  # at least


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


@dataclass(frozen=True)
class RecordCheckSettings:
    """What is remarked of the samples of a record, and taken out of it.

    A sound record gives no remark.
    """

    straight_samples: int = 10  # for which no sensor in motion is on one value or straight line
    drift_parts: int = 20  # whose means are compared
    drift_scatter: float = 0.5  # of these means, over that of the samples
    windows: int = 40  # in which coherence and phases are judged
    longest_window: int = 4096  # samples
    records_per_coherent_noise: float = 1e3  # in one of which noise is coherent by chance
    named_lines: int = 3  # of machines
    peak_power: float = 4.0  # over what is beside a peak where phases are judged
    least_peak_power: float = 1e-3  # over that of the highest peak
    share_of_one_mode: float = 0.8  # of the power, by the first singular value
    fewest_peaks: int = 3  # one or two tell nothing: their modes may have phases
    sound_phase_deg: float = 3.0  # by which other motion turns sensors that are in step
    late_sds: float = 3.7  # errors beyond which a sensor is late
    window_periods: float = 8.0  # of the lowest frequency, of windows that may not be stationary
    fewest_windows: int = 20
    strong_power: float = 12.0  # over the median, at which a window is left out
    decayed_power: float = 4.0  # down to which those beside it are
    most_left_out: float = 0.5  # of a record; where it would be more, it is no ambient record

    # Which lines of the spectra are those of machines.
    lines_around: int = 22  # to either side, with which a line is compared
    sensors_together: int = 3  # as many as so few lines can have a spectral matrix of
    records_per_chance_line: float = 1e4  # in one of which a line shows by chance
    # Over some sensor's rms value: in the stop band of a filter any line may stand out.
    least_amplitude: float = 0.01
    parts_of_a_sine: int = 8  # of the record, through all of which a sine has one phase
    # The coherent power of the parts over their power: 1 for a sine, one over their number for
    # noise or a shock; a decay over half the record has 0.76.
    coherent_share: float = 0.78
    samples_at_a_time: int = 2**16  # of a regression, so that long records need little memory


@dataclass(frozen=True)
class OtherMethodSettings:
    """The methods beside the Bayesian FFT."""

    correlation_periods: float = 3.0  # of the lowest frequency: lags of NExT-ERA and SSI-cov
    most_segments: int = 20  # of NExT-ERA's jackknife
    fewest_segments: int = 8
    most_directions: int = 8  # of the most motion, in its Hankel matrices
    highest_order: int = 40
    same_log_frequency: float = 0.05  # poles of a record and a part are one mode within this
    same_shape_mac: float = 0.8  # and above this
    subspace_segments: int = 50  # for SSI-cov's covariances, as pyOMA2 chooses
    fdd_periods: float = 50.0  # of a window, which resolves a fiftieth of the lowest frequency
    tfie_periods: float = 20.0  # long enough to tell modes apart, and short for many instants


IDENTIFICATION = IdentificationSettings()
CANDIDATES = ModeCandidateSettings()
BANDS = BandSettings()
FIT = BandFitSettings()
CHECKS = RecordCheckSettings()
METHODS = OtherMethodSettings()
