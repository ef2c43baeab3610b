"""What changed between two tests: how often is it right?

    python runs/benchmarks/changes.py STUDY FILE.csv [--seeds FIRST LAST] [--finer]
    python runs/benchmarks/changes.py table FILE.csv...
    python runs/benchmarks/changes.py visible

STUDY is one of random buildings, or of the IASC-ASCE benchmark structure. Of random buildings it
is stiffness, mass, appendage or unchanged: shear buildings of 3 to 8 storeys, one stiffness a
storey to be inferred, whose masses the model has 2 to 6 % wrong. One storey lost 10 to 40 % of its
stiffness, or one floor gained 5 to 25 % of the mean floor mass, or a pendulum of 2 to 10 % of it
appeared within 8 % of the frequency of one of the lowest three modes. The analyst calls each mode
as that before which it is most like, and leaves the new one unpaired. All changes are considered.
A change is visible where its own hypothesis is nine times as probable as that nothing changed.

Every pair of the benchmark structure is two simulated tests, before and after
(``tests/benchmarks/make_asce_benchmark.py``); with --finer both are of the model on flexible
beams, which the class of 12 degrees of freedom is not. A row of FILE is written for each pair as it
is done, and pairs that it has are not done again. Losses alone are considered. STUDY is

    none, or a pattern of the benchmark
    uniform         3 % of all stiffnesses
    uniform-common  the same, where a factor in common is considered
    prior           faces, the number of changes and their losses drawn from the search's own prior
    e2:0.15         the face east in storey 2 with its loss; only whether it is shown is computed

Places are the faces of storeys, one change or two; where all braces of storeys are gone (patterns 1
and 2) storeys, each of whose faces loses a share of its own. Evidences are those of the quick
screening.

``table`` prints what the files have: how often the true set of storeys is the most probable one, or
not distinguishable from it; how often a change was stated above 0.9; whether 90 % intervals hold
the true losses; and the reliability of stated probabilities. Of the finer model, a loss of a face
is that of its braces and columns; as its columns give way, it is more of what the face resists. So
intervals are also counted against the losses which the same class finds in tests without errors.

``visible`` prints the smallest loss of every face that the first pair of "none" would have shown,
and how often it would have shown the losses of pattern 6.
"""

import argparse
import csv
import json
from functools import cache
from pathlib import Path
from time import process_time
from types import SimpleNamespace
from typing import NamedTuple

import beside_tests  # noqa: F401
import make_asce_benchmark as asce
import numpy as np
from scipy.optimize import linear_sum_assignment

import bayes_ssi as bs
from bayes_ssi.foundations.summaries import weighted_quantiles
from bayes_ssi.studies.changes.change_search import change_record
from bayes_ssi.studies.changes.changes_family import choose_changes
from bayes_ssi.studies.changes.visible_loss import ODDS_SHOWN, smallest_losses
from bayes_ssi.studies.ranking.study import load_study
from bayes_ssi.studies.search.approximate_evidence import Effort, screen
from bayes_ssi.studies.search.family_search import FamilySearch, screened_hypotheses

ROOT = Path(__file__).parents[2]

# Study of random buildings → the kind of change.
KINDS = {"stiffness": "a loss of stiffness", "mass": "a mass", "appendage": "an appendage",
         "unchanged": ""}  # fmt: skip
STOREYS = {f"storey {i}": tuple(f"{face}{i}" for face in "snew") for i in range(1, 5)}
OF_STOREYS = ("pattern 1", "pattern 2")
# One ascent where a change is scanned, another from the prior; importance draws of 20 dimensions.
QUICK = Effort(100, 1, 500)
HEADER = ("study", "seed", "finer", "true", "losses", "change", "best", "odds_of_true",
          "intervals", "odds_of_places", "seconds")  # fmt: skip


@cache
def frame():
    (model_class,) = load_study(ROOT / "model_classes" / "asce_benchmark.py").model_classes
    return model_class.configurations[0].structure


