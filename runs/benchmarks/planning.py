"""Plans of tests against evidences of the engine, and against what tests then say.

    python runs/benchmarks/planning.py oracle|forecasts|steel
    python runs/benchmarks/planning.py frame concrete_frame_fe.mat

oracle: gains of all layouts of the numerical study, and of a harder one, against evidences that
the package's engine gives each simulated test, layout and class by itself.
frame: 6 of 36 sensors of a finite-element model of 2302 degrees of freedom.
forecasts: 200 other tests with the best, an evenly spread and the worst layout of two sensors: the
share in which the right class wins beside the forecast; with best and worst also by ranking some.
steel: what a sensor on a brace of the steel frame would have been worth (--tests 400 --inner 3000).
"""

import argparse
import itertools
import math
import runpy
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.special import logsumexp

import bayes_ssi as bs
from bayes_ssi.inference.likelihood.shape_density import log_sphere_area
from bayes_ssi.structures.geometry import Candidate
from bayes_ssi.studies.planning.layout_values import (
    LayoutSearch,
    SimulatedPlan,
    class_gains,
    served_layouts,
)
from bayes_ssi.studies.planning.planned_class import PlannedClass

HERE = Path(__file__).parent
CLASSES = HERE.parents[1] / "model_classes"
STUDY = runpy.run_path(str(CLASSES / "shear_building.py"))
FLOORS = ("floor 1", "floor 2", "floor 3")
PLACES = (*FLOORS, "infill 1-2")


def harder(mass=0.005, frequency_cov=0.02, shape_sd=0.1):
    """The numerical study with a lighter infill, larger errors, and modes easily missed."""
    infill = replace(STUDY["infill"], mass=3 * mass)
    frame = STUDY["frame"]
    error = bs.ErrorModel(frequency_cov, shape_sd)
    missing = bs.IdentificationModel(detection_probability=0.8, expected_spurious_modes=0.5)
    return bs.Study("lighter infill, larger errors", [
        bs.ModelClass(name, frame.with_element(element), STUDY["modes"], error, pairing="any",
                      identification=missing)
        for name, element in (("as mass", infill.as_mass()), ("own freedom", infill))
    ])  # fmt: skip


def planned(study, names=PLACES):
    places = tuple(Candidate(name, name) for name in names)
    return [
        PlannedClass(c, c.configurations[0], places, 1.0 / len(study.model_classes))
        for c in study.model_classes
    ]


def simulated_plan(classes, n_sensors, n_tests, n_draws, seed):
    free = tuple(range(len(classes[0].candidates)))
    layouts = served_layouts((), free, n_sensors, seed)
    return SimulatedPlan.of(classes, layouts, n_tests, n_draws, seed)


def layouts_of(n):
    return [each for size in range(1, n + 1) for each in itertools.combinations(range(n), size)]


def as_study(study, simulated, n, layout, names):
    """The simulated test n as data of the study's classes; None where it found no mode."""
    identified_hz = simulated.tests.frequencies_hz[n]
    places = np.flatnonzero(np.isfinite(identified_hz))
    if not len(places):
        return None
    band, sensors = study.model_classes[0].data.band_hz, tuple(names[i] for i in layout)
    shapes = simulated.tests.rows(slice(n, n + 1)).identified_shapes(list(layout))[0]
    if len(layout) > 1:
        modes = [bs.IdentifiedMode(str(j), identified_hz[j], shapes[:, j]) for j in places]
        data = bs.ModalData(tuple(modes), band, sensors)
    else:  # a shape at one sensor says nothing
        data = bs.ModalData(
            tuple(bs.IdentifiedMode(str(j), identified_hz[j]) for j in places), band
        )
    return bs.Study(str(n), [
        bs.ModelClass(c.name, c.structure, data, c.error, pairing="any",
                      identification=c.identification) for c in study.model_classes
    ])  # fmt: skip


