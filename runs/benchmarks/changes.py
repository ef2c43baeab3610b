"""What changed between two tests of the IASC-ASCE benchmark structure: how often is it right?

    python runs/benchmarks/changes.py FILE.csv STUDY [--seeds FIRST LAST] [--finer] [--full]
    python runs/benchmarks/changes.py FILE.csv table

Every pair is two simulated tests (``runs/make_asce_benchmark.py``), before and after; with --finer
both are of the model on flexible beams, which the class of 12 degrees of freedom is not. A row of
FILE is written for each pair as it is done, and pairs that it has are not done again. STUDY is a
pattern of the benchmark, "none", "uniform" (3 % of all stiffnesses), "uniform-common" (the same,
where a factor in common is considered), "mixed" (half of the pairs undamaged, the others without
one to eight of the 32 braces' thirds, anywhere), or a storey with its loss, such as "storey 2:0.2",
of all its stiffness.

Evidences are those of the quick screening, which takes three seconds a pair; with --full those of
all efforts below sampling. ``table`` prints what FILE has: how often the true storeys are the most
probable set, or not distinguishable from it; how often a change was stated above 0.9; whether 90 %
intervals hold the true losses; and the reliability of stated probabilities.
"""

import argparse
import csv
import json
import sys
from dataclasses import replace
from pathlib import Path
from time import process_time
from types import SimpleNamespace

import numpy as np

import bayes_ssi as bs
from bayes_ssi.studies.changes.change_search import change_record
from bayes_ssi.studies.changes.changes_family import choose_changes
from bayes_ssi.studies.ranking.study import load_study
from bayes_ssi.studies.search.efforts import EFFORTS, Effort
from bayes_ssi.studies.search.family_search import FamilySearch, screened_hypotheses

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "runs"))
import make_asce_benchmark as asce  # noqa: E402

PLACES = {f"storey {i}": tuple(f"{way}{i}" for way in "xyt") for i in range(1, 5)}
HEADER = ("study", "seed", "finer", "full", "true", "losses", "change", "best", "odds_of_true",
          "intervals", "odds_of_places", "seconds")  # fmt: skip


def frame():
    (model_class,) = load_study(ROOT / "model_classes" / "asce_benchmark.py").model_classes
    return model_class.configurations[0].structure


def left_of(study, rng):
    """What is left of the braces (4, 4), and of all stiffness of the storeys (4,)."""
    braces, storeys = np.ones((4, 4)), np.ones(4)
    if study in asce.PATTERNS:
        braces = asce.braces_left(study)
    elif study.startswith("uniform"):
        storeys[:] = 0.97
    elif study == "mixed":
        if rng.random() < 0.5:
            for _ in range(rng.integers(1, 9)):
                at = rng.integers(4), rng.integers(4)
                braces[at] = max(0.0, braces[at] - 1.0 / 6.0)
    else:
        name, loss = study.split(":")
        storeys[int(name.split()[1]) - 1] -= float(loss)
    return braces, storeys


def pair(structure, study, seed, finer):
    """The class with two tests, and the true losses: name of a stiffness → its loss."""
    rng = np.random.default_rng([seed, 34])
    braces, storeys = left_of(study, rng)
    tests = {
        "before": asce.simulated(np.ones((4, 4)), rng, finer),
        "after": asce.simulated(braces, rng, finer, whole=storeys),
    }
    model_class = bs.ModelClass(
        "12 degrees of freedom",
        configurations=[
            bs.Configuration(
                name, structure, data, pairing={label: i for i, label in enumerate(data.labels, 1)}
            )
            for name, data in tests.items()
        ],
    )
    losses = asce.true_losses(braces)
    return model_class, {
        name: 1.0 - (1.0 - loss) * storeys[int(name[1]) - 1] for name, loss in losses.items()
    }


