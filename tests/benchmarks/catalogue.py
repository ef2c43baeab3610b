"""All problems with known evidences."""

import problems
import problems_modal
import problems_regions
import problems_scales
import problems_shapes
from known_evidence import Problem


def all_problems() -> list[Problem]:
    modules = (problems, problems_regions, problems_shapes, problems_scales, problems_modal)
    return [problem for module in modules for problem in module.problems()]
