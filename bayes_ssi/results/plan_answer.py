"""The plan of a test in words."""

from bayes_ssi.foundations.displayed import counted, in_words
from bayes_ssi.results.wording import listed
from bayes_ssi.studies.planning.plan_record import CLASS, PARAMETERS, Layout, Plan


def gain_text(gain: float, error: float) -> str:
    """A gain and its error, which is never zero: other tests might differ where all agree."""
    return f"{round(gain, 3) + 0.0:.3f} ± {'<0.001' if error < 0.0005 else f'{error:.3f}'}"


def plan_answer(plan: Plan) -> str:
    """The layout to take and what it is worth, in words."""
    about = {CLASS: f"which of the {len(plan.classes)} model classes holds",
             PARAMETERS: "the parameters"}.get(plan.aim, repr(plan.aim))  # fmt: skip
    layout = plan.best
    where = f" in configuration {plan.configuration!r}" if plan.alternatives else ""
    text = (
        f"{'After the earlier test' if plan.is_after_a_test else 'Before any test'}, the layout of "
        f"{counted(len(layout.sensors), 'sensor')} that says most about {about} is "
        f"{listed(layout.sensors)}{where}: expected information "
        f"{gain_text(layout.gain, layout.error)} nats"
    )
    if ties := [each for each in plan.layouts[1:] if ties_with_best(plan, each)]:
        others = "; or ".join(listed(each.sensors) for each in ties)
        text += f" (a tie within its error with {others})"
    fewer = _fewer(plan)
    if plan.greatest is None or layout.naming is None:
        return f"{text}.{fewer}"
    least = 3.0 / plan.n_tests  # which none in n tests excludes, at 95 %
    sure = layout.naming > 1.0 - least
    naming = f"above {1.0 - least:.3f}" if sure else f"{layout.naming:.3f}"
    return (
        f"{text}, of {plan.greatest:.3f} that would settle it. With it the right class comes out "
        f"as the most probable one with probability {naming}.{fewer}"
    )


def ties_with_best(plan: Plan, layout: Layout) -> bool:
    """Whether a layout is worth as much as the best one, within the error of its gain."""
    return plan.best.gain - layout.gain <= layout.error


def _fewer(plan: Plan) -> str:
    """A sentence on the smallest number of sensors that says nearly as much; empty if it is all."""
    fewer = next(each for each in plan.by_number if len(each.sensors) == plan.knee)
    if plan.knee == len(plan.best.sensors):
        return ""
    those = "frequencies alone, as of one sensor" if plan.knee == 1 else listed(fewer.sensors)
    return f" Fewer sensors say nearly as much: {those}, {gain_text(fewer.gain, fewer.error)} nats."


@in_words.register
def _(plan: Plan) -> str:
    """Failed checks, then the layout to take, a paragraph each."""
    return "\n\n".join([*(f"(!) {check}." for check in plan.failed_checks), plan_answer(plan)])
