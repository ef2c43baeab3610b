"""Whether a model class explains the data at all, from draws of its posterior.

A ranking says which class is best, not whether it is any good. If a class is right, one draw from
its posterior, together with the data, is distributed as a draw from its prior together with data
simulated from it. Quantities whose distribution does not depend on the parameters then have
exactly that distribution at a posterior draw, whatever the prior and however few the data (Johnson
2004, A Bayesian χ² test for goodness-of-fit, Annals of Statistics 32; Johnson 2007, Bayesian model
assessment using pivotal quantities, Bayesian Analysis 2). At every draw these are

- the frequency errors over their standard deviations: normal;
- the distances of shapes: their probability under the density on the sphere is uniform;
- where errors are joint, the squares of all of them without their correlation: chi-square;
- the numbers of spurious modes and of identified model modes: Poisson, and a sum of yes or no;
- the parameters in standard-normal coordinates: normal. An inferred error size absorbs any misfit,
  which shows by its going where its prior did not expect it.

Each gives p-values. Those of one draw are independent and are combined: those of the modes with
those of the error sizes, those of the structures' parameters with those of the numbers of modes,
and these two. Where errors are correlated, each frequency error is taken given those before it, and
the p-values of shapes are combined by their harmonic mean alone, as are those of the draws, which
depend on one another.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.criticism.misfit import (
    INADEQUATE,
    ROUGH,
    Misfit,
    log_chi_square,
    log_combined,
    log_harmonic_mean,
    log_joint,
    log_two_sided,
    misfit,
    standard_deviations,
)
from bayes_ssi.inference.likelihood.likelihood import ComparedModes
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.parameters.parameters import as_product

MOST_NAMED = 3  # the largest misfits say what is wrong; a list of all would hide it


@dataclass(frozen=True)
class PValue:
    """The probability of a larger misfit if the class is right."""

    p_value: float
    sds: float

    @classmethod
    def of(cls, log_p: float) -> "PValue":
        return cls(float(np.exp(log_p)), standard_deviations(log_p))

    @property
    def is_small(self) -> bool:
        """Whether a right class would be this far from the data one time in a hundred."""
        return not self.p_value >= INADEQUATE


@dataclass(frozen=True)
class ModeMisfit:
    """One identified mode and what the class says of it; numbers are medians over the draws."""

    label: str
    paired: float
    # Model frequency over identified frequency, less one; None where it is spurious at every draw.
    frequency_error: float | None
    # Standard deviation that the error should have, of identification and prediction errors in
    # quadrature; None as well.
    frequency_sd: float | None
    mac: float | None  # MAC of model and identified shape; None where no shape is scored
    expected_mac: float | None  # exceeded by 95 % of the shapes of a right model
    misfit: PValue


@dataclass(frozen=True)
class ParameterMisfit:
    """A parameter that is not where its prior expects it."""

    name: str
    value: float
    prior_median: float
    # Distance between them in standard deviations of the prior, in standard-normal coordinates.
    prior_sds: float
    is_error_size: bool
    misfit: PValue


@dataclass(frozen=True)
class CountMisfit:
    """Spurious modes and unidentified model modes of one configuration."""

    configuration: str  # its name; empty where there is only one
    spurious: float
    expected_spurious: float
    unidentified: float
    misfit: PValue


@dataclass(frozen=True)
class Hint:
    """A mistake without which the class would explain the data."""

    mistake: str
    gain: float  # rise of the maximum of likelihood times prior without it, in nats
    misfit: PValue


@dataclass(frozen=True)
class Adequacy:
    overall: PValue
    modes: tuple[ModeMisfit, ...]
    parameters: tuple[ParameterMisfit, ...]
    counts: tuple[CountMisfit, ...]
    # Mistakes without which the class would explain the data, or explain them far better, where
    # they were sought.
    hints: tuple[Hint, ...] = ()
    # Inferred prediction error of frequencies, median draw; None if given or expected large.
    frequency_error: float | None = None

    @property
    def is_adequate(self) -> bool:
        """Whether the data are as the class says, and not much more so without a mistake."""
        return not (self.overall.is_small or self.hints or self.is_rough)

    @property
    def is_rough(self) -> bool:
        """Whether the class infers an error of its frequencies with which any model would fit."""
        return self.frequency_error is not None and self.frequency_error > ROUGH


def adequacy(
    model_class: ModelClass,
    values: FloatArray,
    modes: Sequence[ComparedModes],
    rng: np.random.Generator,
) -> Adequacy:
    """The adequacy of a class, from draws (B, n_parameters) of its posterior.

    ``rng`` draws pairings where they are inferred.
    """
    parts = [
        misfit(likelihood, own, seen, rng)
        for (_, likelihood, own), seen in zip(model_class.parts(values), modes, strict=True)
    ]
    of_frequencies = np.concatenate([part.frequency_log_p for part in parts], axis=1)
    of_shapes = np.concatenate([part.shape_log_p for part in parts], axis=1)
    # Of each mode's frequency and shape together; zero where it is spurious.
    of_both = np.stack([of_frequencies, of_shapes], axis=2).reshape(-1, 2)
    of_modes = log_joint(of_both, ~np.isnan(of_both)).reshape(of_frequencies.shape)
    of_counts = np.stack([[part.spurious_log_p, part.detected_log_p] for part in parts])
    z = model_class.coordinates(values)
    # The parameters that are sizes of errors, rather than their correlations.
    sizes = as_product(model_class.error.frequency_cov), as_product(model_class.error.shape_sd)
    of_sizes = {p.name for size in sizes for p in size.parameters}
    of_sizes -= {parameter.name for parameter in model_class.structural_parameters}
    is_size = np.array([name in of_sizes for name in model_class.parameter_names])
    # An error size that is smaller than expected is no misfit.
    of_parameters = np.where(is_size, log_ndtr(-z), log_two_sided(z))
    errors = list(_of_errors(model_class, values, modes, of_modes, of_shapes))
    model = [log_combined(of_counts.reshape(-1, len(values)).T)]
    for part, which in ((errors, is_size), (model, ~is_size)):
        if which.any():
            part.append(log_combined(of_parameters[:, which]))
    of_parts = [log_combined(np.stack(part, axis=1)) for part in (errors, model)]
    at_draws = log_combined(np.stack(of_parts, axis=1))
    return Adequacy(
        overall=PValue.of(float(log_harmonic_mean(at_draws, axis=0))),
        modes=tuple(_mode_rows(model_class, parts, of_modes)),
        parameters=tuple(
            ParameterMisfit(
                name=parameter.name,
                value=float(np.median(values[:, i])),
                prior_median=parameter.prior.quantile(0.5),
                prior_sds=float(np.median(z[:, i])),
                is_error_size=bool(is_size[i]),
                misfit=PValue.of(float(log_harmonic_mean(of_parameters[:, i], axis=0))),
            )
            for i, parameter in enumerate(model_class.parameters)
        ),
        counts=tuple(
            CountMisfit(
                configuration=test.name,
                spurious=float(np.isnan(part.frequency_errors).sum(axis=1).mean()),
                expected_spurious=model_class.identification.expected_spurious_modes,
                unidentified=float(part.unidentified.mean()),
                misfit=PValue.of(float(log_harmonic_mean(log_p.ravel(), axis=0))),
            )
            for test, part, log_p in zip(model_class.configurations, parts, of_counts, strict=True)
        ),
        frequency_error=_inferred_error(model_class, values),
    )


def _inferred_error(model_class: ModelClass, values: FloatArray) -> float | None:
    size = as_product(model_class.error.frequency_cov)
    if not size.parameters or size.median > ROUGH:
        return None
    columns = [model_class.parameter_names.index(p.name) for p in size.parameters]
    powers = np.array([power for _, power in size.powers])
    return float(np.median(size.scale * np.prod(values[:, columns] ** powers, axis=1)))


def _of_errors(
    model_class: ModelClass,
    values: FloatArray,
    modes: Sequence[ComparedModes],
    of_modes: FloatArray,
    of_shapes: FloatArray,
) -> Iterator[FloatArray]:
    """Log p-values (B,) of all errors.

    Mode by mode, and all together in tests with a joint covariance; or of all frequencies and of
    all shapes, where prediction errors repeat.
    """
    errors = model_class.correlated_errors
    frequencies, joint = errors.independent_residuals(values, modes)
    together = [log_chi_square((x * x).sum(axis=1), x.shape[1]) for x in joint.values()]
    in_joint = [position for i in joint for position in errors.groups[i]]
    if model_class.error.is_correlated:
        frequencies = np.delete(frequencies, in_joint, axis=1)
        if frequencies.shape[1]:
            yield log_combined(log_two_sided(frequencies))
        shapes = np.delete(of_shapes, errors.identified[in_joint], axis=1)
        scored = shapes[:, ~np.isnan(shapes).any(axis=0)]
        if scored.shape[1]:
            yield log_harmonic_mean(scored, axis=1)
        yield from together
    else:
        counts = [len(test.data.modes) for test in model_class.configurations]
        joint_tests = [errors.modes[position].test for position in in_joint]
        rest = ~np.isin(np.repeat(np.arange(len(counts)), counts), joint_tests)
        yield log_combined(np.column_stack([of_modes[:, rest], *together]))


def _mode_rows(
    model_class: ModelClass, parts: Sequence[Misfit], log_p: FloatArray
) -> Iterator[ModeMisfit]:
    columns = iter(log_p.T)
    for configuration, part in zip(model_class.configurations, parts, strict=True):
        for j, label in enumerate(configuration.data.labels):
            yield ModeMisfit(
                label=label_in(configuration.name, label),
                paired=float(np.isfinite(part.frequency_errors[:, j]).mean()),
                frequency_error=_median(part.frequency_errors[:, j]),
                frequency_sd=_median(part.frequency_sds[:, j]),
                mac=_median(part.macs[:, j]),
                expected_mac=_median(part.expected_macs[:, j]),
                misfit=PValue.of(float(log_harmonic_mean(next(columns), axis=0))),
            )


def _median(numbers: FloatArray) -> float | None:
    known = numbers[~np.isnan(numbers)]
    return float(np.median(known)) if len(known) else None


def misfits_in_words(adequacy: Adequacy) -> list[str]:
    """The largest misfits, the worst first; the largest one alone if each is small by itself."""
    named = [
        *((mode.misfit, _mode(mode)) for mode in adequacy.modes),
        *((each.misfit, _parameter(each, adequacy)) for each in adequacy.parameters),
        *((count.misfit, _count(count)) for count in adequacy.counts),
    ]
    named.sort(key=lambda item: -item[0].sds)
    large = [words for misfit, words in named[:MOST_NAMED] if misfit.is_small]
    together = f"misfits that are small one by one, but not together; the largest: {named[0][1]}"
    return large or [together]


def inadequacy_in_words(adequacy: Adequacy, is_given: bool, others: str = "") -> str:
    """What of the data a class that is not adequate does not explain, and why that may be.

    ``is_given`` says whether the pairing is the analyst's.
    """
    what = "the data are not explained"
    mistakes = "; ".join(f"{hint.mistake} (gain {hint.gain:.0f} nats)" for hint in adequacy.hints)
    if adequacy.is_rough and not adequacy.overall.is_small:
        error = _percent(adequacy.frequency_error or 0.0)
        what = (
            f"the model does not fit: it infers an error of {error} for its frequencies, more than "
            f"{_percent(ROUGH)}"
        )
    elif not adequacy.overall.is_small:
        what = "the data are explained far better without a mistake in them"
        return f"{what}. Likely cause: {mistakes}"
    channels = "wrong channel order, " if any(m.mac is not None for m in adequacy.modes) else ""
    pairing = "wrong pairing, " if is_given else ""
    usual = f"{channels}wrong units, {pairing}or a structure nobody wrote down"
    sentences = (f"{what}: {'; '.join(misfits_in_words(adequacy))}", others)
    return ". ".join([*filter(None, sentences), f"Likely cause: {mistakes or usual}"])


def misfit_text(sds: float | None) -> str:
    """A misfit in standard deviations; a dash where it is not known."""
    if sds is None:
        return "-"
    return f"{sds:.1f} sd" if sds < 100.0 else "> 100 sd"


def _mode(mode: ModeMisfit) -> str:
    """What is unusual about a mode, beyond what 95 % of right ones are; else all of it."""
    parts = []
    if mode.frequency_error is not None and mode.frequency_sd is not None:
        off, expected = _percent(mode.frequency_error), _percent(mode.frequency_sd)
        unusual = abs(mode.frequency_error) > 2.0 * mode.frequency_sd
        parts.append((unusual, f"{off} off where {expected} was expected"))
    if mode.mac is not None and mode.expected_mac is not None:
        text = "MAC {} where {} was expected".format(*_different(mode.mac, mode.expected_mac))
        parts.append((mode.mac < mode.expected_mac, text))
    shown = [text for unusual, text in parts if unusual] or [text for _, text in parts]
    return f"mode {mode.label!r}: {', '.join(shown) or 'spurious'}"


def _parameter(parameter: ParameterMisfit, adequacy: Adequacy) -> str:
    side = "above" if parameter.prior_sds > 0 else "below"
    text = (
        f"{parameter.name} is {parameter.value:.2g} where {parameter.prior_median:.2g} was "
        f"expected, {abs(parameter.prior_sds):.1f} standard deviations of its prior {side}"
    )
    # A large error size hides the misfit that made it large.
    paired = [mode for mode in adequacy.modes if mode.frequency_error is not None]
    if parameter.is_error_size and paired:
        farthest = max(paired, key=lambda mode: abs(mode.frequency_error or 0.0))
        text += f" (mode {farthest.label!r} is {_percent(farthest.frequency_error or 0.0)} off"
        scored = [mode for mode in paired if mode.mac is not None]
        least = min(scored, key=lambda mode: mode.mac or 0.0, default=None)
        if least and (least.mac or 0.0) < (least.expected_mac or 0.0):
            text += f", mode {least.label!r} has MAC {least.mac:.2f}"
        text += ")"
    return text


def _count(count: CountMisfit) -> str:
    where = f"configuration {count.configuration!r}: " if count.configuration else ""
    return (
        f"{where}spurious modes {count.spurious:.2g} where {count.expected_spurious:.2g} was "
        f"expected, unidentified model modes in the band {count.unidentified:.2g}"
    )


def _different(*numbers: float) -> list[str]:
    """Numbers to two decimals, or to as many as tell them apart."""
    for decimals in range(2, 9):
        texts = [f"{number:.{decimals}f}" for number in numbers]
        if len(set(texts)) == len(texts):
            break
    return texts


def _percent(fraction: float) -> str:
    return f"{100 * abs(fraction):.2g} %"
