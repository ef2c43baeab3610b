"""``bayes-ssi export``: the updated model in files for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from bayes_ssi.commands import options, terminal
from bayes_ssi.foundations.displayed import columns

PARAMETERS = "parameters.csv"
# Fields of a parameter's summary, the columns after its name and its most probable value.
SUMMARY_COLUMNS = (
    "mean", "sd", "mean_error", "sd_error", "quantile_05", "median", "quantile_95",
    "relative_spread",
)  # fmt: skip


@click.command()
@options.result_argument
@options.study_option
@click.option("--class", "name", metavar="NAME",
              help="Model class, or hypothesis of a search.  "
              "[default: the most probable]")  # fmt: skip
@options.configuration_option
@options.path_option("--out", text="Directory for the files.  [default: RESULT/updated]")
@options.flag("--overwrite", text="Replace existing files.")
def export(
    result: Path, study: Path | None, name: str | None, configuration: str | None, out: Path | None,
    overwrite: bool,
) -> None:  # fmt: skip
    """Write the updated model of RESULT for the program that it came from.

    parameters.csv has the parameters, by the names of the program's groups: at the most probable
    values, and means, standard deviations and quantiles. modes.csv and modes.uff (data sets 15, 82
    and 55) have the modes at all nodes, at the most probable values; a structure without nodes,
    such as a shear building, has no such files.
    """
    import numpy as np

    from bayes_ssi.results.predictions import nodal_modes
    from bayes_ssi.results.predictions.predictions import load_predictions
    from bayes_ssi.results.result_files import new_directory, require_new, write_csv

    directory = out or result / "updated"
    require_new(directory, marker=PARAMETERS, overwrite=overwrite)
    predicted = load_predictions(result, study, configuration=configuration)
    chosen = name or predicted.stored.comparison.best.name
    posterior = predicted.stored.posterior(chosen)
    structure = predicted.model_classes[chosen].configuration(predicted.configuration).structure
    likeliest = dict(zip(posterior.parameter_names, posterior.maxima[0].tolist(), strict=True))
    own = np.array([likeliest[p.name] for p in structure.parameters])
    modes = nodal_modes.nodal_modes(structure, own)
    further = ""
    notes = [
        "(!) No modes at nodes are written: no degree of freedom is labelled 'node direction', "
        f"such as '12 x'; labels are {', '.join(map(repr, structure.degrees_of_freedom[:3]))}, …."
    ]
    with new_directory(directory, marker=PARAMETERS, overwrite=overwrite) as partial:
        summaries = zip(posterior.summary, likeliest.values(), strict=True)
        rows = [[row.name, x, *columns(row, SUMMARY_COLUMNS).values()] for row, x in summaries]
        write_csv(partial / PARAMETERS, [["name", "most_probable", *SUMMARY_COLUMNS], *rows])
        if modes is not None:
            further = f", and {len(modes.frequencies_hz)} modes at {len(modes.nodes)} nodes,"
            nodal_modes.write_modes_csv(partial / "modes.csv", modes)
            try:
                nodal_modes.write_universal_file(partial / "modes.uff", modes, f"{chosen}, updated")
            except ValueError as error:
                notes = [f"(!) modes.uff is not written: {error}."]
            else:
                notes = []
                if [*map(str, nodal_modes.node_numbers(modes))] != [*modes.nodes]:
                    said = "Nodes are not numbered: modes.uff numbers them as in modes.csv, from 1."
                    notes.append(f"(!) {said}")
    terminal.say(
        f"Class {chosen!r}, at its most probable parameters:",
        *(f"  {key} = {value:.4g}" for key, value in likeliest.items()),
        f"Wrote parameters{further} to {directory}.",
        *notes,
    )
