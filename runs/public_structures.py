"""Leave one mode out: is a mode that was not given predicted, on measured structures?

    python runs/public_structures.py [STRUCTURE ...]

Every identified mode of every measured study in model_classes/ is left out in turn, the classes are
ranked on the other modes, and the frequency that they predict, averaged by their probabilities and
with their errors, is compared with the measured one; the shape's MAC is printed where there is one.
A line for each mode, then a table of all structures: how far the best class, given all modes, is
off in the mean, how many left-out modes lie in the central 90 % interval, and how wide this is.

A mode that is left out was not looked for, so that it must not count as one that was missed. The
detection probability is a thousandth for this reason, and the expected number of spurious modes, in
proportion, as large as leaves the price of an unexplained mode as it was.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np

import bayes_ssi as bs
from bayes_ssi.results.predictions.posterior_draws import thinned_draws

STUDIES = Path(__file__).parent.parent / "model_classes"
NOT_LOOKED_FOR = 1e-3
DRAWS = 4000  # of an averaged prediction


class Case(NamedTuple):
    """Measured tests of a study; names of tests are chosen by what they begin with."""

    study: str
    published: str  # root mean square error of a published update, all modes given
    tests: str = ""  # that are ranked
    left_out_of: str = ""  # of which modes are left out


CASES = {
    "four-storey frame": Case("four_storey_frame", "0.03 %"),
    "Liverpool, bare": Case("liverpool_frame", "none", "bare"),
    "Liverpool, with blade": Case("liverpool_frame", "none", left_out_of="with blade"),
    "Los Alamos, nine states": Case("los_alamos_frame", "0.2 %, state 1"),
    "GARTEUR SM-AG19": Case("garteur", "none here"),
}


class Predicted(NamedTuple):
    """A mode that was left out and its prediction, averaged over classes."""

    name: str
    measured_hz: float
    low_hz: float
    median_hz: float
    high_hz: float
    mac: float  # of the mean prediction with the measured shape; NaN without one

    @property
    def covered(self):
        return self.low_hz <= self.measured_hz <= self.high_hz

    @property
    def half_width(self):
        return 0.5 * (self.high_hz - self.low_hz) / self.measured_hz


def classes_of(case):
    """The classes of a case with its tests; those that are alike without the others, once."""
    classes = {}
    for each in bs.load_study(STUDIES / f"{case.study}.py").model_classes:
        tests = [test for test in each.configurations if test.name.startswith(case.tests)]
        error = each.error
        one = bs.ModelClass(each.name, configurations=tests, error=error)
        classes.setdefault((one.parameter_names, error, _pairings(one)), one)
    return list(classes.values())


def _pairings(model_class):
    return str([test.pairing for test in model_class.configurations])


def without(model_class, name, label):
    """The class where one mode of one test was not looked for."""
    tests = []
    for test in model_class.configurations:
        if test.name == name:
            kept = tuple(mode for mode in test.data.modes if mode.label != label)
            pairing = {each: i for each, i in test.pairing.items() if each != label}
            test = replace(test, data=replace(test.data, modes=kept), pairing=pairing)
        tests.append(test)
    given = model_class.identification
    share = NOT_LOOKED_FOR / given.detection_probability
    not_looked_for = bs.IdentificationModel(NOT_LOOKED_FOR, share * given.expected_spurious_modes)
    return bs.ModelClass(
        model_class.name,
        configurations=[test for test in tests if test.data.modes],
        error=model_class.error,
        identification=not_looked_for,
    )


def predicted(classes, name, label, seed=0, settings=None):
    """Rank the classes that have a mode on all others, and predict it."""
    having = [each for each in classes if label in each.configuration(name).pairing]
    study = bs.Study("left out", [without(each, name, label) for each in having])
    ranking = bs.rank(study, seed, settings)
    chances = {row.name: row.probability for row in ranking.comparison.classes}
    identified = next(m for m in having[0].configuration(name).data.modes if m.label == label)
    frequencies, shapes = [], []
    for each, given, posterior in zip(having, study.model_classes, ranking.posteriors, strict=True):
        test = each.configuration(name)
        number, n = test.pairing[label], round(DRAWS * chances[each.name])
        if n:
            hz = bs.predict_frequencies(posterior, given, name, {label: number}, n, seed)
            frequencies.append(hz.draws[:, 0])
        if n and identified.shape is not None:
            draws = thinned_draws(posterior, given, n, name)
            shapes.append(draws.shapes(number, test.data.sensors))
    low, median, high = np.quantile(np.concatenate(frequencies), [0.05, 0.5, 0.95])
    mac = np.nan
    if shapes:
        unit = np.concatenate(shapes)
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
        along = unit @ identified.unit_shape
        mean = (np.sign(along)[:, None] * unit).mean(axis=0)
        mac = (mean @ identified.unit_shape) ** 2 / (mean @ mean)
    title = f"{name} {label}".strip()
    return Predicted(title, identified.frequency_hz, low, median, high, mac)


def error_with_all_modes(classes):
    """Name of the best class, and the root mean square of its relative errors."""
    ranking = bs.rank(bs.Study("all modes", classes))
    best = ranking.comparison.best.name
    posterior = next(each for each in ranking.posteriors if each.name == best)
    (model_class,) = (each for each in classes if each.name == best)
    off = []
    for test in model_class.configurations:
        modes, hz = posterior.configuration(test.name)
        mean = hz.reshape(-1, hz.shape[-1]).mean(axis=0)
        measured = {mode.label: mode.frequency_hz for mode in test.data.modes}
        off += [mean[i - 1] / measured[label] - 1.0 for label, i in modes.pairing.items()]
    return best, float(np.sqrt(np.mean(np.square(off))))


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("structures", nargs="*", help=f"of {', '.join(CASES)}; all by default")
    rows = []
    for structure in arguments.parse_args().structures or CASES:
        case, begun = CASES[structure], process_time()
        classes = classes_of(case)
        best, error = error_with_all_modes(classes)
        print(f"\n{structure}: best with all modes {best!r}", flush=True)
        left_out = []
        for test in classes[0].configurations:
            for mode in test.data.modes if test.name.startswith(case.left_out_of) else ():
                each = predicted(classes, test.name, mode.label)
                left_out.append(each)
                shape = "" if np.isnan(each.mac) else f", MAC {each.mac:.3f}"
                print(
                    f"  {each.name:22} {each.measured_hz:7.3f} Hz, predicted {each.median_hz:7.3f} "
                    f"({each.low_hz:.3f} to {each.high_hz:.3f}){shape}"
                    f"{'' if each.covered else '  outside'}",
                    flush=True,
                )
        inside = sum(each.covered for each in left_out)
        width = np.median([each.half_width for each in left_out])
        rows.append((structure, case.published, error, inside, len(left_out), width))
        print(f"  {process_time() - begun:.0f} s of computing")
    print("\n| structure | published error | ours, all modes | within 90 % | half width |")
    print("| --- | --- | --- | --- | --- |")
    for structure, published, error, inside, n, width in rows:
        print(f"| {structure} | {published} | {error:.2%} | {inside} of {n} | ± {width:.1%} |")
    inside, n = (sum(row[i] for row in rows) for i in (3, 4))
    print(f"| all | | | {inside} of {n}, {inside / n:.0%} | |")


if __name__ == "__main__":
    main()
