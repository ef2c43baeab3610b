"""KW51: what the retrofit of a railway bridge changed, beside what its temperature does.

    bayes-ssi changes runs/kw51_retrofit.py (options: the guide's chapter on measured structures)
    python runs/kw51_retrofit.py [--pairs 100] [--days 20]

One mode on 282 days of known temperature before and after the retrofit. Days are grouped by their
temperature, coldest first; a group is a test whose frequency is the mean of its days. Prints the
jump of the frequency with its interval, and beside it a plain regression; then pairs of groups of
days, all before the retrofit, in which nothing changed: days drawn at random, and days that follow
each other, of which one group may be in winter and the other in spring. A false alarm is a change
stated above 0.9, by approximate evidences, of which none is sampled.
"""

import argparse
import csv
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

import bayes_ssi as bs
from bayes_ssi.studies.changes.change_search import change_record
from bayes_ssi.studies.changes.changes_family import choose_changes
from bayes_ssi.studies.search.approximate_evidence import Effort
from bayes_ssi.studies.search.family_search import FamilySearch, screened_hypotheses

DATA = Path(__file__).parent.parent / "model_classes" / "data" / "kw51_daily.csv"
RETROFIT = ("2019-05-15", "2019-09-27")
GROUPS = 4  # by temperature, of the days on one side
HIGHEST_HZ = 4.0
# A loss or gain of stiffness of any size up to a fifth; that of all days in proportion to degrees,
# of a standard deviation of 2 % at the temperature that differs most from those before.
SETTINGS = {
    "loss": bs.Uniform(-0.2, 0.2), "common_sd": 0.02, "shared": None, "losses_only": True,
}  # fmt: skip
QUICK = Effort(100, 1, 500)
COARSE = bs.SamplingSettings(log_evidence_error=0.05)


class Days(NamedTuple):
    hz: np.ndarray  # (n,)
    degrees: np.ndarray  # (n,)

    def chosen(self, rows):
        return Days(self.hz[rows], self.degrees[rows])


def measured():
    """Days of known temperature before and after the retrofit."""
    with DATA.open(encoding="utf-8") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        known = [row for row in rows if row["temperature_c"]]
    sides = ([r for r in known if r["date"] < RETROFIT[0]],
             [r for r in known if r["date"] > RETROFIT[1]])  # fmt: skip
    return [
        Days(*(np.array([float(r[k]) for r in side]) for k in ("frequency_hz", "temperature_c")))
        for side in sides
    ]


def study_of(sides, n_groups=GROUPS):
    """The study of named groups of days, names of the tests of each side, and their degrees."""
    stiffness = (2.0 * np.pi * 2.92) ** 2 * bs.Parameter("k", bs.LogNormal(median=1.0, cov=0.1))
    deck = bs.ShearBuilding(masses=(1.0,), stiffnesses=(stiffness,))
    tests, names, degrees = [], {}, {}
    for side, days in sides.items():
        names[side] = []
        for i, rows in enumerate(np.array_split(np.argsort(days.degrees), n_groups), 1):
            group = days.chosen(rows)
            name = f"{side} {i}"
            error = group.hz.std(ddof=1) / group.hz.mean() / np.sqrt(len(rows))
            mode = bs.IdentifiedMode("1", group.hz.mean(), frequency_cov=error)
            data = bs.ModalData((mode,), (0.0, HIGHEST_HZ))
            tests.append(bs.Configuration(name, deck, data, pairing={"1": 1}))
            names[side].append(name)
            degrees[name] = float(group.degrees.mean())
    error = bs.ErrorModel(bs.Parameter("frequency_cov", bs.HalfNormal(0.001)))
    bridge = bs.ModelClass("bridge", configurations=tests, error=error)
    return bs.Study("Retrofit of railway bridge KW51", [bridge]), names, degrees


BEFORE, AFTER = measured()
study, TESTS, DEGREES = study_of({"before": BEFORE, "after": AFTER})


def changed(first, second):
    """What changed between two groups of days."""
    study, names, degrees = study_of({"before": first, "after": second})
    settings = bs.ChangeSettings(covariate=degrees, **SETTINGS)
    result = bs.changes(study, names["before"], names["after"], settings, 0, COARSE, visible=False)
    return result.record


def screened(first, second):
    """The same by approximate evidences alone, of which none is sampled."""
    study, names, degrees = study_of({"before": first, "after": second})
    settings = bs.ChangeSettings(covariate=degrees, **SETTINGS)
    family = choose_changes(study, names["before"], names["after"], settings)
    hypotheses, levels = screened_hypotheses(family, 0, bs.Run(), QUICK, most_full=0)
    nothing_sampled = SimpleNamespace(posteriors=(), comparison=SimpleNamespace(classes=()))
    search = FamilySearch(nothing_sampled, tuple(hypotheses.values()), tuple(levels))
    return change_record(family, search)


def jump_of(record):
    """Probability of a change, and by what share it moves the frequency: 5, 50 and 95 %."""
    (place,) = (each for each in record.places if not each.place.is_common)
    (losses,) = place.amounts.values()
    return record.probability_of_any, [np.sqrt(1.0 - loss) - 1.0 for loss in losses[::-1]]


def at_random(rng, n):
    """Rows of two groups of n days before the retrofit."""
    return np.split(rng.permutation(len(BEFORE.hz))[: 2 * n], 2)


def in_a_row(rng, n):
    """The same of two groups of successive days, without a day in common."""
    first = rng.integers(len(BEFORE.hz) - 2 * n + 1)
    second = rng.integers(first + n, len(BEFORE.hz) - n + 1)
    return np.arange(first, first + n), np.arange(second, second + n)


def regression(first, second):
    """Jump as a share of the frequency before, and its standard error, after temperature."""
    hz, degrees = (np.concatenate(each) for each in zip(first, second, strict=True))
    after = np.arange(len(hz)) >= len(first.hz)
    columns = np.stack([np.ones(len(hz)), degrees - degrees.mean(), after], axis=1)
    fitted, squares, *_ = np.linalg.lstsq(columns, hz, rcond=None)
    errors = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)) * squares / (len(hz) - 3))
    return fitted[2] / fitted[0], errors[2] / fitted[0]


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--pairs", type=int, default=100)
    arguments.add_argument("--days", type=int, default=20)
    given = arguments.parse_args()
    probability, interval = jump_of(changed(BEFORE, AFTER))
    print(f"{len(BEFORE.hz)} days before, {len(AFTER.hz)} after: a change {probability:.4f}")
    low, median, high = interval
    print(f"frequency after temperature: {median:+.2%} ({low:+.2%} to {high:+.2%})")
    jump, error = regression(BEFORE, AFTER)
    print(
        f"by regression: {jump:+.2%} ({jump - 1.645 * error:+.2%} to {jump + 1.645 * error:+.2%})"
    )
    for title, pairs in (("days at random", at_random), ("days in a row", in_a_row)):
        rng = np.random.default_rng(0)
        stated = []
        for _ in range(given.pairs):
            first, second = (BEFORE.chosen(rows) for rows in pairs(rng, given.days))
            stated.append(screened(first, second).probability_of_any)
        alarms = sum(each > 0.9 for each in stated)
        print(f"{given.pairs} pairs of {given.days} {title}: {alarms} stated above 0.9", end="; ")
        print(f"median {np.median(stated):.3f}, highest {max(stated):.3f}", flush=True)


if __name__ == "__main__":
    main()