def oracle(given):
    """Paired: the difference of gains is far more certain than a gain."""
    studies = {"numerical study": STUDY["study"].with_any_pairing(), "harder": harder()}
    settings = bs.SamplingSettings(particles=100, searches=1)
    for name, study in studies.items():
        classes = planned(study)
        started = perf_counter()
        simulated = simulated_plan(classes, 2, given.tests, given.inner, given.seed)
        print(f"\n{name}: {given.tests} tests in {perf_counter() - started:.0f} s", flush=True)
        layouts = [(0,), *(each for each in layouts_of(4) if len(each) > 1)]
        gains_by_layout = {layout: class_gains(simulated, layout) for layout in layouts}
        step = len(simulated.true_class) // given.oracle_tests
        of_layouts = {layout: [] for layout in layouts}
        started = perf_counter()
        for n in range(0, len(simulated.true_class), step):
            if perf_counter() - started > given.seconds:
                break
            for layout in layouts:
                ours = as_study(study, simulated, n, layout, PLACES)
                if ours is None:
                    continue
                posteriors = bs.rank(ours, settings=settings).posteriors
                logs = {each.name: each.evidence.log_evidence for each in posteriors}
                total = logsumexp(list(logs.values())) - math.log(len(logs))
                right = study.names[simulated.true_class[n]]
                of_layouts[layout].append((gains_by_layout[layout].values[n], logs[right] - total))
        for layout, values in of_layouts.items():
            plan, engine = np.transpose(values)
            off, n = plan - engine, len(engine)
            gain, error = simulated.mean(gains_by_layout[layout].values)
            names = ", ".join(PLACES[i] for i in layout) if len(layout) > 1 else "frequencies alone"
            print(f"{names:42s} gain {gain:.3f} ± {error:.3f}; in {n} tests {plan.mean():.4f}, by "
                  f"the engine {engine.mean():.4f}, difference {off.mean():+.4f} ± "
                  f"{off.std() / math.sqrt(n):.4f}", flush=True)  # fmt: skip


def frame(given):
    study = runpy.run_path(str(HERE.parent / "concrete_frame.py"))
    rng = np.random.default_rng(1)
    frames = {n: study["structure"](given.file, groups) for n, groups in study["GROUPS"].items()}
    true_frame = frames["columns by storey"]
    truth = np.array([study["TRUTH"][p.name] for p in true_frame.parameters])
    modes = study["simulated_modes"](true_frame, truth, rng)
    error = bs.ErrorModel(study["FREQUENCY_COV"], study["SHAPE_SD"])
    whole = bs.Study("concrete frame", [
        bs.ModelClass(name, each.reduced(), modes, error, pairing="any")
        for name, each in frames.items()
    ])  # fmt: skip
    names = modes.sensors[:36]
    places = tuple(Candidate(name, name) for name in names)
    classes = [
        PlannedClass(c, c.configurations[0], places, 0.5).made_accurate()
        for c in whole.model_classes
    ]
    started = perf_counter()
    simulated = simulated_plan(classes, 6, given.tests, given.inner, given.seed)
    print(f"draws: {perf_counter() - started:.0f} s", flush=True)
    some = simulated.part(300, 100)
    search = LayoutSearch(
        lambda layout: some.mean(class_gains(some, layout).values)[0], (), tuple(range(36))
    )
    started, layout = perf_counter(), ()
    for number in range(2, 7):
        layout = search.best(number, layout)
        gain, error = simulated.mean(class_gains(simulated, layout).values)
        took = perf_counter() - started
        chosen = ", ".join(names[i] for i in layout)
        print(f"{number} sensors: {chosen}: {gain:.4f} ± {error:.4f}", flush=True)
        print(f"  {len(search.tried)} layouts in {took:.1f} s", flush=True)
    gains = class_gains(simulated, layout)
    even = tuple(range(0, 36, 6))
    print(f"evenly spread {simulated.mean(class_gains(simulated, even).values)}; effective draws "
          f"{np.median(gains.draws):.0f}, bias {simulated.mean(gains.bias)[0]:+.4f}")  # fmt: skip


def forecasts(given):
    """By evidences of other tests and draws; of some of these tests, by rank, too."""
    study = harder(given.mass)
    classes = planned(study)
    simulated = simulated_plan(classes, 2, 2000, given.inner, given.seed)
    gains_by_layout = {
        each: class_gains(simulated, each) for each in layouts_of(4) if len(each) == 2
    }
    by_gain = sorted(
        gains_by_layout, key=lambda each: simulated.mean(gains_by_layout[each].values)[0]
    )
    kinds = {"best": by_gain[-1], "evenly spread": (0, 2), "worst": by_gain[0]}
    for i, (kind, layout) in enumerate(kinds.items(), 1):
        forecast, error = simulated.mean(gains_by_layout[layout].named)
        gain, _ = simulated.mean(gains_by_layout[layout].values)
        names = tuple(PLACES[i] for i in layout)
        fresh = simulated_plan(classes, 2, 200, 1000, given.seed + 99 * i)
        named = class_gains(fresh, layout).named
        print(f"{kind} ({', '.join(names)}): gain {gain:.3f}; right class forecast {forecast:.3f} "
              f"± {error:.3f}, came out in {named.mean():.3f} ± "
              f"{named.std() / math.sqrt(len(named)):.3f} of {len(named)}", flush=True)  # fmt: skip
        if kind != "evenly spread":
            ranked(given, study, fresh, layout)


