"""``bayes-ssi plan``: the sensors with which the next test says most."""

import inspect
import sys
from pathlib import Path
from typing import Any

import click

from bayes_ssi.commands import options, terminal


@click.command()
@options.study_argument
@options.classes_option("Only these model classes.")
@click.option("--sensors", "n_sensors", type=click.IntRange(min=1), required=True, metavar="N",
              help="Number of sensors.")  # fmt: skip
@options.default_option("--aim", "class",
    "What the test is for: class, which model class holds; parameters, all of the structures; the "
    "name of one; or of a function in STUDY, a prediction for a structure and parameter values."
)  # fmt: skip
@options.path_option("--candidates", "candidates_file", metavar="FILE",
    text="CSV file of the places where sensors may be, with columns name and place, as for search. "
    "All degrees of freedom, or sensors that a structure defines, if not given.")  # fmt: skip
@options.repeated_option("--fixed", "fixed", "NAME", "Candidate that is measured; may be repeated.")
@options.repeated_option(
    "--excluded", "excluded", "NAME", "Candidate that cannot be; may be repeated.")  # fmt: skip
@options.repeated_option("--configuration", "configurations", "NAME",
    "Alternative configuration; may be repeated. All of the study, if not given.")  # fmt: skip
@options.repeated_option("--added-mass", "masses", "PLACE=MASS",
    "Alternative with a mass added at a degree of freedom; may be repeated.")  # fmt: skip
@options.path_option("--after", metavar="RESULT",
    text="Directory that rank saved for STUDY: what would the next test add? Before any test, if "
    "not given.")  # fmt: skip
@options.default_option("--tests", 1000, "Number of simulated tests.", click.IntRange(min=50))
@click.option(
    "--draws", type=click.IntRange(min=50),
    help="Draws of a class about each test; if not given 200, and more where these do not suffice.",
)  # fmt: skip
@options.seed_option("Seed of the simulation.")
@options.path_option("--out",
    text="Directory for the plan and the form for its modes, a new one; RESULT/plan for the "
    "report of RESULT.")  # fmt: skip
@terminal.json_option
def plan(
    study: Path, names: tuple[str, ...], n_sensors: int, aim: str, candidates_file: Path | None,
    masses: tuple[str, ...], after: Path | None, tests: int, draws: int | None, out: Path | None,
    **further: Any,
) -> None:  # fmt: skip
    """Choose the sensors of a test of STUDY's structure for what the test is to answer.

    Tests are simulated from every model class, with errors, missed and spurious modes, and over all
    pairings. A layout is worth the information that is expected of it, in nats: about which model
    class holds, or about parameters. The study's data give the band and the errors alone. The exit
    code is 3 where the computation is too rough.
    """
    from bayes_ssi import api
    from bayes_ssi.inference.workers.packing import STUDY_MODULE
    from bayes_ssi.report.tables import plan_tables
    from bayes_ssi.results.plan_answer import plan_answer
    from bayes_ssi.results.result_files import require_new_files, write_json
    from bayes_ssi.studies.planning.plan_record import SAVED

    loaded = options.load(study, names)
    prediction = vars(sys.modules[f"{STUDY_MODULE}{study.stem}"]).get(aim)
    if out is not None:
        require_new_files(out)
    with terminal.progress_bars() as progress:
        planned = api.plan(
            loaded,
            n_sensors,
            aim=prediction if inspect.isfunction(prediction) else aim,
            candidates=None if candidates_file is None else api.read_candidates(candidates_file),
            added_masses=options.named_values(
                "--added-mass", masses, "PLACE=MASS", r"(.+)=([^=]*)", float
            ),
            after=None if after is None else api.load_result(after),
            n_tests=tests,
            n_draws=draws,
            run=api.Run(progress=progress),
            **further,
        )
    if out is not None:
        from bayes_ssi.plots.figure_style import save_figures
        from bayes_ssi.plots.place_plots import plot_layout

        out.mkdir(parents=True)
        write_json(out / SAVED.name, planned)
        planned.best.write_template(out / "modes.csv")
        save_figures(out, (("layout", plot_layout(planned)),))
    terminal.say_warnings([(f"{check}.", ()) for check in planned.failed_checks])
    terminal.say_in_paragraphs(plan_answer(planned), "")
    terminal.show(plan_tables.layout_table(planned), plan_tables.number_table(planned))
    terminal.say_in_paragraphs("\n".join(plan_tables.plan_notes(planned)))
    if out is not None:
        terminal.say("", f"Wrote {out}: the plan, a figure, and modes.csv, to be filled in.")
    terminal.conclude({"plan": planned}, planned.failed_checks)
