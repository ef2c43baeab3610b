"""From a vibration record to identified modes whose claimed errors are checked."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bayes_ssi.argument_types import checked
from bayes_ssi.records.bayesian_fft import BandFit, Loads, fit_band
from bayes_ssi.records.identification_result import ModalIdentification, Rejected, measured_record
from bayes_ssi.records.modal_estimates import ModalEstimates, Poles
from bayes_ssi.records.next_era import Correlations, clusters, correlations, next_era, realisation
from bayes_ssi.records.peaks import BEYOND_DOUBT, Peak, split_peaks, with_shapes_exchanged
from bayes_ssi.records.record import Record
from bayes_ssi.records.scoring import DAMPING, HEAVIEST, LOG_DAMPING_SD
from bayes_ssi.records.shocks import shock
from bayes_ssi.records.spectra import Lines, lines_of, spectra

# A block of lines is this share of the damping wide, relative to its frequency: an eighth of a
# resonance's half-power bandwidth. What leaks to the tapers of wider blocks shows where few sources
# drive all sensors.
BLOCK_OVER_DAMPING = 0.25
INTEGRATIONS = {"acceleration": 0, "velocity": 1, "displacement": 2}
# Two methods that see the same record should not differ by more claimed standard deviations.
FARTHEST_APART = 4.0
# ζ f T, the record's length in times in which a mode decays by e^(2π): below this the width of a
# resonance is that of its few lines.
SHORTEST = 1.0
# Of the orders up to the highest, modes have a pole at nearly all from twice their number on.
PERSISTENT, POSSIBLE = 0.65, 0.3
# Where one direction carries nearly all power in most blocks, one process drives the modes.
COHERENT = 0.98


@checked
def identify(
    record: Record, band_hz: Sequence[float], *, at: Sequence[float] = ()
) -> ModalIdentification:
    """Identify the modes of a band, with the joint uncertainty of frequencies and shapes.

    Candidates are the poles that most orders of NExT-ERA agree on. The Bayesian FFT keeps those
    that the evidence asks for, under the loads that explain the spectral matrices: independent
    loads, ground motion in one direction, or both.

    Args:
        record: the record of one setup.
        band_hz: lowest and highest frequency of the search; it should end where the spectrum is
            low, not on a resonance.
        at: frequencies of the modes, in Hz, in place of the candidates; all are then kept.

    Raises:
        ValueError: the record does not cover the band, has fewer lines in it than the modes have
            unknowns, or no mode is found.
    """
    band = record.checked_band(band_hz)
    remarks: list[str] = []
    try:
        data = correlations(record, band)
    except ValueError as error:
        data = None
        remarks.append(str(error))
    if len(at):
        modes, others = _given(record, band, at), None
    else:
        modes, others = _candidates(data)
    lines = lines_of(record, band, BLOCK_OVER_DAMPING * float(np.median(modes.dampings)))
    fit, peaks, rejected = _under_best_loads(lines, modes, others, INTEGRATIONS[record.quantity])
    bayesian = fit.estimates(band, record.sensors)
    era: ModalEstimates | None = None
    failed: list[str] = []
    if data is not None:
        sought = [bayesian.poles]
        # Modes of a spectral model that explains nothing may be none: candidates come next.
        if not fit.is_white and len(modes.frequencies_hz) == bayesian.n_modes:
            sought.append(modes)
        era, failed = _by_era(data, sought, record.sensors)
    quoted, doubts = _quoted(fit, bayesian, era)
    failed += doubts
    if fit.is_white and (strongest := shock(fit, lines)) is not None:
        (failed if strongest.moved.max() > 1.0 else remarks).append(str(strongest))
    lengths = quoted.dampings * quoted.frequencies_hz * record.duration_s
    too_short = tuple(np.flatnonzero(lengths < SHORTEST).tolist())
    remarks += [_short(float(quoted.frequencies_hz[i]), float(lengths[i])) for i in too_short]
    if quoted is era:
        remarks.append(f"{_doubt(fit)}; NExT-ERA is quoted")
    return ModalIdentification(
        measured_record(record), quoted, bayesian, era, fit, peaks, tuple(rejected), too_short,
        tuple(remarks), tuple(failed),
    )  # fmt: skip


def _by_era(
    data: Correlations, sought: Sequence[Poles], sensors: tuple[str, ...]
) -> tuple[ModalEstimates | None, list[str]]:
    """NExT-ERA's estimates of the first modes sought that it has, or why it has none."""
    missing = []
    for poles in sought:
        try:
            return next_era(data, poles, sensors), []
        except ValueError as error:
            missing.append(str(error))
    return None, missing[:1]


