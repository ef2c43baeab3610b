"""What looks wrong with the samples of a record, and what disturbs it.

A sound record of an ambient test gives no remark.

Machines run at sines, which a record of any length shows in one line, and all through it.
At a sine the transforms z of a few sensors stand out of their spectral matrix G nearby: for
stationary motion, zᴴ G⁻¹ z with G the mean of m lines is m n / (m - n + 1) times a variable of
Fisher's F(2 n, 2 (m - n + 1)). What sensors do together, as under ground motion, does not hide a
sine that they share in other proportions. A resonance is at least a few lines wide, and its phase
wanders; a shock is over soon. A sine has one phase in all parts of the record.

A spectral model takes loads to be the same all the time. The motion of a band in short windows is
compared with its median: where it is many times as strong, those windows are left out, with what
follows until it has decayed.
"""

from collections.abc import Sequence

import numpy as np

from bayes_ssi.foundations.arrays import BoolArray, ComplexArray, FloatArray, IntArray

STRAIGHT_SAMPLES = 10  # for which no sensor in motion is on one value or straight line
LONG_OVER_USUAL = 4.0  # times the length that a hundredth of a sensor's straight runs exceed
REPEATED_SAMPLES = 50  # that no sensor in motion has twice
MOST_FILLED = 0.2  # of a sensor's samples; with more it is left out, with fewer the instants are
# Gaussian motion of which a share is clipped is smaller by as much (Bussgang 1952).
MOST_CLIPPED = 0.001
FEWEST_CLIPPED = 8  # samples
CLIPPED = "clipped; {:.2g} % of its samples are at an extreme value"
NOISE_ALONE = "noise alone, coherent with no other sensor at any frequency; is it connected?"
WINDOWS = 40  # in which coherence is judged
LONGEST_WINDOW = 4096  # samples
RECORDS_PER_COHERENT_NOISE = 1e3  # in one of which noise is coherent by chance
SMOOTHED_LINES, OWN_PEAK_DB = 5, 6.0  # a sensor's own peak, which noise alone has not
NAMED_LINES = 3  # of machines
WINDOW_PERIODS = 8.0  # of the lowest frequency, of windows that may not be stationary
FEWEST_WINDOWS = 20
STRONG_POWER = 12.0  # over the median, at which a window is left out
DECAYED_POWER = 4.0  # down to which those beside it are
MOST_LEFT_OUT = 0.5  # of a record; where it would be more, it is no ambient record
# Of lines that are those of machines:
LINES_AROUND = 22  # to either side, with which a line is compared
SENSORS_TOGETHER = 3  # as many as so few lines can have a spectral matrix of
RECORDS_PER_CHANCE_LINE = 1e4  # in one of which a line shows by chance
# Over some sensor's rms value: in the stop band of a filter any line may stand out.
LEAST_AMPLITUDE = 0.01
PARTS_OF_A_SINE = 8  # of the record, through all of which a sine has one phase
# The coherent power of the parts over their power: 1 for a sine, one over their number for
# noise or a shock; a decay over half the record has 0.76.
COHERENT_SHARE = 0.78
SAMPLES_AT_A_TIME = 2**16  # of a regression, so that long records need little memory

HANN_SPREAD = 2  # lines to either side over which a Hann window spreads a sine
HANN_LEAKAGE = 1e-3  # of its power beyond, at most
FLANK_LINES, FAR_LINES = range(3, 6), range(12, LINES_AROUND + 1)  # to either side
FLANKS_OVER_FAR = 4.0  # in power; six lines of noise alone have it once in thousands


