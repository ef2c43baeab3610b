"""Are the statements of a map of hidden appendages confirmed by simulated tests?

    bayes-ssi blind-spots STUDY --out MAP
    python runs/benchmarks/blind_spots.py STUDY MAP [--tests 200] [--first 0]

Of the cases of the map every second one that is drawn is a blind spot, as long as there are any;
of the others, every second is one where a stiffness is wrong. Frequencies have errors of 0.2 %,
shapes of 0.02 of their length. Is the answer a blind spot, or not, as the map says?
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from bayes_ssi.studies.appendages import hidden_cases
from bayes_ssi.studies.appendages.baselines import choose_baselines
from bayes_ssi.studies.ranking.study import load_study

BY_FREQUENCY, BY_SHAPE = 0.002, 0.02


def disturbed(real, rng):
    hz = real.frequencies_hz * (1.0 + BY_FREQUENCY * rng.standard_normal(len(real.frequencies_hz)))
    lengths = np.linalg.norm([*real.moved.values()], axis=0)
    moved = {
        name: motion + BY_SHAPE * lengths * rng.standard_normal(len(motion))
        for name, motion in real.moved.items()
    }
    return hidden_cases._Real(hz, moved)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("study", type=Path)
    arguments.add_argument("map", type=Path)
    arguments.add_argument("--tests", type=int, default=200)
    arguments.add_argument("--first", type=int, default=0)
    given = arguments.parse_args()
    record = json.loads((given.map / "blind_spots.json").read_text("utf-8"))
    stated = [hidden_cases.HiddenCase(**case) for case in record["cases"]]
    baselines = choose_baselines(load_study(given.study))
    (best,) = baselines.classes
    test = hidden_cases._Test(best.data.sensors, best.data.band_hz)
    own = np.array(record["frequencies_hz"])
    n_frequencies = len({case.frequency_hz for case in stated})
    cases = list(hidden_cases._cases(baselines, test, (), own, n_frequencies))
    kinds = [
        [i for i, case in enumerate(stated) if case.is_blind],
        [i for i, case in enumerate(stated) if case.warning],
        [i for i, case in enumerate(stated) if not case.is_blind and not case.warning],
    ]
    names = ("blind", "wrong, said", "not wrong")
    counts = {name: [0, 0] for name in names}
    for seed in range(given.first, given.first + given.tests):
        rng = np.random.default_rng([51, seed])
        kind = (0, 1, 0, 2)[seed % 4]
        case, real = cases[rng.choice(kinds[kind])]
        judged = hidden_cases._judged(best, test, (case, disturbed(real, rng)))
        agrees = judged.is_blind == (kind == 0)
        counts[names[kind]][0] += agrees
        counts[names[kind]][1] += 1
        print(seed, names[kind], agrees, judged, file=sys.stderr, flush=True)
    for name, (agreed, n) in counts.items():
        print(f"stated {name}: {agreed} of {n} confirmed")


if __name__ == "__main__":
    main()