def settings_of(study):
    common_sd = 0.05 if study == "uniform-common" else None
    return bs.ChangeSettings(branches=1, common_sd=common_sd, losses_only=study not in KINDS)


def losses_of(study, rng):
    """What is left of the braces (4, 4) before and after, and the losses of faces, by name."""
    names = [parameter.name for parameter in frame().parameters]
    before, losses = np.ones(16), np.zeros(16)
    if study in asce.PATTERNS:
        own = asce.of_faces(asce.braces_left(study))
        losses = np.array([own[name] for name in names])
    elif study == "prior":
        weights = np.array(settings_of(study).number_weights)
        n = rng.choice(len(weights), p=weights / weights.sum())
        losses[rng.choice(16, n, replace=False)] = rng.uniform(size=n)
        before = np.array([p.prior.from_normal(rng.standard_normal()) for p in frame().parameters])
    elif ":" in study:
        name, loss = study.split(":")
        losses[names.index(name)] = float(loss)

    def braces(faces):
        """What is left of the braces where columns are whole, which may be less than nothing."""
        return 1.0 - (1.0 - faces.reshape(4, 4)) * asce.FACE_STIFFNESSES / (2.0 * asce.BRACE)

    lost = {name: float(loss) for name, loss in zip(names, losses, strict=True) if loss > 0.0}
    return braces(before), braces(before * (1.0 - losses)), lost


def pair(study, seed, finer):
    """The class with two tests, and the true losses; without errors where there is no seed."""
    rng = np.random.default_rng([seed or 0, 34])
    before, after, losses = losses_of(study, rng)
    if seed is None:
        rng = SimpleNamespace(standard_normal=lambda n=(): np.zeros(n))
    whole = np.full(4, 0.97 if study.startswith("uniform") else 1.0)
    tests = {
        "before": asce.simulated(before, rng, finer),
        "after": asce.simulated(after, rng, finer, whole=whole),
    }
    model_class = bs.ModelClass(
        "12 degrees of freedom",
        configurations=[
            bs.Configuration(name, frame(), data, pairing=pairing)
            for name, (data, pairing) in tests.items()
        ],
    )
    return model_class, losses


def family_of(study, model_class):
    tests, places = bs.Study("benchmark", [model_class]), STOREYS if study in OF_STOREYS else {}
    names = [] if study in KINDS else [parameter.name for parameter in frame().parameters]
    left_out = [name for name in names if name != study.split(":")[0]] if ":" in study else []
    settings = settings_of(study)
    return choose_changes(tests, ["before"], ["after"], settings, places=places, left_out=left_out)


def storeys(places):
    """The storeys of places, by their names, which end with the storey's number."""
    return " + ".join(sorted({f"storey {each.name[-1]}" for each in places}))


@cache
def losses_of_truth(study, finer):
    """The losses that the class finds in tests without errors, if it changes where they do."""
    model_class, losses = pair(study, None, finer)
    family = family_of(study, model_class)
    places = [p for p in family.features[model_class.name] if losses.keys() & set(p.parameters)]
    screened = screen((family.hypothesis(family.classes[0], places, "true"), None), 0)
    values = family.hypothesis(family.classes[0], places, "true").values(screened.z)
    return {
        name.removeprefix("loss, "): weighted_quantiles(values[:, i], screened.weights)[1]
        for i, name in enumerate(screened.parameter_names)
        if name.startswith("loss, ")
    }


def screened_record(family):
    hypotheses, levels = screened_hypotheses(family, 0, bs.Run(), QUICK, most_full=0)
    nothing_sampled = SimpleNamespace(posteriors=(), comparison=SimpleNamespace(classes=()))
    search = FamilySearch(nothing_sampled, tuple(hypotheses.values()), tuple(levels))
    return change_record(family, search)