def _candidates(data: Correlations | None) -> tuple[Poles, Poles]:
    """Poles of most orders, and of fewer; their dampings are such as the prior has."""
    if data is None:
        raise ValueError("the record is too short to look for modes; give their frequencies as at")
    found, shares = clusters(realisation(data.whole, data))
    if not (shares >= POSSIBLE).any():
        raise ValueError(
            f"no mode is found from {data.band_hz[0]:g} to {data.band_hz[1]:g} Hz; give "
            "frequencies as at, or another band"
        )
    spread = math.exp(LOG_DAMPING_SD)
    found = found._replace(dampings=found.dampings.clip(DAMPING / spread, DAMPING * spread))
    first = shares >= min(PERSISTENT, shares.max())
    others = (shares >= POSSIBLE) & ~first
    return found.at(np.flatnonzero(first).tolist()), found.at(np.flatnonzero(others).tolist())


def _given(record: Record, band: tuple[float, float], at: Sequence[float]) -> Poles:
    """Candidates at given frequencies, with the directions of most motion there as shapes."""
    low, high = band
    frequencies = np.sort(np.array(at, dtype=float))
    if frequencies[0] <= low or frequencies[-1] >= high:
        raise ValueError(f"at: frequencies must be within {low:g} to {high:g} Hz, got {list(at)}")
    data = spectra(lines_of(record, band, BLOCK_OVER_DAMPING * DAMPING))
    nearest = np.abs(data.frequencies_hz[:, None] - frequencies).argmin(0)
    shapes = np.empty((len(record.sensors), len(frequencies)))
    for i, k in enumerate(nearest):
        # Frequencies given closer than a bandwidth share a peak, and take one direction each.
        sharing = int((np.abs(np.log(frequencies[:i] / frequencies[i])) < 2.0 * DAMPING).sum())
        directions = np.linalg.eigh(data.matrices[k].real)[1]
        shapes[:, i] = directions[:, -1 - min(sharing, directions.shape[1] - 1)]
    return Poles(frequencies, np.full(len(frequencies), DAMPING), shapes)


def _under_best_loads(
    lines: Lines, modes: Poles, others: Poles | None, q: int
) -> tuple[BandFit, tuple[Peak, ...], list[Rejected]]:
    """The fit, its peaks, and the candidates that it does without.

    It is that under the first loads that explain the lines, or else under those of most evidence.
    Modes are fixed where there are no others to choose from. Peaks are asked for second modes under
    these loads alone: under loads that explain less, a second mode would stand for the loads.
    """
    order = [Loads(), Loads(True, 1), Loads(True)]
    values = np.linalg.eigvalsh(spectra(lines).matrices)
    if np.median(values[:, -1] / values.sum(1)) > COHERENT:
        order = [Loads(True, 1), Loads(True), Loads()]
    order += [loads._replace(coloured=True) for loads in order[:2]]
    tried = []
    for loads in order:
        fit = fit_band(lines, modes, q, loads)
        rejected: list[Rejected] = []
        if others is not None:
            fit, rejected = _without_needless(fit, lines)
            fit, more = _with_needed(fit, lines, others)
            rejected = sorted(rejected + more)
        fit = with_shapes_exchanged(fit, lines)
        tried.append((fit, rejected))
        if fit.is_white:
            break
    else:
        fit, rejected = max(tried, key=lambda each: each[0].log_evidence)
    fit, peaks = split_peaks(fit, lines, fixed=others is None)
    return fit, peaks, rejected


