"""How often a ranking warns of an appendage that no class models, where there is one and where not.

    python runs/benchmarks/unmodelled_appendages.py [--without 300] [--with 100]

Data of a three-storey building as search_calibration.py draws them: stiffnesses from their priors,
modes from the likelihood (errors of frequencies and shapes, missed and spurious modes), without an
appendage, or with one whose place, mass and frequency are drawn from the search's priors. The class
without appendages, any pairing, is ranked alone, and again with each of the identified modes in
turn left out as the paper's analyst does: modes of the building in ascending order, the rest taken
for spurious. Of the buildings with an appendage those are counted apart where it is near resonance
(within a tenth of a mode's frequency) and heavier than 3 % of the mean floor mass.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import combinations

from search_calibration import Task, building, drawn

import bayes_ssi as bs

SETTINGS = bs.SamplingSettings(log_evidence_error=0.1)
RESONANT, HEAVY = 0.1, 0.03


def analysts_classes(baseline: bs.ModelClass) -> Iterator[bs.ModelClass]:
    """Any pairing, and one class for each mode, or two, that an analyst may take for spurious."""
    yield baseline
    labels, n_modes = baseline.data.labels, len(baseline.structure.masses)
    for kept in combinations(labels, min(n_modes, len(labels))):
        pairing = {label: i + 1 for i, label in enumerate(kept)}
        out = [label for label in labels if label not in kept]
        name = "without " + " and ".join(out) if out else "all modes"
        yield bs.ModelClass(
            name, baseline.structure, baseline.data, baseline.error, pairing=pairing
        )


def warned(index: int, with_appendage: bool) -> tuple[list[str], bool]:
    """Warnings of both rankings, and whether the appendage is near resonance and heavy."""
    made = drawn(Task("building", 0.0, index, with_appendage, "none"), building())
    every, *fixed = analysts_classes(made.baseline)
    warnings = []
    for classes in ([every], fixed):
        try:
            ranking = bs.rank(bs.Study("analyst", classes), index, SETTINGS)
        except ValueError:  # data that no class of given pairing can have
            continue
        warnings.append(ranking.comparison.unmodelled_appendage)
    is_clear = bool(
        with_appendage and made.detuning < RESONANT and float(made.appendage[0]) > HEAVY
    )
    return warnings, is_clear


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--without", type=int, default=300)
    parser.add_argument("--with", dest="with_one", type=int, default=100)
    arguments = parser.parse_args()
    for with_appendage, n in ((False, arguments.without), (True, arguments.with_one)):
        counts = {"any pairing": 0, "given pairings": 0, "clear": 0, "clear, warned": 0}
        for index in range(n):
            warnings, is_clear = warned(index, with_appendage)
            for key, text in zip(("any pairing", "given pairings"), warnings, strict=False):
                counts[key] += bool(text)
                if text and not with_appendage:
                    print(f"  {index}, {key}: {text}", flush=True)
            counts["clear"] += is_clear
            counts["clear, warned"] += is_clear and any(warnings)
        print(f"{'with' if with_appendage else 'without'} an appendage, {n} sets: {counts}")


if __name__ == "__main__":
    main()
