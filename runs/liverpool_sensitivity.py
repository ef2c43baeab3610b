"""Sensitivity of the ranking of model_classes/liverpool_frame.py to its assumptions.

Ranks the study again with more and fewer spurious modes expected, and with wider and narrower
priors of the blade's frequencies; prints ln B of every class against the best.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import bayes_ssi as bs
from bayes_ssi.studies.ranking.study import load_study

STUDY = Path(__file__).parent.parent / "model_classes" / "liverpool_frame.py"
COARSE = bs.SamplingSettings(log_evidence_error=0.05)


def expecting(spurious_modes: float, candidate: bs.ModelClass) -> bs.ModelClass:
    """The class with another expected number of spurious modes in the band."""
    identification = bs.IdentificationModel(expected_spurious_modes=spurious_modes)
    return replace(candidate, identification=identification)


def tuned_within(cov: float, candidate: bs.ModelClass) -> bs.ModelClass:
    """The class with another coefficient of variation of the blade's frequencies."""
    tuned = (p for p in candidate.parameters if p.name.startswith("blade frequency"))
    return replace(candidate, priors={p.name: replace(p.prior, cov=cov) for p in tuned})


CHANGES = {
    "unchanged": lambda candidate: candidate,
    "0.01 spurious modes": partial(expecting, 0.01),
    "1 spurious mode": partial(expecting, 1.0),
    "tuned within 5 %": partial(tuned_within, 0.05),
    "tuned within 50 %": partial(tuned_within, 0.5),
}


def main() -> None:
    study = load_study(STUDY)
    for name, change in CHANGES.items():
        changed = replace(study, model_classes=[change(each) for each in study.model_classes])
        comparison = bs.rank(changed, settings=COARSE).comparison
        differences = ", ".join(f"{r.name} {r.log_bayes_factor:.2f}" for r in comparison.classes)
        print(
            f"{name:20s} {differences}; {len(comparison.failed_checks)} failed checks", flush=True
        )


if __name__ == "__main__":
    main()
