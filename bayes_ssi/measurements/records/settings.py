"""The numbers that decide what is identified from a record, and what is said of it, with reasons.

Widths in bandwidths are over half-power bandwidths, shares of a frequency over it; evidences are in
nats.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class IdentificationSettings:
    """What is looked for, and what is said of the result."""

    # The search reaches beyond its band by this factor, for the modes next to it.
    search_factor: float = 1.6
    # Nothing is looked for below so many lines (1 / duration).
    fewest_lines: int = 20
    # ζ f T, the record's length in times in which a mode decays by e^(2π): below this the width of
    # a resonance is that of its few lines.
    shortest_decays: float = 1.0
    # Power of a window over the median, beyond which a record is not stationary, though not cut.
    most_variation: float = 8.0
    # Relative width of the blocks of the spectrum that is shown.
    shown_width: float = 0.01
    # Sensors follow the ground where the median coherence, in blocks of this width, is above.
    ground_coherence: float = 0.5
    ground_width: float = 0.05
    # Delays are sought again where shapes still have phases, so often at most; the phases of one
    # mode could be its own, so that it takes two.
    most_delay_searches: int = 3
    fewest_modes_of_delays: int = 2
    # The probability that leaves no doubt, in words.
    sure_probability: float = 0.95


@dataclass(frozen=True)
class SpectraSettings:
    """Blocks of lines, and their spectra in few directions."""

    # Of fewer tapers blocks overlap too much: of two, a quarter of the information counts twice.
    fewest_tapers: int = 3
    # A sensor's level at a line is the mean of this share of the frequency to either side, and of
    # so many half lines at least.
    level_width: float = 0.001
    fewest_level_lines: int = 8
    # Share of a band's blocks that is quiet: its background.
    quiet_share: float = 1.0 / 3.0
    # Added to every direction, as shares of its quiet power and of the mean of all: a background
    # that vanishes in some direction would explain blocks of few lines without bound.
    floor_share: float = 0.1
    mean_floor_share: float = 0.001


@dataclass(frozen=True)
class CandidateSettings:
    """Poles that orders agree on, and peaks of the spectra."""

    # Sections reach from one frequency to this multiple; data reach farther by the flank.
    section_factor: float = 2.0
    flank_factor: float = 1.25
    # Hankel matrices: directions of most motion, block rows, and the highest order.
    most_directions: int = 8
    block_rows: int = 24
    highest_order: int = 24
    # Poles of two orders are one mode within this difference of ln f, or 1 - MAC.
    same_log_frequency: float = 0.015
    same_shape_mac: float = 0.8
    # Share of the orders from which a pole may be a mode.
    least_share_of_orders: float = 0.3
    # Peaks stand out by so many dB and standard deviations of the spectrum; clear ones by more.
    peak_db: float = 3.0
    peak_sds: float = 2.5
    clear_peak_db: float = 6.0
    clear_peak_sds: float = 4.5
    # Blocks of lines for peaks: relative width, and fewest lines, for wide and for narrow peaks.
    block_width: float = 0.006
    fewest_block_lines: tuple[int, int] = (8, 4)
    # Poles at peaks are damped as structures are.
    dampings: tuple[float, float] = (0.004, 0.06)


@dataclass(frozen=True)
class BandSettings:
    """Which modes share a band, how far it reaches, and in which blocks and directions."""

    # Reach beyond the modes: bandwidths, but no farther than a share of the frequency or fewer
    # bandwidths, and no less than a smaller share or so many lines.
    reach_bandwidths: float = 7.0
    widest_share: float = 0.12
    least_bandwidths: float = 2.5
    narrowest_share: float = 0.05
    fewest_lines: int = 40
    # Once modes are known: fewer bandwidths, but those in any case.
    least_bandwidths_of_known_modes: float = 6.0
    # The share of its reach to which a band is cut whose spectra are not explained.
    unexplained_reach: float = 0.6
    # Of two estimates from much the same lines, claimed standard deviations between them.
    most_sds_by_reach: float = 2.5
    # Modes closer than this, times the sum of their bandwidths, share a band.
    shared_band_bandwidths: float = 1.25
    # Dampings of candidates may be far off, most of all below a share of the median of all: modes
    # are grouped, and bands made, as for dampings within these.
    dampings_of_groups: tuple[float, float] = (0.004, 0.04)
    dampings_of_reach: tuple[float, float] = (0.01, 0.04)
    least_share_of_median_damping: float = 0.7
    # Blocks of lines are this share of a damping wide, relative to their frequency.
    block_over_damping: float = 0.25
    most_damping_of_blocks: float = 0.03
    # Directions: those of modes and neighbours and some for the rest; not more than this unless
    # modes are, and each for so many lines.
    spare_directions: int = 2
    most_directions: int = 6
    lines_of_a_direction: float = 10.0


@dataclass(frozen=True)
class FitSettings:
    """Priors of the model of a band, and when a climb to the most probable model ends."""

    # Most probable damping before, and standard deviation of its logarithm.
    damping: float = 0.015
    log_damping_sd: float = 1.0
    # Structures are damped less than this.
    most_damping: float = 0.15
    # Of the rest of a shape beside its largest part, and of what is out of phase in it.
    shape_sd: float = 1.0
    phase_sd: float = 0.1
    # Of the background, its change and its bend over the band, over what is quiet.
    background_sds: tuple[float, float, float] = (10.0, 0.3, 0.1)
    # Of forces coherent with the background, over the most that can be; of forces of neighbours,
    # over the quiet background.
    coherence_sd: float = 0.3
    neighbour_sd: float = 10.0
    # Of direct motion, its change and its bend, over the quiet background.
    direct_sds: tuple[float, float, float] = (2.0, 1.0, 0.5)
    # The largest over the smallest size that a mode's forces may have.
    range_of_forces: float = 1e4
    # Forces of a mode, over the quiet background, below which priors that go with them stay.
    least_forces: float = 1e-4
    # Of coordinates whose prior is flat: it keeps curvatures positive.
    flat_precision: float = 1e-8
    # A climb ends when a step gains less, in nats, or after so many; it has arrived where Newton's
    # step would gain less than the last.
    settled_gain: float = 0.01
    most_steps: int = 40
    arrived_gain: float = 0.5

    @property
    def log_range_of_forces(self) -> float:
        """Of a prior that is flat in the logarithm."""
        return math.log(self.range_of_forces)


@dataclass(frozen=True)
class SelectionSettings:
    """Which modes and which explanation of a band are kept: what each must gain, in nats."""

    # A mode without a clear peak: one in e³ is there. As much decides what drives all.
    nats_of_a_mode: float = 3.0
    # Phases: sensors are in step but for few records.
    nats_of_phases: float = 5.0
    # A second mode at a peak: one peak in a thousand has one that shows as no peak of its own, and
    # a false pair misleads more than a missed one.
    nats_of_a_pair: float = 7.0
    # The least and the most that one band may say of what drives all.
    nats_of_one_band: tuple[float, float] = (-8.0, 50.0)
    # A pole that more than this share of the orders has is tried where there is no peak, too.
    share_of_orders: float = 0.5
    # Below this a damping may be that of a spike of a wider resonance.
    damping_of_spikes: float = 0.01
    # Modes more of a band than this are not looked for.
    most_modes: int = 8
    # Two modes differ in frequency by more than this share of their mean bandwidth.
    least_separation: float = 0.2
    # Modes closer than this, times the sum of half their bandwidths, share a peak.
    shared_peak: float = 3.0
    # Both modes of a pair are within so many half bandwidths of the one mode: farther off there
    # would be a peak.
    pair_reach: float = 1.25
    # A pair starts so many dampings to either side, with this share of the one mode's damping; all
    # starts climb some steps, and the best of them to the top.
    pair_splits: tuple[float, ...] = (0.5, 1.0)
    pair_damping: float = 0.7
    first_steps_of_pairs: int = 8
    pairs_to_the_top: int = 3


@dataclass(frozen=True)
class CheckSettings:
    """What is remarked of the samples of a record. A sound record gives no remark."""

    # A sensor in motion does not stay on one value, or one straight line, for so many samples.
    straight_samples: int = 10
    # Means of parts of a record scatter by less than this times the samples, unless they drift.
    drift_parts: int = 20
    drift_scatter: float = 0.5
    # Coherence is judged in so many windows of at most so many samples; noise is by chance more
    # coherent than is asked of motion in one record of so many.
    windows: int = 40
    longest_window: int = 4096
    records_per_coherent_noise: float = 1e3
    # Lines of machines that are named.
    named_lines: int = 3
    # Late sensors are judged by peaks that stand out by so many times and have at least that share
    # of the power of the highest, if the first singular value is most of their power; one or two
    # peaks tell nothing, as their modes may have phases.
    peak_power: float = 4.0
    least_peak_power: float = 1e-3
    share_of_one_mode: float = 0.8
    fewest_peaks: int = 3
    # Motion besides that of the mode turns sound sensors by some degrees; lateness is so many of
    # its errors.
    sound_phase_deg: float = 3.0
    late_sds: float = 3.7
    # Windows in which a record may not be stationary: periods of the band's lowest frequency, and
    # how many there are at least.
    window_periods: float = 8.0
    fewest_windows: int = 20
    # Times the median power at which a window is left out, and down to which those beside it are.
    strong_power: float = 12.0
    decayed_power: float = 4.0
    # No more of a record than this is left out: it is then no ambient record.
    most_left_out: float = 0.5


@dataclass(frozen=True)
class MachineLineSettings:
    """Which lines of the spectra are those of machines."""

    # Lines to either side that are compared with a line.
    lines_around: int = 22
    # Sensors that are judged together: as many as so few lines can have a spectral matrix of.
    sensors_together: int = 3
    # Of sound records, one in so many shows a line by chance.
    records_per_chance_line: float = 1e4
    # A line counts where it has more of some sensor's power than a sine of this share of its rms
    # value: in the stop band of a filter there is next to nothing, and any line may stand out.
    amplitude_share: float = 0.01
    # The coherent power of so many parts of the record over their whole power: 1 for a sine, one
    # over their number for noise or a shock; a decay over half the record has 0.76.
    parts: int = 8
    coherent_share: float = 0.78
    # Samples that are regressed at a time, so that long records need little memory.
    samples_at_a_time: int = 2**16

    @property
    def power_share(self) -> float:
        """Of a sine of the amplitude that counts."""
        return 0.5 * self.amplitude_share**2


@dataclass(frozen=True)
class MethodSettings:
    """The methods beside the Bayesian FFT."""

    # Lags of NExT-ERA and SSI-cov: periods of the band's lowest frequency.
    correlation_periods: float = 3.0
    # Segments of NExT-ERA's jackknife, each at least twice as long as the lags.
    most_segments: int = 20
    fewest_segments: int = 8
    # Directions of the most motion in its Hankel matrices, as there may be many sensors.
    most_directions: int = 8
    highest_order: int = 40
    # Poles of a record and a part of it are one mode within this of ln f, and above this MAC.
    same_log_frequency: float = 0.05
    same_shape_mac: float = 0.8
    # Segments from which SSI-cov's covariances are estimated: pyOMA2's choice.
    subspace_segments: int = 50
    # Windows of FDD, in periods of the lowest frequency: they resolve its fiftieth.
    fdd_periods: float = 50.0
    # Of TFIE: long enough to tell modes apart, and short enough for many instants.
    tfie_periods: float = 20.0


IDENTIFICATION = IdentificationSettings()
SPECTRA = SpectraSettings()
CANDIDATES = CandidateSettings()
BANDS = BandSettings()
FIT = FitSettings()
SELECTION = SelectionSettings()
CHECKS = CheckSettings()
MACHINE_LINES = MachineLineSettings()
METHODS = MethodSettings()