def row(study, seed, finer):
    begun = process_time()
    model_class, losses = pair(study, seed, finer)
    family = family_of(study, model_class)
    features = family.features[model_class.name]
    true = [place for place in features if losses.keys() & set(place.parameters)]
    record = screened_record(family)
    sets = {}
    for each in record.hypotheses:
        key = storeys(change.place for change in each.features if not change.place.is_common)
        sets[key] = sets.get(key, 0.0) + each.probability
    best = max(sets, key=sets.get)
    intervals = {
        loss.removeprefix("loss, "): shares
        for place in true
        for loss, shares in record.place(place.name).amounts.items()
    }
    alone = {each.name: each for each in record.hypotheses}
    nothing = alone["nothing changed"].probability or 1e-300
    # Of a place that is considered alone, as if it were one of all faces.
    share = 1.0 / len(frame().parameters) if ":" in study else 1.0
    odds = {place.name: share * alone[place.name].probability / nothing for place in features}
    return dict(
        zip(HEADER, (
            study, seed, int(finer), storeys(true), json.dumps(losses),
            f"{record.probability_of_any:.6g}", best,
            f"{sets.get(storeys(true), 0.0) / sets[best]:.4g}", json.dumps(intervals),
            json.dumps({name: float(f"{each:.4g}") for name, each in odds.items()}),
            f"{process_time() - begun:.1f}",
        ), strict=True)
    )  # fmt: skip


class RandomPair(NamedTuple):
    model_class: bs.ModelClass
    place: str  # where it changed; empty if nowhere
    amount: float


def random_pair(kind, seed):
    rng = np.random.default_rng([seed, 51])
    n = int(rng.integers(3, 9))
    masses = rng.uniform(0.8, 1.2, n)
    stiffness = (2.0 * np.pi * rng.uniform(1.0, 3.0)) ** 2 * (0.4 * n**2 + 0.5 * n)
    true = rng.lognormal(0.0, 0.15, n)
    names, prior = [f"k{i + 1}" for i in range(n)], bs.LogNormal(1.0, 0.2)
    parameters = [bs.Parameter(name, prior) for name in names]
    wrong = masses * (1.0 + rng.choice([-1.0, 1.0], n) * rng.uniform(0.02, 0.06, n))
    model = bs.ShearBuilding(tuple(wrong), [stiffness * p for p in parameters])
    real = bs.ShearBuilding(tuple(masses), [stiffness * p for p in parameters])
    chosen = [int(i) for i in np.sort(rng.choice(n - 1, min(n, 5) - 1, replace=False))]
    sensors = [f"floor {i + 1}" for i in (*chosen, n - 1)]
    n_modes = min(n, 5)
    floor, amount, after, left = int(rng.integers(1, n + 1)), 0.0, real, true.copy()
    place = ""
    if kind == "stiffness":
        amount, place = rng.uniform(0.1, 0.4), f"k{floor}"
        left[floor - 1] *= 1.0 - amount
    elif kind == "mass":
        amount, place = rng.uniform(0.05, 0.25), f"mass on floor {floor}"
        after = real.with_element(bs.AddedMass(amount * masses.mean(), [(floor, 1.0)]))
    elif kind == "appendage":
        amount, place = rng.uniform(0.02, 0.1), f"appendage on floor {floor}, mode new"
        hz = real.modes(true[None]).frequencies_hz[0, rng.integers(min(n, 3))]
        hz *= rng.uniform(0.92, 1.08)
        after = real.with_element(bs.Pendulum(floor, amount * masses.mean(), float(hz)))

    def shapes_of(structure, values, n_modes):
        hz, shapes = structure.modes(values[None])
        at_sensors = structure.sensor_matrix(sensors).apply(shapes)[0, :, :n_modes]
        return hz[0, :n_modes], at_sensors / np.linalg.norm(at_sensors, axis=0)

    hz, shapes = shapes_of(real, true, n_modes)
    highest = 1.02 * hz[-1]
    labels = [str(i + 1) for i in range(n_modes)]
    new_hz, new_shapes = shapes_of(after, left, n_modes + (kind == "appendage"))
    new_labels = labels
    if kind == "appendage":
        likeness = (shapes.T @ new_shapes) ** 2 - 2.0 * np.abs(np.log(new_hz / hz[:, None]))
        rows, columns = linear_sum_assignment(-likeness)
        by_column = dict(zip(columns.tolist(), rows.tolist(), strict=True))
        new_labels = [labels[by_column[i]] if i in by_column else "new" for i in range(n_modes + 1)]

    def data(hz, shapes, labels):
        identified = [
            bs.IdentifiedMode(
                label, float(f * (1.0 + 0.002 * rng.standard_normal())),
                shape + 0.01 * rng.standard_normal(len(shape)), frequency_cov=0.002, shape_sd=0.01,
            )
            for label, f, shape in zip(labels, hz, shapes.T, strict=True)
        ]  # fmt: skip
        identified.sort(key=lambda mode: mode.frequency_hz)
        return bs.ModalData(tuple(identified), (0.0, float(1.1 * highest)), tuple(sensors))

    pairing = {label: i for i, label in enumerate(labels, 1)}
    tests = {"before": data(hz, shapes, labels), "after": data(new_hz, new_shapes, new_labels)}
    configurations = [bs.Configuration(k, model, v, pairing=pairing) for k, v in tests.items()]
    return RandomPair(bs.ModelClass(kind, configurations=configurations), place, amount)


