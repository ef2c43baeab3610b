"""``bayes-ssi calibrate``: the minima of the deterministic objective."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path

import click

from bayes_ssi.commands.study_argument import load, study_argument
from bayes_ssi.commands.terminal import console, json_option, print_record, progress_bars, say


@click.command()
@study_argument
@click.option("--only", metavar="NAME,…", help="Calibrate only these model classes.")
@click.option("--shape-weight", type=float,
              help="λ, weight of shapes relative to frequencies; 0 leaves shapes out.  "
              "[default: σ_f/σ_φ of the class's error model]")  # fmt: skip
@click.option("--starts", type=int, default=64, show_default=True, help="Number of local searches.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True,
              help="Seed of their starting points.")  # fmt: skip
@json_option
def calibrate(
    study: Path, only: str | None, shape_weight: float | None, starts: int, seed: int
) -> None:
    """List every distinct minimum of the deterministic objective of the model classes of STUDY."""
    from bayes_ssi.calibration.calibration import calibrate as calibrate_class
    from bayes_ssi.calibration.least_squares import NothingToCalibrateError
    from bayes_ssi.tables import calibration_modes_table, calibration_table

    where, records = console(), []
    candidates = load(study, only).model_classes
    for candidate in candidates:
        try:
            with progress_bars() as progress:
                report = partial(progress, candidate.name)
                calibration = calibrate_class(candidate, shape_weight, None, starts, seed, report)
        except NothingToCalibrateError as error:
            if len(candidates) == 1:
                raise
            say(where, f"(!) {error}")
            continue
        records.append(asdict(calibration))
        where.print(calibration_table(calibration))
        where.print(calibration_modes_table(calibration))
        if calibration.undetermined_directions:
            where.print(
                f"(!) The data leave {calibration.undetermined_directions} direction(s) of the "
                "parameters undetermined: minimum 1 is, among equally good points, the one "
                "closest to the prior median."
            )
        elif _is_not_unique([fit.objective for fit in calibration.minima]):
            where.print("(!) The fit is not unique: several minima are equally good.")
        where.print()
    print_record(lambda: {"calibrations": records})


def _is_not_unique(objectives: list[float]) -> bool:
    """Whether the second minimum fits as well as the first, for any practical purpose."""
    return len(objectives) > 1 and objectives[1] <= 1.01 * objectives[0] + 1e-6
