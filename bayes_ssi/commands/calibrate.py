"""``bayes-ssi calibrate``: the minima of the deterministic objective.

``bayes-ssi sensitivities``: of modes to parameters, and which of these to update.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from bayes_ssi.commands import options, terminal
from bayes_ssi.foundations.displayed import columns

if TYPE_CHECKING:
    from bayes_ssi.inference.calibration.calibration import Calibration
    from bayes_ssi.inference.model_class.model_class import ModelClass

T = TypeVar("T")


@click.command()
@options.study_argument
@options.classes_option("Calibrate only these model classes.")
@click.option("--shape-weight", type=float,
              help="λ, weight of shapes relative to frequencies; 0 leaves shapes out.  "
              "[default: σ_f/σ_φ of the class's error model]")  # fmt: skip
@options.default_option("--starts", 64, "Number of local searches.")
@options.seed_option("Seed of their starting points.")
@options.flag("--with-prior", text="Fit the prior, too (regularised least squares): it determines "
              "what the data leave open.")  # fmt: skip
@terminal.json_option
def calibrate(
    study: Path, names: tuple[str, ...], shape_weight: float | None, starts: int, seed: int,
    with_prior: bool,
) -> None:  # fmt: skip
    """List every distinct minimum of the deterministic objective of the model classes of STUDY.

    The exit code is 3 where the modes are of an identification that failed a check.
    """
    from bayes_ssi.inference.calibration.calibration import calibrate as calibrate_class
    from bayes_ssi.inference.model_class.configuration import failed_data_checks
    from bayes_ssi.results.wording import data_warnings

    candidates = options.load(study, names).model_classes
    tests = [{each.name: each.data for each in one.configurations} for one in candidates]
    failed = list(dict.fromkeys(check for test in tests for check in failed_data_checks(test)))

    def calibrated(candidate: ModelClass) -> Calibration:
        with terminal.progress_bars() as progress:
            report = partial(progress, candidate.name)
            return calibrate_class(candidate, shape_weight, starts, seed, report, with_prior)

    calibrations = list(_of_each(candidates, calibrated))
    for calibration in calibrations:
        _show(calibration)
    if calibrations:
        any_shapes = any(calibration.has_shapes for calibration in calibrations)
        shapes = " and, times λ, of shapes" if any_shapes else ""
        terminal.say(
            f"f_ob: root mean square of the residuals of frequencies{shapes}, which is minimised; "
            "d: root mean square change of the parameters from their prior medians."
        )
        terminal.say_in_paragraphs(*map(_conclusion, calibrations))
    terminal.say_warnings(data_warnings(failed))
    terminal.conclude({"calibrations": calibrations, "failed_checks": failed}, failed)


def _of_each(candidates: Sequence[ModelClass], function: Callable[[ModelClass], T]) -> Iterator[T]:
    """A function of each class; those of several that have nothing to calibrate are named."""
    from bayes_ssi.inference.calibration.least_squares import NothingToCalibrateError

    for candidate in candidates:
        try:
            yield function(candidate)
        except NothingToCalibrateError as error:
            if len(candidates) == 1:
                raise
            terminal.say(f"(!) {error}")


def _show(calibration: Calibration) -> None:
    from bayes_ssi.report.tables import mode_tables

    tables = mode_tables.calibration_table, mode_tables.calibration_modes_table
    errors = mode_tables.standard_errors_table(calibration)
    terminal.show(*(table(calibration) for table in tables), *([errors] if errors else []))
    if calibration.errors_are_correlated and errors:
        terminal.show(
            "(!) The model class has correlated prediction errors, but a calibration takes them "
            "for independent: standard errors differ from those of a ranking."
        )
    if open_ := calibration.undetermined_directions:
        terminal.show(
            f"(!) The data leave {open_} direction(s) of the parameters undetermined: minimum 1 "
            "is, among equally good points, the one closest to the prior median."
        )
    elif not calibration.determines_all and not calibration.with_prior:
        terminal.show(
            "(!) The data do not determine every parameter, and their errors enter the minima "
            "where they do not; --with-prior fits the data and the prior."
        )
    elif not calibration.with_prior and _is_not_unique(calibration):
        terminal.show("(!) The fit is not unique: several minima are equally good.")
    terminal.say("")


def _conclusion(calibration: Calibration) -> str:
    """What the best minimum is, and that a fit alone is no proof."""
    best, n_others = calibration.best, len(calibration.minima) - 1
    worse = "are less probable" if calibration.with_prior else "fit less well"
    others = f" {n_others} further minima {worse}." if n_others else ""
    if n_others and not calibration.with_prior and _is_not_unique(calibration):
        others = f" {n_others} further minima were reached, of which some fit as well."
    return (
        f"{calibration.name!r}: the best fit has f_ob = {100.0 * best.objective:.3f} %, "
        f"{100.0 * calibration.before.objective:.3f} % before, with parameters "
        f"{100.0 * best.distance:.1f} % from the prior medians.{others} How well a class fits does "
        "not say whether it is right; rank does."
    )


def _is_not_unique(calibration: Calibration) -> bool:
    """Whether the second minimum fits as well as the first, for any practical purpose."""
    objectives = [fit.objective for fit in calibration.minima]
    return len(objectives) > 1 and objectives[1] <= 1.01 * objectives[0] + 1e-6


@click.command()
@options.study_argument
@options.classes_option("Only these model classes.")
@terminal.json_option
def sensitivities(study: Path, names: tuple[str, ...]) -> None:
    """Print how the modes of STUDY's model classes change with their parameters.

    At the prior medians. A set of parameters to update is proposed: those of which the data say
    more than the prior does, beside one another.
    """
    from bayes_ssi.inference.calibration.calibration import modal_sensitivities
    from bayes_ssi.report.tables.mode_tables import sensitivities_table
    from bayes_ssi.results.wording import listed

    of_classes = list(_of_each(options.load(study, names).model_classes, modal_sensitivities))
    for each in of_classes:
        terminal.show(sensitivities_table(each))
        signals = [
            f"{name} ({signal:.2g})" for name, signal in zip(each.order, each.signals, strict=True)
        ]
        terminal.say(
            f"Signal over noise, in prior standard deviations, beside those before: "
            f"{', '.join(signals)}.",
            f"Proposed for updating: {listed(each.proposed) if each.proposed else 'none'}.",
        )
    records = [columns(each) | {"proposed": each.proposed} for each in of_classes]
    terminal.conclude({"sensitivities": records})