def row_of_random(kind, seed):
    begun = process_time()
    drawn = random_pair(kind, seed)
    record = screened_record(family_of(kind, drawn.model_class))
    alone = {each.name: each.probability for each in record.hypotheses}
    nothing = alone["nothing changed"] or 1e-300
    amounts = list(record.place(drawn.place).amounts.values()) if drawn.place else []
    first = record.best_with_features.name
    return dict(
        zip(HEADER, (
            kind, seed, 0, KINDS[kind], json.dumps({drawn.place: drawn.amount}),
            f"{record.probability_of_any:.6g}", first,
            f"{alone.get(drawn.place, 0.0) / nothing:.4g}",
            json.dumps(amounts), json.dumps(record.kinds), f"{process_time() - begun:.1f}",
        ), strict=True)
    )  # fmt: skip


def print_random(rows):
    print("\nrandom buildings  pairs  visible  kind first  place first  stated above 0.9  "
          "amounts in 90 % intervals of visible ones")  # fmt: skip
    for study in KINDS:
        own = [each for each in rows if each["study"] == study]
        seen = [
            each
            for each in own
            if float(each["odds_of_true"]) >= ODDS_SHOWN and study != "unchanged"
        ]
        kind = place = inside = 0
        for each in seen:
            kinds, ((name, amount),) = (
                json.loads(each["odds_of_places"]),
                json.loads(each["losses"]).items(),
            )
            kind += max(kinds, key=kinds.get) == KINDS[study]
            place += each["best"] == name
            inside += all(low <= amount <= high for low, _, high in json.loads(each["intervals"]))
        stated = sum(float(each["change"]) > 0.9 for each in own)
        print(
            f"{study:<16}{len(own):>7}{len(seen):>9}{kind:>12}{place:>13}{stated:>18}{inside:>12}"
        )


def written(path):
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def run(study, path, seeds, finer):
    done = {(each["study"], int(each["seed"]), bool(int(each["finer"]))) for each in written(path)}
    for seed in range(seeds[0], seeds[1] + 1):
        if (study, seed, finer) in done:
            continue
        made = row_of_random(study, seed) if study in KINDS else row(study, seed, finer)
        with path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, HEADER)
            if file.tell() == 0:
                writer.writeheader()
            writer.writerow(made)


