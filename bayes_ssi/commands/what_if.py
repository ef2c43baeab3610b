"""``bayes-ssi what-if``: a stored result under changed settings, from its draws."""

from pathlib import Path

import click

from bayes_ssi.commands import options, terminal


@click.command(name="what-if")
@options.result_argument
@options.repeated_option("--prior", "priors", "NAME=PRIOR",
    'New prior of a parameter, such as "k1=LogNormal(1, 0.5)"; may be repeated.')  # fmt: skip
@options.number_option("--frequency-cov", "COV", "Prediction error of frequencies, a fraction.")
@options.number_option("--shape-sd", "SD", "Prediction error of shapes.")
@options.number_option(
    "--detection", "PROBABILITY", "Probability that a mode in the band is identified.")  # fmt: skip
@options.number_option("--spurious", "NUMBER", "Expected number of spurious modes in the band.")
@options.repeated_option(
    "--weight", "weights", "NAME=WEIGHT", "Prior weight of a model class; may be repeated."
)
@terminal.json_option
def what_if(
    result: Path, priors: tuple[str, ...], weights: tuple[str, ...],
    frequency_cov: float | None, shape_sd: float | None, detection: float | None,
    spurious: float | None,
) -> None:  # fmt: skip
    """Show how RESULT, a directory that rank or search saved, changes with its settings.

    The stored draws are reweighted in seconds: nothing is sampled, and the study file is not
    needed. Where they do not cover the change, the exit code is 3 and the output says how to sample
    again. It is also 3 where the most probable class does not explain the data after the change,
    and where a failed check of the data was not accepted when RESULT was saved.
    """
    from bayes_ssi.parameters.priors import prior_from_text
    from bayes_ssi.report.tables import ranking_tables
    from bayes_ssi.results.stored_result import load_result
    from bayes_ssi.results.stored_what_if import what_if as ask
    from bayes_ssi.results.wording import data_warnings
    from bayes_ssi.studies.ranking.changed_settings import ChangedSettings
    from bayes_ssi.studies.ranking.comparison import probability_text

    stored = load_result(result)
    record = stored.record
    settings = ChangedSettings(
        # The name may itself hold "=", but is not followed by the name of a distribution there.
        priors=options.named_values(
            "--prior",
            priors,
            "NAME=DISTRIBUTION(...), such as k1=LogNormal(1, 0.5)",
            r"(.+?)=\s*(\w+\s*\(.*)",
            prior_from_text,
        ),
        frequency_cov=frequency_cov,
        shape_sd=shape_sd,
        detection_probability=detection,
        expected_spurious_modes=spurious,
        prior_weights=options.named_values(
            "--weight", weights, "NAME=WEIGHT", r"(.+)=([^=]*)", _number
        ),
    )
    answer = ask(stored, settings)
    terminal.say(f"{record.study}: draws of {result} reweighted; nothing was sampled.")
    accepted = record.failed_checks_accepted
    terminal.say_warnings(data_warnings(answer.failed_data_checks, accepted))
    if answer.misfit:
        terminal.say_in_paragraphs(f"(!) {answer.misfit}.")
    terminal.show(ranking_tables.what_if_table(answer))
    if stored.search is not None and stored.search.n_unsampled:
        terminal.say(
            f"{stored.search.n_unsampled} hypotheses that were not sampled are left out. Before, "
            "their probability together was at most "
            f"{probability_text(stored.search.most_probability_unsampled)}."
        )
    for row in dict.fromkeys((answer.best_before, answer.best_after)):
        if row is not None:
            terminal.show(ranking_tables.changed_parameters_table(row))
    again = "Sample again: make the change in the study, and rank its classes."
    if record.study_file and record.command:
        again = (
            f"Sample again: make the change in {record.study_file}, and run, with another --out: "
            f"{record.command}"
        )
    terminal.say(*ranking_tables.what_if_notes(answer, again))
    of_data = () if accepted else answer.failed_data_checks
    failed = [text for text in (*of_data, answer.misfit, *answer.problems) if text]
    terminal.conclude({"directory": str(result), "answer": answer}, failed)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{text!r} is not a number") from None