def ranked(given, study, fresh, layout):
    """Some of the same tests as data of the study, ranked, beside the plan's evidences."""
    ours = [logsumexp(each, axis=1) - math.log(1000) for each in fresh.log_weights(layout)]
    named = np.argmax(ours, axis=0)
    settings = bs.SamplingSettings(particles=100, searches=1, max_steps=400)
    right, same, failed, off = [], [], [], []
    tests = np.linspace(0, 199, given.ranked).astype(int)
    started = perf_counter()
    for n in np.random.default_rng(0).permutation(tests):
        data = as_study(study, fresh, n, layout, PLACES)
        if data is None or perf_counter() - started > given.seconds:
            continue
        comparison = bs.rank(data, settings=settings).comparison
        theirs = {row.name: row.log_evidence for row in comparison.classes}
        theirs = np.array([theirs[name] for name in study.names])
        best = study.names.index(comparison.best.name)
        right.append(best == fresh.true_class[n])
        same.append(best == named[n])
        failed.append(any(row.failed_checks for row in comparison.classes))
        # The plan's densities are relative to shapes that are uniform on the sphere.
        n_identified = np.isfinite(fresh.tests.frequencies_hz[n]).sum()
        relative = np.array([each[n] for each in ours]) - n_identified * log_sphere_area(
            len(layout)
        )
        off.append([*(relative - theirs), *np.diff(relative - theirs)])
    share, (mean, scatter) = np.mean(right), (np.mean(off, axis=0), np.std(off, axis=0))
    print(f"  by rank right in {sum(right)} of {len(right)}, {share:.3f} ± "
          f"{math.sqrt(share * (1.0 - share) / len(right)):.3f}; the same class in {sum(same)}; a "
          f"failed check in {sum(failed)}. Log evidences by the plan less those by rank, mean and "
          f"scatter: " + ", ".join(
              f"{name} {m:+.3f}, {d:.3f}"
              for name, m, d in zip((*study.names, "log Bayes factor"), mean, scatter, strict=True)
          ), flush=True)  # fmt: skip


def steel(given):
    of_study = runpy.run_path(str(CLASSES / "steel_frame.py"))
    study = of_study["study"].only(["1-a M3", "3 M3+"])
    brace = bs.Sensor("braces", {"floor 1 y": 1.0})

    def with_brace(structure, _):
        known = "braces" in structure.degrees_of_freedom
        return structure if known else structure.with_sensors([brace])

    study = bs.Study("steel frame", [c.with_structures(with_brace) for c in study.model_classes])
    corners = [sensor.label for sensor in of_study["SENSORS"]]
    amount = {"n_tests": given.tests, "n_draws": given.inner}
    for configuration in ("BC", "SC"):
        started = perf_counter()
        plan = bs.plan(study, 8, candidates=[*corners, "braces"], fixed=corners,
                       configurations=[configuration], **amount)  # fmt: skip
        print(f"{configuration}, 8 sensors at the corners ({perf_counter() - started:.0f} s): gain "
              f"{plan.best.gain:.3f} ± {plan.best.error:.3f} of {plan.greatest:.3f}, right class "
              f"named {plan.best.naming:.3f}; effective draws {plan.effective_draws:.0f}, bias "
              f"{plan.bias:+.4f} {plan.failed_checks}")  # fmt: skip


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("what", choices=("oracle", "frame", "forecasts", "steel"))
    arguments.add_argument("file", nargs="?", help="concrete_frame_fe.mat")
    arguments.add_argument("--tests", type=int, default=1000)
    arguments.add_argument("--inner", type=int, default=200)
    arguments.add_argument("--oracle-tests", type=int, default=100)
    arguments.add_argument("--seconds", type=float, default=math.inf, help="of oracle and ranks")
    arguments.add_argument("--ranked", type=int, default=40)
    arguments.add_argument("--mass", type=float, default=0.005)
    arguments.add_argument("--seed", type=int, default=0)
    given = arguments.parse_args()
    globals()[given.what](given)


if __name__ == "__main__":
    main()
