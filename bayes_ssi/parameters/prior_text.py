"""Prior distributions as text, in the notation of a study: ``LogNormal(1, 0.5)``."""

from __future__ import annotations

import ast
import math

from bayes_ssi.parameters import families
from bayes_ssi.parameters.prior import Prior

FAMILIES = {
    kind.__name__: kind
    for kind in vars(families).values()
    if isinstance(kind, type) and issubclass(kind, Prior) and kind is not Prior
}


def prior_from_text(text: str) -> Prior:
    """The prior that a text names, its numbers in the order of a study or by their names.

    Nothing in the text is executed.
    """
    problem = ValueError(
        f"prior {text!r}: must be a distribution with its numbers, such as 'LogNormal(1, 0.5)'; "
        f"choose from {', '.join(FAMILIES)}"
    )
    try:
        call = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise problem from None
    if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name)):
        raise problem
    if call.func.id not in FAMILIES or any(each.arg is None for each in call.keywords):
        raise problem
    try:
        numbers = [_number(each) for each in call.args]
        named = {str(each.arg): _number(each.value) for each in call.keywords}
        prior: Prior = FAMILIES[call.func.id](*numbers, **named)
    except TypeError:
        raise problem from None
    return prior


def _number(node: ast.expr) -> float:
    """The number that a part of a text stands for; TypeError if it is none."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        number = _number(node.operand)
        return -number if isinstance(node.op, ast.USub) else number
    if isinstance(node, ast.Name) and node.id == "inf":
        return math.inf
    is_number = isinstance(node, ast.Constant) and type(node.value) in (int, float)
    if not is_number:
        raise TypeError
    return float(node.value)  # type: ignore[attr-defined]
