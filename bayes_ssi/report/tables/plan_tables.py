"""Plans of tests as tables, and in words."""

from collections.abc import Iterator, Sequence

from rich.table import Table

from bayes_ssi.foundations.displayed import counted
from bayes_ssi.report.tables.layout import TABLES, add_row, new_table, number
from bayes_ssi.results.wording import listed
from bayes_ssi.studies.planning.plan_record import (
    CLASS,
    PARAMETERS,
    Change,
    ConfigurationPlan,
    Layout,
    Plan,
)
from bayes_ssi.studies.ranking.comparison import probability_text


def gain_text(gain: float, error: float) -> str:
    return f"{number(gain, '.3f')} ± {number(error, '.3f')}"


def change_text(change: Change) -> str:
    return f"{change.gain:+.3f} ± {number(change.error, '.3f')}"


def plan_answer(plan: Plan) -> str:
    """The layout to take and what it is worth, in words."""
    best = plan.best
    layout, several = best.best, len(plan.configurations) > 1
    about = {CLASS: f"which of the {len(plan.classes)} model classes holds",
             PARAMETERS: "the parameters"}.get(plan.aim, repr(plan.aim))  # fmt: skip
    sensors = counted(plan.n_sensors, "sensor")
    text = (
        f"{'After the earlier test' if plan.is_after_a_test else 'Before any test'}, the layout of "
        f"{sensors} that says most about {about} is {listed(layout.sensors)}"
        f"{f', in configuration {best.name!r}' if several else ''}: expected information "
        f"{gain_text(layout.gain, layout.error)} nats"
    )
    if best.greatest is None or layout.naming is None:
        return f"{text}."
    return (
        f"{text}, of {best.greatest:.3f} that would settle it. With it the right class comes out "
        f"as the most probable one with probability {share_text(layout.naming, plan)}."
    )


def share_text(share: float, plan: Plan) -> str:
    """A share of the simulated tests, to the digits that so many tests give."""
    least = 3.0 / plan.n_tests  # which none in n tests excludes, at 95 %
    if share > 1.0 - least:
        return f"above {1.0 - least:.3f}"
    return f"{share:.3f}"


def layout_table(plan: Plan) -> Table:
    """The best layouts of each alternative, and others beside them."""
    table = new_table(
        f"Layouts of {counted(plan.n_sensors, 'sensor')}",
        ["layout", "sensors"],
        ["gain (nats)", *(["right class named"] if plan.aim == CLASS else []), "largest MAC"],
    )
    for each in plan.configurations:
        where = f"{each.name}: " if len(plan.configurations) > 1 else ""
        rows = [("best", each.best), *(("", layout) for layout in each.others)]
        for name, layout in (*rows, *each.compared.items()):
            naming = [] if layout.naming is None else [number(layout.naming, ".3f")]
            add_row(
                table,
                f"{where}{name}",
                sensors_text(layout),
                gain_text(layout.gain, layout.error),
                *naming,
                number(layout.largest_mac, ".2f"),
            )
    return table


def sensors_text(layout: Layout) -> str:
    """The sensors of a layout, shortened where there are very many."""
    shown = layout.sensors[: 2 * TABLES.most_places]
    more = len(layout.sensors) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def number_table(plan: ConfigurationPlan) -> Table:
    """The best layout of one sensor and more, and what each more adds."""
    table = new_table(
        "Gain against the number of sensors", ["sensors"], ["number", "gain (nats)", "adds"]
    )
    before = None
    for layout in plan.by_number:
        adds = "" if before is None else f"{layout.gain - before:+.3f}"
        knee = "  knee" if len(layout.sensors) == plan.knee else ""
        names = sensors_text(layout) if len(layout.sensors) > 1 else "any (frequencies alone)"
        numbers = str(len(layout.sensors)), gain_text(layout.gain, layout.error), adds
        add_row(table, f"{names}{knee}", *numbers)
        before = layout.gain
    return table


def change_table(plan: ConfigurationPlan) -> Table:
    """What one sensor less or more, or smaller errors, would change in the best layout."""
    table = new_table("What would change the gain of the best layout", ["change"], ["nats"])
    for change in sorted(plan.left_out, key=lambda each: each.gain):
        add_row(table, f"without {change.what}", change_text(change))
    for change in plan.added[: TABLES.most_places]:
        add_row(table, f"with {change.what}, too", change_text(change))
    add_row(table, plan.smaller_errors.what, change_text(plan.smaller_errors))
    return table


def plan_notes(plan: Plan) -> Iterator[str]:
    """How the figures were found, and how far off they may be."""
    best = plan.best
    yield f"Model classes before the test: {class_text(tuple(plan.classes.items()))}."
    yield (
        f"{plan.n_tests} simulated tests, {plan.n_draws} draws of each class about each; effective "
        f"draws {best.effective_draws:.0f} (median); bias from so few {best.bias:+.4f} nats."
    )
    if best.is_exhaustive:
        yield f"All layouts of {counted(plan.n_sensors, 'sensor')} were tried."
    else:
        yield (
            f"Greedy search with exchanges, {best.n_tried} layouts tried: no exchange of one "
            "sensor is better. Begun from effective independence, it ends "
            f"{number(abs(best.other_start or 0.0), '.3f')} nats "
            f"{'above' if (best.other_start or 0.0) > 0.0 else 'below'}."
        )
    if best.smaller_errors.what.startswith("identification"):
        yield "Identification errors are half as large where a record is four times as long."
    if any(change.gain > 2.0 * change.error for change in best.left_out):
        yield (
            "A sensor can take information away: errors of shapes are stated at unit length over "
            "the sensors of a layout, so that one on which the classes agree dilutes the others."
        )


def class_text(classes: Sequence[tuple[str, float]]) -> str:
    return ", ".join(f"{name!r} {probability_text(share)}" for name, share in classes)