def row(structure, study, seed, finer, full):
    begun = process_time()
    model_class, losses = pair(structure, study, seed, finer)
    true = sorted(place for place, names in PLACES.items() if any(losses[n] > 0 for n in names))
    settings = bs.ChangeSettings(common_sd=0.05 if study == "uniform-common" else None)
    tests = bs.Study("benchmark", [model_class])
    family = choose_changes(tests, ["before"], ["after"], settings, places=PLACES)
    efforts = EFFORTS if full else replace(EFFORTS, most_full=0, quick=Effort(250, 3, 2000))
    hypotheses, levels = screened_hypotheses(family, 0, bs.Run(), efforts)
    nothing_sampled = SimpleNamespace(posteriors=(), comparison=SimpleNamespace(classes=()))
    found = FamilySearch(nothing_sampled, tuple(hypotheses.values()), tuple(levels))
    record = change_record(family, found)
    sets = {}
    for each in record.hypotheses:
        places = [change.place for change in each.changes]
        key = " + ".join(sorted(place.name for place in places if not place.is_common))
        sets[key] = sets.get(key, 0.0) + each.probability
    best = max(sets, key=sets.get)
    of_true = sets.get(" + ".join(true), 0.0)
    intervals = {
        loss.removeprefix("loss, "): shares
        for place in true
        if place in [each.place.name for each in record.places]
        for loss, shares in record.place(place).change.losses.items()
    }
    alone = {each.name: each for each in record.hypotheses}
    nothing = alone["nothing changed"].probability or 1e-300
    return dict(
        zip(HEADER, (
            study, seed, int(finer), int(full), " + ".join(true),
            json.dumps({name: loss for name, loss in losses.items() if name in intervals}),
            f"{record.probability_of_change:.6g}", best, f"{of_true / sets[best]:.4g}",
            json.dumps(intervals),
            json.dumps({place: alone[place].probability / nothing for place in PLACES}),
            f"{process_time() - begun:.1f}",
        ), strict=True)
    )  # fmt: skip


def written(path):
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def print_table(rows):
    print("study             finer  pairs  true set first  or not told apart  stated above 0.9  "
          "losses in 90 % intervals")  # fmt: skip
    groups = {}
    for each in rows:
        groups.setdefault((each["study"], each["finer"]), []).append(each)
    for (study, finer), own in groups.items():
        first = sum(each["best"] == each["true"] for each in own)
        alike = sum(float(each["odds_of_true"]) > np.exp(-1.0) for each in own)
        stated = sum(float(each["change"]) > 0.9 for each in own)
        inside, n = covered(own)
        share = f"{inside} of {n}" if n else "-"
        print(f"{study:<18}{finer:>5}{len(own):>7}{first:>16}{alike:>19}{stated:>18}  {share:>24}")
    inside, n = covered(rows)
    print(f"all losses: {inside} of {n} in 90 % intervals, {100 * inside / max(n, 1):.0f} %")
    print("\nreliability: stated probability of a change, pairs, share with a change")
    mixed = [each for each in rows if each["study"] == "mixed"]
    stated = np.array([float(each["change"]) for each in mixed])
    changed = np.array([bool(each["true"]) for each in mixed])
    for low, high in ((0, 0.1), (0.1, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 1.01)):
        there = (low <= stated) & (stated < high)
        if there.any():
            print(f"  {low:.1f} to {min(high, 1.0):.1f}: mean {stated[there].mean():.3f}, "
                  f"{there.sum():4} pairs, {changed[there].mean():.3f}")  # fmt: skip
    for each in sorted({e["study"] for e in rows if ":" in e["study"]}):
        own = [e for e in rows if e["study"] == each]
        seen = sum(json.loads(e["odds_of_places"])[each.split(":")[0]] >= 9.0 for e in own)
        print(f"{each}: shown in {seen} of {len(own)}")


def covered(rows):
    """Number of true losses within their intervals, and of all, where the true set is found."""
    inside = n = 0
    for each in rows:
        losses = json.loads(each["losses"])
        for name, (low, _, high) in json.loads(each["intervals"]).items():
            if losses[name] > 0.0 and float(each["odds_of_true"]) > np.exp(-1.0):
                inside += low <= losses[name] <= high
                n += 1
    return inside, n


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file", type=Path)
    arguments.add_argument("study")
    arguments.add_argument("--seeds", type=int, nargs=2, default=(0, 19))
    arguments.add_argument("--finer", action="store_true")
    arguments.add_argument("--full", action="store_true")
    given = arguments.parse_args()
    rows = written(given.file)
    if given.study == "table":
        print_table(rows)
        return
    done = {(each["study"], int(each["seed"]), int(each["finer"]), int(each["full"]))
            for each in rows}  # fmt: skip
    structure = frame()
    for seed in range(given.seeds[0], given.seeds[1] + 1):
        if (given.study, seed, int(given.finer), int(given.full)) in done:
            continue
        made = row(structure, given.study, seed, given.finer, given.full)
        with given.file.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, HEADER)
            if file.tell() == 0:
                writer.writeheader()
            writer.writerow(made)


if __name__ == "__main__":
    main()
