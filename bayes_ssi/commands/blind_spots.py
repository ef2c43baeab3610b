"""``bayes-ssi blind-spots``: which hidden appendage would make the answer wrong, without a word."""

from pathlib import Path

import click

from bayes_ssi.commands import options, terminal


@click.command(name="blind-spots")
@options.study_argument
@options.classes_option("The analyst's model class; needed where STUDY has several.")
@options.path_option("--candidates", "candidates_file", metavar="FILE",
    text="CSV file of the places where appendages may hang, as for search.")  # fmt: skip
@options.default_option(
    "--frequencies", 12, "Number of frequencies that are tried.", click.IntRange(min=2)
)
@options.path_option("--out", text="Directory for the map and its figure, a new one.")
@terminal.json_option
def blind_spots(
    study: Path, names: tuple[str, ...], candidates_file: Path | None, frequencies: int,
    out: Path | None,
) -> None:  # fmt: skip
    """Map which appendage, if nobody knew of it, would make the answer of STUDY wrong, unsaid.

    The structure carries one appendage, of every place, mass and frequency in turn; its modes are
    ranked as if there were none. A blind spot is where a stiffness is off by more than 10 % though
    no check fails and no remark is made. Takes minutes: half a second for each case.
    """
    from bayes_ssi.inference.workers.run import Run
    from bayes_ssi.report.tables.plan_tables import blind_spot_answer, blind_spot_table
    from bayes_ssi.results.result_files import require_new_files, write_json
    from bayes_ssi.studies.appendages import hidden_cases
    from bayes_ssi.studies.appendages.candidates import read_candidates

    loaded = options.load(study, names)
    if out is not None:
        require_new_files(out)
    with terminal.progress_bars() as progress:
        spots = hidden_cases.blind_spots(
            loaded,
            candidates=None if candidates_file is None else read_candidates(candidates_file),
            n_frequencies=frequencies,
            run=Run(progress=progress),
        )
    if out is not None:
        from bayes_ssi.plots.figure_style import save_figures
        from bayes_ssi.plots.place_plots import plot_blind_spots

        out.mkdir(parents=True)
        write_json(out / "blind_spots.json", spots)
        save_figures(out, [("blind_spots", plot_blind_spots(spots))])
    terminal.show(blind_spot_table(spots))
    terminal.say_in_paragraphs(*blind_spot_answer(spots))
    if out is not None:
        terminal.say("", f"Wrote {out}: the map and its figure.")
    terminal.conclude({"blind_spots": spots})
