"""Plans of tests, and what they would not see, as tables and in words."""

from collections.abc import Iterator

from rich.table import Table

from bayes_ssi.foundations.displayed import counted
from bayes_ssi.report.tables.layout import MOST_PLACES, add_row, new_table, number
from bayes_ssi.results.plan_answer import gain_text, ties_with_best
from bayes_ssi.results.wording import listed
from bayes_ssi.studies.appendages.hidden_cases import WRONG, BlindSpots
from bayes_ssi.studies.planning.plan_record import CLASS, Plan
from bayes_ssi.studies.ranking.comparison import probability_text


def layout_rows(plan: Plan) -> list[list[str]]:
    """Headings, and the best layouts, others beside them, and those of other configurations."""
    rows = [
        ("best" if i == 0 else "tie" if ties_with_best(plan, layout) else "", layout)
        for i, layout in enumerate(plan.layouts)
    ]
    rows += plan.compared.items()
    rows += [(f"best, {name}", each) for name, each in plan.alternatives.items()]
    naming = plan.aim == CLASS
    texts = [["layout", "sensors", "gain (nats)", *["right class named"] * naming, "largest MAC"]]
    for name, layout in rows:
        shown = ", ".join(layout.sensors[:MOST_PLACES])
        more = len(layout.sensors) - MOST_PLACES
        texts.append([
            name,
            f"{shown} and {more} more" if more > 0 else shown,
            gain_text(layout.gain, layout.error),
            *[number(layout.naming, ".3f")] * naming,
            number(layout.largest_mac, ".2f"),
        ])  # fmt: skip
    return texts


def layout_table(plan: Plan) -> Table:
    headings, *rows = layout_rows(plan)
    title = f"Layouts of {counted(len(plan.best.sensors), 'sensor')}"
    return new_table(title, headings[:2], headings[2:], rows)


def number_table(plan: Plan) -> Table:
    """The best layout of one sensor and more, and what each more adds."""
    title = "Gain against the number of sensors"
    table = new_table(title, ["sensors"], ["number", "gain (nats)", "adds"])
    before = None
    for layout in plan.by_number:
        n = len(layout.sensors)
        names = ", ".join(layout.sensors) if n > 1 else "any: frequencies alone"
        adds = "" if before is None else number(layout.gain - before, "+.3f")
        knee = " (knee)" if n == plan.knee else ""
        add_row(table, f"{names}{knee}", str(n), gain_text(layout.gain, layout.error), adds)
        before = layout.gain
    return table


def plan_notes(plan: Plan) -> Iterator[str]:
    """How the figures were found, and how far off they may be."""
    classes = (f"{name!r} {probability_text(share)}" for name, share in plan.classes.items())
    yield f"Model classes before the test: {', '.join(classes)}."
    yield (
        f"{plan.n_tests} simulated tests; effective draws of a class about each "
        f"{plan.effective_draws:.0f} (median); bias from few draws "
        f"{round(plan.bias, 4) + 0.0:.4f} nats."
    )
    yield (
        "One sensor says no more than frequencies alone: every layout is alike."
        if len(plan.best.sensors) == 1
        else f"All {plan.n_tried} layouts were tried."
        if plan.is_exhaustive
        else f"Greedy search with exchanges, {plan.n_tried} layouts tried. Begun from effective "
        f"independence, it ends at a gain {plan.other_start:+.3f} nats from the best."
    )
    fewer, more = plan.by_number, plan.by_number[1:]
    if any(a.gain > b.gain + 2.0 * b.error for a, b in zip(fewer, more, strict=False)):
        yield (
            "A sensor can take information away: errors of shapes are stated at unit length over "
            "the sensors of a layout, and one on which the classes agree dilutes the others."
        )


def blind_spot_table(spots: BlindSpots) -> Table:
    """Cases of each place: how many are harmless, wrong and said, wrong and not said, and where."""
    headings = ["no stiffness wrong", "wrong, said", "blind spots", "masses", "frequencies (Hz)"]
    table = new_table("Appendages that the model class does not have", ["appendage"], headings)
    for place in dict.fromkeys(case.place for case in spots.cases):
        cases = [case for case in spots.cases if case.place == place]
        blind = [case for case in cases if case.is_blind]
        said = sum(bool(case.warning) for case in cases)
        cells = [str(count) for count in (len(cases) - said - len(blind), said, len(blind))]
        for values in ([case.mass for case in blind], [case.frequency_hz for case in blind]):
            ends = dict.fromkeys(f"{end(values):.3g}" for end in (min, max) if values)
            cells.append(" to ".join(ends) or "-")
        add_row(table, place, *cells)
    return table


def blind_spot_answer(spots: BlindSpots) -> Iterator[str]:
    """How much of the map is blind, what is wrong there, and what removes most of it."""
    blind, n = spots.blind, len(spots.cases)
    off = f"a parameter off by more than {100.0 * WRONG:.0f} %"
    if not blind:
        yield f"None of {n} cases leaves {off} without a failed check or a remark."
        return
    worst = max(blind, key=lambda case: abs(case.error))
    missed = sum(case.missed > 0 for case in blind)
    yield (
        f"{len(blind)} of {n} cases ({100.0 * len(blind) / n:.1f} %) leave {off} without a failed "
        f"check or a remark, {missed} of them where one mode of the two is not in the table. The "
        f"worst: {worst.parameter} {100.0 * worst.error:+.0f} % by {worst.place}, "
        f"{worst.frequency_hz:.3g} Hz, vibrating mass {worst.mass:.3g}."
    )
    removes = listed(f"{name} {each}" for name, each in spots.remedies.items())
    yield f"Removed of {spots.n_tried} blind spots that were tried again: by {removes}."
