"""``bayes-ssi hierarchy``: how parameters vary over many tests of one structure."""

from __future__ import annotations

from pathlib import Path

import click

from bayes_ssi.commands import options, terminal
from bayes_ssi.commands.saved_run import RESULTS
from bayes_ssi.foundations.displayed import columns


@click.command()
@click.argument("results", nargs=-1, required=True, type=options.PATH)
@click.option("--class", "class_name", metavar="NAME",
              help="Model class; not needed where the results are of one class.")  # fmt: skip
@options.path_option("--covariate", "covariate_file", metavar="FILE",
             text="CSV file with two columns: test (the name of its result directory), and the "
             "covariate, such as the temperature, named by the heading.")  # fmt: skip
@click.option("--parameters", metavar="NAME,…",
              help="Parameters that are related between tests; the others are independent.  "
              "[default: all of the structure]")  # fmt: skip
@options.default_option("--spread", 0.5, "Scale of the half-normal prior of the standard deviation "
                "from test to test, in standard deviations of the parameter's prior.")  # fmt: skip
@options.default_option("--slope", 0.5, "Standard deviation of the normal prior of the change by "
                "one standard deviation of the covariate, in the same unit.")  # fmt: skip
@click.option("--next", "at", type=float, metavar="VALUE",
    help="Covariate of the next test.  [default: mean of the tests]")  # fmt: skip
@options.seed_option("The result follows from it.")
@options.path_option("--out", text="Directory of the result.  [default: runs/results/hierarchy]")
@options.flag("--overwrite", text="Replace a result that exists.")
@options.flag("--accept-failed-checks", text="Exit with code 0 where checks failed.")
@options.renamed("--at", "--next")
@terminal.json_option
def hierarchy(
    results: tuple[Path, ...], class_name: str | None, covariate_file: Path | None,
    parameters: str | None, spread: float, slope: float, at: float | None, seed: int,
    out: Path | None, overwrite: bool, accept_failed_checks: bool,
) -> None:  # fmt: skip
    """Rank how parameters vary over tests: RESULTS are directories that rank saved, one a test.

    The parameters of one model class are the same in all tests, vary from test to test, follow a
    covariate, or both. Nothing is sampled again: the posteriors are those stored.
    """
    from bayes_ssi import api
    from bayes_ssi.plots.class_plots import plot_population
    from bayes_ssi.plots.figure_style import figures_for_files, save_figure
    from bayes_ssi.report.tables import prediction_tables as tables
    from bayes_ssi.results.hierarchy.hierarchy_record import MARKER
    from bayes_ssi.results.result_files import require_new

    directory = out or RESULTS / "hierarchy"
    require_new(directory, marker=MARKER, overwrite=overwrite)
    name, covariate = "", None
    if covariate_file is not None:
        name, covariate = options.read_covariate(covariate_file)
    elif at is not None:
        raise ValueError("--next: there is no covariate; give one with --covariate FILE")
    tests = options.named_paths(results)
    with terminal.progress_bars() as progress:
        ranked = api.hierarchy(
            tests,
            covariate,
            covariate_name=name,
            class_name=class_name,
            parameters=None if parameters is None else [p.strip() for p in parameters.split(",")],
            priors=api.PopulationPriors(api.HalfNormal(spread), api.Normal(0.0, slope)),
            seed=seed,
            run=api.Run(progress=progress),
        )
    command = terminal.command_line()
    api.save_hierarchy(ranked, directory, covariate=at, overwrite=overwrite, command=command)
    with figures_for_files():
        save_figure(plot_population(ranked), directory / "population.png")

    terminal.show(tables.populations_table(ranked), tables.population_table(ranked, at))
    terminal.say(*tables.hierarchy_notes(ranked, at), f"Saved in {directory}.")
    failed = ranked.all_failed_checks
    fields = ("name", "log_evidence", "error", "probability", "against")
    record = {
        "directory": str(directory),
        **columns(ranked, ("model_class", "tests", "covariate", "remarks")),
        "populations": [columns(population, fields) for population in ranked.populations],
        "failed_checks": failed,
    }
    terminal.conclude(record, () if accept_failed_checks else failed)