def print_table(rows):
    if not rows:
        return
    groups = {}
    for each in rows:
        groups.setdefault((each["study"], bool(int(each["finer"]))), []).append(each)
    print("study           model  pairs  true set first  or not told apart  stated above 0.9  "
          "losses in 90 % intervals  those found without errors")  # fmt: skip
    for (study, finer), own in sorted(groups.items()):
        first = sum(each["best"] == each["true"] for each in own)
        alike = sum(float(each["odds_of_true"]) > np.exp(-1.0) for each in own)
        stated = sum(float(each["change"]) > 0.9 for each in own)
        print(
            f"{study:<15}{'finer' if finer else 'own':>6}{len(own):>7}{first:>16}{alike:>19}"
            f"{stated:>18}  {in_words(own):>24}  {in_words(own, finer):>27}"
        )
        if finer and study in asce.PATTERNS and study != "none":
            both = {name: f"{loss:.3f} → {losses_of_truth(study, True)[name]:.3f}"
                    for name, loss in pair(study, 0, True)[1].items()}  # fmt: skip
            print(f"    losses, and those found without errors: {both}")
    for finer in (False, True):
        own = [each for each in rows if bool(int(each["finer"])) == finer]
        print(f"all losses, {'finer' if finer else 'own'}: {in_words(own)}; {in_words(own, finer)}")
    print("\nreliability: stated probability of a change, pairs, share with a change")
    drawn = [each for each in rows if each["study"] == "prior"]
    stated = np.array([float(each["change"]) for each in drawn])
    changed = np.array([bool(each["true"]) for each in drawn])
    for low, high in ((0, 0.1), (0.1, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 1.01)):
        there = (low <= stated) & (stated < high)
        if there.any():
            print(f"  {low:.1f} to {min(high, 1.0):.1f}: mean {stated[there].mean():.3f}, "
                  f"{there.sum():4} pairs, {changed[there].mean():.3f}")  # fmt: skip
    for each in sorted(
        {e["study"] for e in rows if ":" in e["study"] or e["study"] == "pattern 6"}
    ):
        own = [e for e in rows if e["study"] == each]
        face = next(iter(json.loads(own[0]["losses"])))
        for finer in (False, True):
            odds = [json.loads(e["odds_of_places"])[face] for e in own if int(e["finer"]) == finer]
            if odds:
                seen = sum(one >= ODDS_SHOWN for one in odds)
                print(f"{each}, {'finer' if finer else 'own'}: shown in {seen} of {len(odds)}")


def in_words(rows, without_errors=False):
    """How many true losses are within their intervals, where the true set is found.

    Args:
        without_errors: whether true is what the class finds in tests without errors.
    """
    inside = n = 0
    for each in rows:
        losses = json.loads(each["losses"])
        if without_errors and losses and each["study"] in asce.PATTERNS:
            losses = losses_of_truth(each["study"], True)
        if float(each["odds_of_true"]) > np.exp(-1.0):
            of_true = {k: v for k, v in json.loads(each["intervals"]).items() if losses.get(k)}
            n += len(of_true)
            inside += sum(low <= losses[k] <= high for k, (low, _, high) in of_true.items())
    return f"{inside} of {n}, {100 * inside / n:.0f} %" if n else "-"


def print_visible(finer):
    model_class, _ = pair("none", 0, finer)
    family = family_of("none", model_class)
    hypotheses, _ = screened_hypotheses(family, 0, bs.Run(), QUICK, most_full=0)
    (nothing,) = [each for key, each in hypotheses.items() if not key.features]
    for place, each in smallest_losses(family, nothing, 0, bs.Run()).items():
        smallest = "none" if each is None else f"{each:.1%}"
        print(f"{place.name}: smallest visible loss {smallest}")


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("study")
    arguments.add_argument("files", type=Path, nargs="*")
    arguments.add_argument("--seeds", type=int, nargs=2, default=(0, 19))
    arguments.add_argument("--finer", action="store_true")
    given = arguments.parse_args()
    if given.study == "table":
        rows = [each for path in given.files for each in written(path)]
        print_random(rows)
        print_table([each for each in rows if each["study"] not in KINDS])
    elif given.study == "visible":
        print_visible(given.finer)
    else:
        (path,) = given.files
        run(given.study, path, given.seeds, given.finer)


if __name__ == "__main__":
    main()
