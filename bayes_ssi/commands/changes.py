"""``bayes-ssi changes``: what changed between two tests of a structure."""

from functools import partial
from pathlib import Path
from typing import Any

import click

from bayes_ssi.commands import options
from bayes_ssi.commands.saved_run import RunOptions, run_options

GROUP = "NAME=PARAMETER,…"


@click.command()
@options.study_argument
@options.repeated_option("--from", "before", "TEST", "Configuration before; may be repeated.")
@options.repeated_option("--to", "after", "TEST", "Configuration after; may be repeated.")
@options.classes_option("Model classes of the study to average over; all if not given.")
@options.repeated_option(
    "--join", "joined", GROUP, "Parameters that lose one share, as one place; may be repeated."
)
@options.repeated_option("--place", "places", GROUP,
    "Parameters of one place, of which each loses a share of its own; may be repeated. Every other "
    "parameter of the structure is a place by itself.")  # fmt: skip
@options.repeated_option(
    "--leave-out", "left_out", "PARAMETER", "Parameter that did not change; may be repeated."
)
@click.option("--loss", type=(float, float), default=(0.0, 1.0), show_default=True,
    metavar="LEAST MOST",
    help="Share of a parameter that a change takes away, uniform; a gain where negative."
)  # fmt: skip
@click.option("--common", type=float, metavar="SD",
    help="Consider that all places lost or gained a share in common, as by temperature, which is "
    "no change; the share's standard deviation, such as 0.03.")  # fmt: skip
@options.path_option("--covariate", metavar="FILE",
    text="CSV file of tests and degrees, say, that the common share is proportional to; --common "
    "is then its standard deviation at the test that differs most from those before.")  # fmt: skip
@options.flag(
    "--losses-only", text="Consider no mass, appendage, or anything else that came or went."
)
@options.flag("--independent", text="Tests share no prediction errors, unless the study says so.")
@options.default_option(
    "--most", 2, "Largest number of changes at once.", click.IntRange(min=1, max=20))  # fmt: skip
@partial(run_options, error=0.05)
def changes(
    study: Path, before: tuple[str, ...], after: tuple[str, ...], names: tuple[str, ...],
    joined: tuple[str, ...], places: tuple[str, ...], left_out: tuple[str, ...],
    loss: tuple[float, float], common: float | None, covariate: Path | None, losses_only: bool,
    independent: bool, most: int, sampling: RunOptions,
) -> None:  # fmt: skip
    """Compare two tests of the structure of STUDY: did anything change, where, and how much?

    Hypotheses (nothing changed; the stiffness of one place is a share less after than before; a
    mass or an appendage came or went; something else; then two of these) are built on the study's
    model classes. Both tests share the errors of the model. Says the probability of a change, of
    each place, the size with its interval, and the smallest loss that the tests would have shown.
    """
    from bayes_ssi.parameters.priors import Uniform
    from bayes_ssi.studies.changes.change_search import change_findings
    from bayes_ssi.studies.changes.changes_family import ChangeSettings, choose_changes

    loaded = options.load(study, names)
    settings = ChangeSettings(
        loss=Uniform(*loss),
        common_sd=common,
        covariate=None if covariate is None else options.read_covariate(covariate)[1],
        number_weights=(1.0, 1.0, *(0.2**number for number in range(1, most))),
        shared=None if independent else ChangeSettings().shared,
        losses_only=losses_only,
    )
    grouping: dict[str, Any] = {
        "joined": options.named_values("--join", joined, GROUP, r"([^=]+)=(.+)", _names),
        "places": options.named_values("--place", places, GROUP, r"([^=]+)=(.+)", _names),
        "left_out": left_out,
    }
    family = choose_changes(loaded, before, after, settings, **grouping)
    sampling.search(loaded, study, "changes", family, change_findings)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]
