"""``bayes-ssi sensitivities``: of modes to parameters, and which of these to update."""

from dataclasses import asdict
from pathlib import Path

import click

from bayes_ssi.commands.options import load, only_option, path_option, study_argument
from bayes_ssi.commands.terminal import console, json_option, print_record, say


@click.command()
@study_argument
@only_option("Only these model classes.")
@path_option("--figures", text="Directory for a heat map of each class, a new one.")
@json_option
def sensitivities(study: Path, only: str | None, figures: Path | None) -> None:
    """Print how the modes of STUDY's model classes change with their parameters.

    At the prior medians. A set of parameters to update is proposed: those of which the data say
    more than the prior does, beside one another.
    """
    from bayes_ssi.foundations.text_files import file_names
    from bayes_ssi.inference.calibration.least_squares import NothingToCalibrateError
    from bayes_ssi.inference.calibration.modal_sensitivities import modal_sensitivities
    from bayes_ssi.report.tables.calibration_tables import sensitivities_table
    from bayes_ssi.results.result_files import require_new_files
    from bayes_ssi.results.wording import listed

    if figures is not None:
        require_new_files(figures)
    where, found = console(), []
    candidates = load(study, only).model_classes
    for candidate in candidates:
        try:
            found.append(modal_sensitivities(candidate))
        except NothingToCalibrateError as error:
            if len(candidates) == 1:
                raise
            say(where, f"(!) {error}")
    for each in found:
        where.print(sensitivities_table(each))
        signals = [
            f"{name} ({signal:.2g})" for name, signal in zip(each.order, each.signals, strict=True)
        ]
        say(
            where,
            f"Signal over noise, in prior standard deviations, beside those before: "
            f"{', '.join(signals)}.",
            f"Proposed for updating: {listed(each.proposed) if each.proposed else 'none'}.",
        )
    if figures is not None:
        from bayes_ssi.plots.figure_style import save_figure, style
        from bayes_ssi.plots.mode_plots import plot_modal_sensitivities

        figures.mkdir(parents=True)
        names = file_names([each.name for each in found], "png")
        with style():
            for each in found:
                save_figure(plot_modal_sensitivities(each), figures / names[each.name])
        say(where, f"Wrote {len(found)} figures in {figures}.")
    print_record(
        lambda: {
            "sensitivities": [
                asdict(each)
                | {
                    "of_frequencies": each.of_frequencies.tolist(),
                    "of_shapes": each.of_shapes.tolist(),
                    "proposed": each.proposed,
                }
                for each in found
            ]
        }
    )
