"""How far the ranking of model_classes/liverpool_frame.py hangs on what was assumed.

Ranks the study again with more and fewer spurious modes expected, and with wider and narrower
priors of the blade's frequencies; prints ln B of every class against the best.
"""

from dataclasses import replace
from pathlib import Path

import bayes_ssi as bs
from bayes_ssi.study import load_study

STUDY = Path(__file__).parent.parent / "model_classes" / "liverpool_frame.py"
COARSE = bs.SamplingSettings(log_evidence_error=0.05)


def expecting(candidate, spurious_modes):
    """The class with another number of spurious modes expected in the band."""
    found = bs.IdentificationModel(expected_spurious_modes=spurious_modes)
    return replace(candidate, identification=found)


def tuned_within(candidate, cov):
    """The class with another coefficient of variation of the blade's frequencies."""
    bare, with_blade = candidate.configurations
    elements = []
    for element in with_blade.structure.elements:
        if isinstance(element, bs.Pendulum):
            prior = replace(element.frequency.prior, cov=cov)
            element = replace(element, frequency=replace(element.frequency, prior=prior))
        elements.append(element)
    structure = replace(with_blade.structure, elements=tuple(elements))
    return replace(candidate, configurations=(bare, replace(with_blade, structure=structure)))


def main():
    study = load_study(STUDY)
    variants = {
        "as it is": lambda candidate: candidate,
        "0.01 spurious modes": lambda candidate: expecting(candidate, 0.01),
        "1 spurious mode": lambda candidate: expecting(candidate, 1.0),
        "tuned within 5 %": lambda candidate: tuned_within(candidate, 0.05),
        "tuned within 50 %": lambda candidate: tuned_within(candidate, 0.5),
    }
    for name, change in variants.items():
        changed = replace(study, model_classes=[change(c) for c in study.model_classes])
        comparison = bs.rank(changed, settings=COARSE).comparison
        told = ", ".join(f"{row.name} {row.log_bayes_factor:.2f}" for row in comparison.classes)
        print(f"{name:20s} {told}; {len(comparison.failed_checks)} failed checks", flush=True)


if __name__ == "__main__":
    main()