def _without_needless(fit: BandFit, lines: Lines) -> tuple[BandFit, list[Rejected]]:
    """The fit without modes whose absence is more probable, the weakest first.

    What has left the band, or has more damping than structures have, is no mode of it.
    """
    rejected: list[Rejected] = []
    while fit.model.n_modes > 1:
        nats = np.where(fit.are_modes, fit.nats_of_forces(), -np.inf)
        weakest = int(np.argmin(nats))
        if nats[weakest] > BEYOND_DOUBT:
            break
        others = [i for i in range(fit.model.n_modes) if i != weakest]
        without = fit_band(lines, fit.poles.at(others), fit.q, fit.loads)
        if without.log_evidence < fit.log_evidence and nats[weakest] >= 0.0:
            break
        frequency = float(fit.poles.frequencies_hz[weakest])
        rejected.append(_rejected(frequency, without.log_evidence - fit.log_evidence))
        fit = without
    return fit, rejected


def _with_needed(fit: BandFit, lines: Lines, others: Poles) -> tuple[BandFit, list[Rejected]]:
    """The fit with those of other candidates that the evidence asks for, the strongest first."""
    rejected: list[Rejected] = []
    left = list(range(len(others.frequencies_hz)))
    while left:
        gains = [fit.gain_of(others.at([i])) for i in left]
        best = left[int(np.argmax(gains))]
        # Noise gains about half a nat for each unknown, and a mode must gain more.
        if max(gains) < fit.n_unknowns_of_a_mode:
            break
        left.remove(best)
        wider = fit_band(lines, fit.poles.joined(others.at([best])), fit.q, fit.loads)
        frequency = float(others.frequencies_hz[best])
        if not wider.are_modes.all():
            rejected.append(Rejected(frequency, "the spectra are explained by no mode in the band"))
        elif wider.log_evidence > fit.log_evidence:
            fit = wider
        else:
            rejected.append(_rejected(frequency, fit.log_evidence - wider.log_evidence))
    return fit, rejected + [
        Rejected(float(others.frequencies_hz[i]), "the spectra gain nothing by a mode there")
        for i in left
    ]


def _rejected(frequency_hz: float, against: float) -> Rejected:
    probability = 1.0 / (1.0 + math.exp(min(against, 700.0)))
    return Rejected(frequency_hz, f"a mode there has the probability {probability:.2g}")


def _short(frequency_hz: float, length: float) -> str:
    return (
        f"mode at {frequency_hz:.4g} Hz: no wider than a line of the record (ζ f T = "
        f"{length:.2g}); "
        "nothing is claimed of its damping and shape, for which the record is too short, or it is "
        "a machine's harmonic"
    )


def _quoted(
    fit: BandFit, bayesian: ModalEstimates, era: ModalEstimates | None
) -> tuple[ModalEstimates, list[str]]:
    """What is quoted, and failed checks."""
    if era is None:
        return bayesian, [] if fit.is_white else [_doubt(fit)]
    frequencies, shapes = bayesian.distances(era)
    apart = [
        f"mode at {f:.4g} Hz: Bayesian FFT and NExT-ERA differ by {max(by_f, by_shape):.1f} "
        f"claimed standard deviations in {'frequency' if by_f >= by_shape else 'shape'}"
        for f, by_f, by_shape in zip(bayesian.frequencies_hz, frequencies, shapes, strict=True)
        if max(by_f, by_shape) > FARTHEST_APART
    ]
    return (bayesian if fit.is_white else era), apart


def _doubt(fit: BandFit) -> str:
    """Why the Bayesian FFT's modes are not quoted."""
    if not fit.are_modes.all():
        return (
            "the spectra ask for a resonance beyond the band, or of more damping than the "
            f"{HEAVIEST:.0%} that a structure may have"
        )
    if not fit.is_most_probable:
        return "the Bayesian FFT did not reach its most probable modes"
    return (
        f"the spectral model does not explain the record (chi-square over degrees of freedom "
        f"{fit.whiteness:.2f}, allowed {fit.allowed_whiteness:.2f})"
    )