def machine_lines(samples: FloatArray, rate_hz: float) -> FloatArray:
    """Frequencies in Hz at which machines seem to run, the strongest first.

    They are right to some hundredths of a line (1 / duration) for the weakest, and better for
    stronger ones. Modes with ζ f T below 1, T the duration, look the same.
    """
    n_samples = samples.shape[1]
    lines: list[tuple[float, float]] = []
    if n_samples >= 20 * LINES_AROUND:
        for group in np.array_split(samples, -(-len(samples) // SENSORS_TOGETHER) or 1):
            lines += _lines_of(group[np.ptp(group, axis=1) > 0.0])
    strongest: list[float] = []
    for _, line in sorted(lines, reverse=True):
        if all(abs(line - other) > HANN_SPREAD for other in strongest):
            strongest.append(line)
    return np.array(strongest) * rate_hz / n_samples


def _lines_of(samples: FloatArray) -> list[tuple[float, float]]:
    """Share of the power, and frequency in lines, of the sines in a few sensors, which move."""
    from scipy.stats import f as fisher

    n, n_samples = samples.shape
    if not n:
        return []
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n_samples) / n_samples)
    samples = samples - samples.mean(1, keepdims=True)
    transforms = np.fft.rfft(window * samples)
    powers = np.abs(transforms) ** 2
    # Of a sine's power in a Hann window two thirds are in its line; a drift is no machine.
    around = LINES_AROUND
    shares = (1.5 * powers / powers[:, around:].sum(1, keepdims=True)).max(0)
    lines = np.flatnonzero(shares > 0.5 * LEAST_AMPLITUDE**2)
    lines = lines[(lines >= around) & (lines < len(shares) - around)]
    if not len(lines):
        return []
    ratios, directions = _standing_out(transforms, lines)
    m = around - HANN_SPREAD  # windowed neighbours are alike: half of the lines count
    one_in = RECORDS_PER_CHANCE_LINE * len(lines)
    chance = fisher.isf(1.0 / one_in, 2 * n, 2 * (m - n + 1))
    sines = []
    for k in np.flatnonzero(ratios > m * n / (m - n + 1) * chance):
        line, direction = int(lines[k]), directions[k].conj()
        nearby = np.abs(direction @ transforms[:, line - around : line + around + 1])
        before, here, after = nearby[around - 1 : around + 2]
        if here < max(before, after) or _is_resonance(nearby**2):
            continue
        # Exact for a sine in a Hann window.
        beside = max(before, after) / here
        refined = line + (2.0 * beside - 1.0) / (1.0 + beside) * (1 if after > before else -1)
        if _coherence(direction @ samples, refined) > COHERENT_SHARE:
            sines.append((float(shares[line]), refined))
    return sines


