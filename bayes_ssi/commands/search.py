"""``bayes-ssi search``: appendages that hide in the identified modes of a study."""

from pathlib import Path

import click

from bayes_ssi.commands import options
from bayes_ssi.commands.saved_run import RunOptions, run_options


@click.command()
@options.study_argument
@options.classes_option(
    "Model classes to hang appendages on. Every class of the study without an appendage of its "
    "own, averaged over, if not given.", old="--baseline")  # fmt: skip
@options.path_option("--candidates", "candidates_file", metavar="FILE",
    text="CSV file of the places where appendages may hang, with columns name and place. Floors "
    "and storeys where a structure has them, else all sensors, if not given.")  # fmt: skip
@options.repeated_option("--in", "present_in", "TEST",
    "Configuration that has the appendages; may be repeated. All with these places if not given."
)  # fmt: skip
@click.option("--mass", type=(float, float), metavar="LIGHTEST HEAVIEST",
    help="Range of the mass that vibrates, in the structure's unit, log-uniform. From 0.1 to 50 % "
    "of the mean floor mass, or of the median modal mass where there are no floors, if not given."
)  # fmt: skip
@click.option("--frequency", type=(float, float), metavar="LOW HIGH",
    help="Log-uniform prior of an appendage's frequency in Hz; from half the lowest "
    "identified frequency to the band's upper limit if not given.")  # fmt: skip
@options.default_option("--most", 2, "Largest number of appendages at once.",
    # The prior weight of twenty is 0.2^19, 1e-13: more are as good as excluded.
    click.IntRange(min=1, max=20))  # fmt: skip
@run_options
def search(
    study: Path, names: tuple[str, ...], candidates_file: Path | None, present_in: tuple[str, ...],
    mass: tuple[float, float] | None, frequency: tuple[float, float] | None, most: int,
    sampling: RunOptions,
) -> None:  # fmt: skip
    """Search for appendages that hide in the identified modes of STUDY.

    Hypotheses (no appendage; a pendulum on each floor or other candidate; an infill in each storey;
    a motion like a mode, that the model lacks; then two) are built on the study's model classes and
    compared over all pairings of modes. All get approximate evidences; those on which the answer
    rests are sampled. Workers take whole hypotheses.
    """
    from bayes_ssi import api
    from bayes_ssi.studies.appendages.appendage_search import appendage_findings
    from bayes_ssi.studies.appendages.baselines import choose_baselines

    loaded = options.load(study)
    settings = api.SearchSettings(
        mass=mass,
        frequency=None if frequency is None else api.LogUniform(*frequency),
        number_weights=(1.0, 1.0, *(0.2**number for number in range(1, most))),
    )
    candidates = None if candidates_file is None else api.read_candidates(candidates_file)
    baselines = options.listed_names(loaded, names)
    chosen = choose_baselines(loaded, baselines or None, candidates, present_in or None, settings)
    sampling.search(loaded, study, "search", chosen, appendage_findings)