def _is_resonance(powers: FloatArray) -> bool:
    """Whether a line has flanks, of its powers with those of as many lines to either side.

    A mode with ζ f T of 0.3 has them, and a line that wanders; a sine's end with its window.
    """
    apart = np.abs(np.arange(len(powers)) - len(powers) // 2)
    close, far = (powers[np.isin(apart, lines)].mean() for lines in (FLANK_LINES, FAR_LINES))
    return bool(close > max(FLANKS_OVER_FAR * far, HANN_LEAKAGE * powers.max()))


def _standing_out(transforms: ComplexArray, lines: IntArray) -> tuple[FloatArray, ComplexArray]:
    """zᴴ G⁻¹ z of lines (L,), and G⁻¹ z (L, n)."""
    apart = np.arange(-LINES_AROUND, LINES_AROUND + 1)
    nearby = apart[np.abs(apart) > HANN_SPREAD]
    around = transforms[:, lines[:, None] + nearby].swapaxes(0, 1)
    matrices = around @ around.conj().swapaxes(1, 2) / len(nearby)
    # Sensors may be copies: their difference is then no motion.
    matrices += 1e-6 * np.eye(len(transforms)) * np.einsum("kii->ki", matrices)[:, :, None]
    here = transforms[:, lines].T
    directions = np.linalg.solve(matrices, here[:, :, None])[:, :, 0]
    return (here.conj() * directions).sum(1).real, directions


def _coherence(history: ComplexArray, line: float) -> float:
    """Coherent power of the parts of a history at a frequency in lines, over their whole power."""
    n = PARTS_OF_A_SINE
    n_part = len(history) // n
    steady = np.exp(-2j * np.pi * line / len(history) * np.arange(n * n_part))
    parts = (history[: len(steady)] * steady).reshape(n, n_part) @ np.hanning(n_part)
    return float(np.abs(parts.sum()) ** 2 / (n * (np.abs(parts) ** 2).sum()))


def without_lines(
    samples: FloatArray,
    rate_hz: float,
    frequencies_hz: FloatArray,
    measured: BoolArray | None = None,
) -> FloatArray:
    """Samples without the sines of some frequencies, by joint least squares of all of them.

    Instants that are not ``measured`` (N,), where it is given, do not count.

    Sine and cosine of a frequency may each grow linearly over the record: so little do amplitude
    and phase of a machine drift where all is in one line, and what a frequency misses is removed,
    too. Where a sine is taken out, up to two lines (2 rate / N) of the rest go with it: frequencies
    must be as far apart, or more.
    """
    if not len(frequencies_hz):
        return samples
    n_samples = samples.shape[1]
    left = samples - samples.mean(1, keepdims=True)
    starts = range(0, n_samples, SAMPLES_AT_A_TIME)
    blocks = [slice(start, min(start + SAMPLES_AT_A_TIME, n_samples)) for start in starts]

    def waves(block: slice) -> FloatArray:
        instants = np.arange(block.start, block.stop)
        turns = np.exp(2j * np.pi / rate_hz * np.outer(frequencies_hz, instants))
        steady = np.concatenate([turns.real, turns.imag])
        return np.concatenate([steady, (2.0 * instants / n_samples - 1.0) * steady])

    counts = np.ones(n_samples) if measured is None else measured
    counted = [(block, waves(block) * counts[block]) for block in blocks]
    products = sum(sines @ sines.T for _, sines in counted)
    projections = sum(sines @ left[:, block].T for block, sines in counted)
    amplitudes = np.linalg.lstsq(products, projections)[0]
    return np.concatenate(
        [samples[:, block] - amplitudes.T @ waves(block) for block in blocks], axis=1
    )


def stationary_part(
    samples: FloatArray, rate_hz: float, band_hz: tuple[float, float]
) -> tuple[FloatArray | None, list[tuple[float, float]], float]:
    """The stationary part of samples (n, N), as the motion of a band shows it.

    Its factors (N,), 0 where samples are left out, None if none are; the spans in s that are; and
    the most power of a window that is not, over the median.
    """
    from scipy.fft import irfft, rfft
    from scipy.ndimage import binary_propagation, find_objects, label

    n = samples.shape[1]
    low, high = band_hz
    frequencies = np.fft.rfftfreq(n, 1.0 / rate_hz)
    passed = (frequencies > low) & (frequencies < high)
    length = _window(n, rate_hz, low)
    n_windows = n // length
    powers = np.zeros(n_windows)
    for row in samples:
        motion = irfft(np.where(passed, rfft(row - row.mean()), 0.0), n)
        power = (motion[: n_windows * length].reshape(n_windows, length) ** 2).mean(1)
        powers += power / max(float(np.median(power)), np.finfo(float).tiny)
    powers /= np.median(powers)
    # And what was set in motion, until it has decayed.
    strong, decaying = powers > STRONG_POWER, powers > DECAYED_POWER
    out = binary_propagation(strong, mask=decaying)
    if not out.any() or out.mean() > MOST_LEFT_OUT:
        return None, [], float(powers.max())
    is_out = np.pad(np.repeat(out, length), (0, n - n_windows * length), "edge")
    spans_s = [
        (span.start / rate_hz, span.stop / rate_hz) for (span,) in find_objects(label(is_out)[0])
    ]
    return mask_around(is_out, rate_hz, low), spans_s, float(powers[~out].max())


def mask_around(is_out: BoolArray, rate_hz: float, low_hz: float) -> FloatArray:
    """Factors (N,) of samples, 0 where they are out, with flanks of one window."""
    from scipy.ndimage import distance_transform_edt

    length = _window(len(is_out), rate_hz, low_hz)
    apart = (distance_transform_edt(~is_out) - 0.5).clip(0.0, length)
    return np.asarray(np.sin(0.5 * np.pi * apart / length) ** 2)


def _window(n: int, rate_hz: float, low_hz: float) -> int:
    """Samples of a window, in which the motion may not be stationary."""
    return max(1, min(round(WINDOW_PERIODS * rate_hz / low_hz), n // FEWEST_WINDOWS))


def moving(samples: FloatArray) -> BoolArray:
    """Which sensors (n,) have samples (n, N) that differ by more than rounding."""
    low, high = samples.min(1), samples.max(1)
    return high - low > 1e-12 * np.maximum(np.abs(low), np.abs(high))


def remarks_on(samples: FloatArray, rate_hz: float, sensors: Sequence[str]) -> list[str]:
    """What looks wrong with samples (n, N), a sentence each; empty for a sound record."""
    filled = filled_samples(samples)
    faults = faults_of(samples, rate_hz, sensors, filled)
    remarks = [f"sensor {name!r}: {why}" for name, why in faults.items()]
    sound = [i for i, name in enumerate(sensors) if name not in faults]
    if faults:  # a long record fills memory
        samples, filled, sensors = samples[sound], filled[sound], [sensors[i] for i in sound]
    for name, row, is_filled in zip(sensors, samples, filled, strict=True):
        if share := _clipped_share(row):
            remarks.append(f"sensor {name!r}: {CLIPPED.format(100.0 * share)}")
        if is_filled.any():
            ends = np.flatnonzero(np.diff(is_filled, prepend=False, append=False)).reshape(-1, 2)
            first, end = ends[np.diff(ends).argmax()] / rate_hz
            more = f", and in {len(ends) - 1} more places" if len(ends) > 1 else ""
            remarks.append(
                f"sensor {name!r}: on a straight line, or the same as before, from {first:.6g} s "
                f"on for {end - first:.3g} s{more}; it is taken for a gap that was filled"
            )
    frequencies = machine_lines(samples, rate_hz)
    if n := len(frequencies):
        lines = f"lines at {n} frequencies, the strongest" if n > 1 else "a line"
        named = ", ".join(f"{frequency:.4g}" for frequency in frequencies[:NAMED_LINES])
        remarks.append(
            f"{lines} at {named} Hz, as of a machine; a mode so narrow would have decayed less "
            "than once over the record"
        )
    return remarks


def faults_of(
    samples: FloatArray,
    rate_hz: float,
    sensors: Sequence[str],
    filled: BoolArray,
    band_hz: tuple[float, float] = (0.0, np.inf),
) -> dict[str, str]:
    """Sensors whose samples (n, N) are not the motion at their places in a band, and why.

    Samples that are ``filled`` (n, N) were not measured.
    """
    faults = {}
    moves = moving(samples)
    clipped = np.array([_clipped_share(row) for row in samples])
    are_all_clipped = bool((clipped > MOST_CLIPPED).all())  # shapes suffer less
    for i, (name, row) in enumerate(zip(sensors, samples, strict=True)):
        if not moves[i]:
            faults[name] = f"dead, all samples are {row[0]:g}"
            continue
        if clipped[i] > MOST_CLIPPED and not are_all_clipped:
            faults[name] = CLIPPED.format(100.0 * clipped[i])
        if (share := float(filled[i].mean())) > MOST_FILLED:
            faults[name] = (
                f"on straight lines, or the same as before, in {share:.0%} of its samples"
            )
        for j in np.flatnonzero(moves[:i]).tolist():
            if (how := _copied(row, samples[j])) is not None:
                both = name, sensors[j]
                faults |= {
                    one: f"the same samples{how} as sensor {other!r}; which one is the copy?"
                    for one, other in (both, both[::-1])
                }
    left = [i for i, name in enumerate(sensors) if name not in faults]
    noise = _incoherent(samples[left], rate_hz, band_hz)
    # Where no two sensors have anything in common, nobody can tell which of them are sound.
    if len(noise) < len(left):
        faults |= {sensors[left[i]]: NOISE_ALONE for i in noise}
    return faults


def _incoherent(samples: FloatArray, rate_hz: float, band_hz: tuple[float, float]) -> list[int]:
    """Rows of samples without a peak in a band that share no motion of it with any other row.

    Modes in one direction move no sensor in the other, and two close ones may move two sensors
    alike in power and by chance in phase.
    """
    from scipy.signal import find_peaks

    n, n_samples = samples.shape
    length = min(2 * n_samples // (WINDOWS + 1), LONGEST_WINDOW)
    if n < 2 or length < WINDOWS:
        return []
    starts = np.linspace(0, n_samples - length, WINDOWS).astype(int)
    windows = samples[:, starts[:, None] + np.arange(length)]
    windows = (windows - windows.mean(2, keepdims=True)) * np.hanning(length)
    hz = np.fft.rfftfreq(length, 1.0 / rate_hz)
    inside = np.flatnonzero((hz >= band_hz[0]) & (hz <= band_hz[1]))
    lines = np.fft.rfft(windows)[:, :, inside[inside > 1]].transpose(2, 0, 1)  # (lines, n, windows)
    if not len(lines):
        return []
    powers = np.maximum((np.abs(lines) ** 2).sum(2), np.finfo(float).tiny)
    lines /= np.sqrt(powers)[:, :, None]
    coherence = np.abs(lines @ lines.conj().swapaxes(1, 2)) ** 2
    coherence[:, range(n), range(n)] = 0.0
    # Of noise it exceeds c with probability (1 - c)^(m - 1), m windows; half of them overlap.
    one_in = RECORDS_PER_COHERENT_NOISE * n * len(lines)
    limit = 1.0 - one_in ** (-1.0 / (0.75 * WINDOWS - 1.0))
    noise = np.flatnonzero(coherence.max((0, 2)) < limit).tolist()
    mean = np.full(SMOOTHED_LINES, 1.0 / SMOOTHED_LINES)
    levels = {i: 10.0 * np.log10(np.convolve(powers[:, i], mean, "valid")) for i in noise}
    return [
        i for i, level in levels.items() if not len(find_peaks(level, prominence=OWN_PEAK_DB)[0])
    ]


def _copied(row: FloatArray, other: FloatArray) -> str | None:
    """How samples are those of another sensor, perhaps with the other sign; None if not."""
    for sign, how in ((1.0, ""), (-1.0, " but for the sign")):
        # A few samples tell nearly all sensors apart.
        if all(np.array_equal(row[:n], sign * other[:n]) for n in (100, None)):
            return how
    return None


def _clipped_share(row: FloatArray) -> float:
    """Share of samples at an extreme value that is no rare one.

    Samples of a coarse sensor are at its extreme less often than at the value next to it.
    """
    n_clipped = 0
    for signed in (row, -row):
        is_at_end = signed == signed.max()
        n_at_end = int(is_at_end.sum())
        if FEWEST_CLIPPED <= n_at_end < len(row):
            below = signed[~is_at_end]
            n_clipped += n_at_end if n_at_end > 2 * int((below == below.max()).sum()) else 0
    return n_clipped / len(row)


def filled_samples(samples: FloatArray) -> BoolArray:
    """Which samples (n, N) are on one value or straight line for long, or repeat earlier ones."""
    filled = np.zeros(samples.shape, dtype=bool)
    for row, is_filled in zip(samples, filled, strict=True):
        bend = np.abs(row[2:] - 2.0 * row[1:-1] + row[:-2])
        rounding = 8.0 * np.finfo(float).eps * float(np.abs(row).max())
        ends = np.concatenate([[-1], np.flatnonzero(bend > rounding), [len(bend)]])
        lengths = np.diff(ends) + 1  # samples on a line
        # A coarse sensor often stays on one value: a gap stands out from its other runs.
        usual = float(np.quantile(lengths, 0.99))
        for k in np.flatnonzero(lengths >= max(STRAIGHT_SAMPLES, LONG_OVER_USUAL * usual)):
            is_filled[ends[k] + 1 : ends[k] + 1 + lengths[k]] = True
        is_filled |= _repeats(row)
    return filled


def _repeats(row: FloatArray) -> BoolArray:
    """Which samples (N,) are in a stretch that has been before, to the last digit."""
    length, n = REPEATED_SAMPLES, len(row) - REPEATED_SAMPLES + 1
    if n < 2:
        return np.zeros(len(row), dtype=bool)
    # A whole number for each stretch, which wraps around: the same where all its samples are.
    bits = np.ascontiguousarray(row, dtype=float).view(np.uint64)
    bits = bits ^ (bits >> np.uint64(31))  # the last ones of rounded numbers are zeros
    signatures = np.zeros(n, dtype=np.uint64)
    factors = np.random.default_rng(0).integers(2**64, size=length, dtype=np.uint64)
    for k, factor in enumerate(factors):
        signatures += bits[k : k + n] * factor
    _, first, places = np.unique(signatures, return_index=True, return_inverse=True)
    # One value or two of a coarse sensor are often the same.
    changes = np.concatenate([[0], np.cumsum(np.diff(row) != 0.0)])
    is_again = (first[places] < np.arange(n)) & (changes[length - 1 :] - changes[:n] > length // 2)
    return np.convolve(is_again, np.ones(length)) > 0.5
