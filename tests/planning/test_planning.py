"""Expected information of layouts, against closed forms, quadrature and brute force."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import FLOORS, assert_refused
from scipy.special import gammaincc, logsumexp
from searches import COARSE, exact_modes

import bayes_ssi as bs
from bayes_ssi.inference.likelihood.any_pairing import AnyPairing
from bayes_ssi.inference.likelihood.pairings import PairingWeights, log_sum
from bayes_ssi.inference.likelihood.shape_density import log_shape_survival, log_sphere_area
from bayes_ssi.plots.figure_style import figures_for_files
from bayes_ssi.plots.place_plots import plot_layout
from bayes_ssi.report.tables.plan_tables import layout_rows
from bayes_ssi.studies.planning import layout_values
from bayes_ssi.studies.planning.centred_draws import Seen, _resampled, log_ratios
from bayes_ssi.studies.planning.planned_class import PlannedClass, shape_distances

BAND = (0.0, 6.0)
FEW, LEAST = {"n_tests": 200, "n_draws": 100}, {"n_tests": 50, "n_draws": 50}


def building(n, factors, stiffness=200.0):
    return bs.ShearBuilding((1.0,) * n, tuple(stiffness * factor for factor in factors))


def factor(name, cov=0.2):
    return bs.Parameter(name, bs.LogNormal(median=1.0, cov=cov))


def any_data(floors=FLOORS, **sizes):
    return bs.ModalData((bs.IdentifiedMode("1", 1.0, np.ones(len(floors)), **sizes),), BAND, floors)


def model_class(name, structure, frequency_cov=0.01, data=None, **more):
    error = bs.ErrorModel(frequency_cov=frequency_cov, shape_sd=0.05)
    data = any_data() if data is None else data
    return bs.ModelClass(name, structure, data, error, pairing="any", **more)


@pytest.fixture(scope="module")
def two_classes():
    """All storeys alike, or the first one apart."""
    k, k1 = factor("k"), factor("k1")
    factors = {"alike": (k, k, k), "first apart": (k1, k, k)}
    return bs.Study("storeys", [model_class(n, building(3, each)) for n, each in factors.items()])


@pytest.fixture(scope="module")
def whole(two_classes):
    """Layouts of two sensors, all compared."""
    return bs.plan(two_classes, 2, **LEAST)


@pytest.fixture(scope="module")
def small(two_classes):
    return bs.plan(two_classes, 1, **LEAST)


def planned(study, names=FLOORS):
    places = tuple(bs.Candidate(name, name) for name in names)
    return [PlannedClass(c, c.configurations[0], places, 0.5) for c in study.model_classes]


def simulated_plan(classes, n_tests, n_draws, seed):
    """Of layouts of two sensors."""
    layouts = layout_values.served_layouts((), tuple(range(len(classes[0].candidates))), 2, seed)
    return layout_values.SimulatedPlan.of(classes, layouts, n_tests, n_draws, seed)


def test_draws_serve_layouts_that_a_plan_can_have():
    """Fixed sensors are in all of them; where nothing is left to choose they are alone."""
    served = layout_values.served_layouts((1, 4), (0, 2, 3), 3, seed=0)
    assert served[0] == (0, 1, 2, 3, 4)
    assert all({1, 4} <= set(layout) for layout in served)
    assert {len(layout) for layout in served[1:]} == {2, 3}
    assert layout_values.served_layouts((0, 1), (2,), 2, seed=0) == [(0, 1, 2), (0, 1)]


@pytest.mark.parametrize(("d", "sd"), [(2, 0.05), (3, 0.3), (12, 0.05), (12, 0.2), (36, 0.08)])
def test_errors_of_shapes_have_the_likelihoods_density(d, sd):
    """The same survival as the length of normal numbers, by quadrature on the sphere."""
    lengths = np.sqrt(np.array([0.1, 0.5, 1.0, 1.5, 2.5]) * (d - 1))
    distances = shape_distances(lengths, np.full(5, sd), d)
    survival = np.exp(log_shape_survival(distances, np.full(5, sd), d))
    assert survival == pytest.approx(gammaincc(0.5 * (d - 1), 0.5 * lengths**2), abs=0.01)


def scored(planned_class, tests, n, layout, z):
    """Log density (B,) of a simulated test at z, summed over all pairings as the package does."""
    modes = planned_class.modes(z[None])
    seen = Seen.of(tests.rows(slice(n, n + 1)), [layout])
    ratios, unpaired = log_ratios(planned_class, seen, modes, 0.0)
    weights = ratios[0, 0]
    n_rows, n_data, n_model = weights.shape
    pairs = PairingWeights(weights, np.zeros(n_data), np.zeros((n_rows, n_model)))
    return unpaired[0] + log_sum(pairs)


def test_no_draw_alone_decides_where_searches_start():
    """Of shares 0.97 and three of 0.01, the first counts as much as the root of a quarter."""
    log_weights = 100.0 + np.log([[[0.97, 0.01, 0.01, 0.01]]])
    drawn = _resampled(log_weights, 20_000, np.random.default_rng(0))
    assert np.mean(drawn == 0) == pytest.approx(0.5 / 0.53, abs=0.01)


def test_tests_are_scored_as_the_package_scores_them(two_classes):
    """Modes of three sensors and of two: AnyPairing's density, but for the area of the sphere."""
    apart = planned(two_classes)[1]
    z = np.random.default_rng(1).standard_normal((4, 2))
    tests = simulated_plan((apart, apart), 60, 50, seed=2).tests
    for layout in ([0, 2], [0, 1, 2]):
        for n in np.flatnonzero(np.isfinite(tests.frequencies_hz).sum(axis=1) > 1)[:4]:
            found = np.flatnonzero(np.isfinite(tests.frequencies_hz[n]))
            shapes = tests.rows(slice(n, n + 1)).identified_shapes(layout)[0]
            sensors = [FLOORS[i] for i in layout]
            given = tests.frequencies_hz[n, found], shapes[:, found], BAND, sensors
            data = bs.ModalData.from_arrays(*given)
            kind = apart.model_class
            parts = kind.configurations[0].structure, data, kind.error, kind.identification
            theirs = AnyPairing(*parts, pairing={}).log_density(apart.structural_values(z))
            ours = scored(apart, tests, n, layout, z) - len(found) * log_sphere_area(len(layout))
            assert ours == pytest.approx(theirs, abs=1e-9)


def information_by_quadrature(classes, simulated, chosen, layout):
    """log p(D | C) - log p(D) of chosen tests, by grids of the parameters of each class.

    Posteriors are wider than 0.05 standard deviations of the prior: steps of 0.08 leave 1e-3.
    """
    step = np.linspace(-4.0, 4.0, 101)
    log_evidences = []
    for each in classes:
        d = len(each.parameters)
        grid = np.stack(np.meshgrid(*[step] * d), axis=-1).reshape(-1, d)
        weight = d * math.log(step[1] - step[0]) + each.log_before(grid)
        log_evidences.append(
            [logsumexp(weight + scored(each, simulated.tests, n, layout, grid)) for n in chosen]
        )
    log_evidences = np.array(log_evidences)
    log_total = logsumexp(log_evidences + math.log(0.5), axis=0)
    return log_evidences[simulated.true_class[chosen], np.arange(len(chosen))] - log_total


def gains_by_quadrature(classes, layouts, n_tests, n_draws, every, seed):
    """Mean gains of some simulated tests, with which the plan's values agree, for each layout."""
    simulated = simulated_plan(classes, n_tests, n_draws, seed)
    chosen = np.arange(0, n_tests, every)
    for layout in layouts:
        exact = information_by_quadrature(classes, simulated, chosen, layout)
        off = layout_values.class_gains(simulated, layout).values[chosen] - exact
        assert abs(off.mean()) < 3.0 * off.std() / math.sqrt(len(off)) + 0.01
        assert off.std() < 0.15
        yield exact.mean()


def test_gains_agree_with_quadrature(two_classes):
    """The first class has one parameter, the second has two."""
    layouts = [0, 1], [0, 1, 2]
    for gain in gains_by_quadrature(planned(two_classes), layouts, 100, 100, every=4, seed=3):
        assert 0.05 < gain < math.log(2.0)


def test_layouts_that_do_not_see_what_tells_classes_apart():
    """A pendulum or its mass: without its own sensor, other pairings explain a test as well."""
    k, f = factor("k"), factor("f")
    frame = building(3, (k, k, k))
    pendulum = bs.Pendulum(on=3, mass=0.15, frequency=2.8 * f)
    kinds = (("mass", pendulum.as_mass()), ("pendulum", pendulum))
    study = bs.Study("roof", [model_class(n, frame.with_element(each)) for n, each in kinds])
    classes = planned(study, (*FLOORS, "pendulum 3"))
    assert len([*gains_by_quadrature(classes, ([], [0, 2]), 100, 200, every=8, seed=4)]) == 2


def test_inferred_sizes_of_errors_agree_with_quadrature():
    """The size of frequencies' errors is one of two parameters of each class."""
    k = factor("k")
    size = bs.Parameter("size", bs.LogNormal(median=0.02, cov=0.5))
    kinds = (("even", building(3, (k, k, k))), ("softer roof", building(3, (k, k, 0.85 * k))))
    study = bs.Study("roof", [model_class(name, each, size) for name, each in kinds])
    (gain,) = gains_by_quadrature(planned(study), ([0, 1],), 100, 200, every=10, seed=5)
    assert 0.05 < gain < math.log(2.0)


def test_a_parameter_of_one_frequency_has_a_closed_form():
    """ln f = ½ ln k + …, normal: ½ ln(1 + (½ sd of ln k)²/σ²)."""
    k = factor("k", cov=0.3)
    sure = bs.IdentificationModel(1.0 - 1e-9, 1e-9)
    structure = building(1, (k,), stiffness=100.0)
    data = any_data(("floor 1",))
    study = bs.Study("one", [model_class("one", structure, 0.03, data, identification=sure)])
    plan = bs.plan(study, 1, aim="k", n_tests=400, n_draws=200)
    sd = math.sqrt(math.log(1.0 + 0.3**2))
    assert plan.best.gain == pytest.approx(0.5 * math.log(1.0 + (0.5 * sd / 0.03) ** 2), abs=0.02)


def test_a_greedy_search_finds_what_all_layouts_hold(two_classes, whole, monkeypatch):
    monkeypatch.setattr("bayes_ssi.studies.planning.layout_values.MOST_EXHAUSTIVE", 0)
    greedy = bs.plan(two_classes, 2, **LEAST)
    assert whole.is_exhaustive
    assert not greedy.is_exhaustive
    assert greedy.best == whole.best


def test_effective_independence_keeps_what_tells_shapes_apart():
    """Two modes: of sensors that see (1, 1) and one that sees (1, -1), that one stays."""
    shapes = np.array([[1.0, 1.0], [1.1, 1.1], [1.0, -1.0], [0.9, 0.9]])
    assert layout_values.effective_independence(shapes, 2) == (1, 2)
    assert layout_values.effective_independence(shapes, 2, fixed=(0,)) == (0, 2)


def test_a_layout_gives_the_form_of_its_modes(whole, tmp_path):
    layout = whole.best
    form = tmp_path / "modes.csv"
    layout.write_template(form)
    rows = list(csv.reader(form.read_text("utf-8").splitlines()))
    for row, frequency in zip(rows[3:5], ("1.0", "2.5"), strict=True):
        row[1] = frequency
        row[-2:] = ["0.5", "0.8"]
    filled = tmp_path / "filled.csv"
    with filled.open("w", newline="") as file:
        csv.writer(file).writerows(rows[:5])
    data = bs.read_modal_data(filled)
    assert data.sensors == layout.sensors
    assert data.band_hz == BAND
    assert data.labels == ("1", "2")
    with pytest.raises(FileExistsError):
        layout.write_template(form)


def test_what_a_next_test_adds_is_less_than_a_first_one():
    """After a test the parameter is known better: ½ ln of its precision is gained once only."""
    k = factor("k", cov=0.3)
    data = exact_modes(building(3, (k, k, k)), FLOORS, BAND, values=[1.1])
    study = bs.Study("one", [model_class("one", building(3, (k, k, k)), data=data)])
    ranking = bs.rank(study, settings=COARSE)
    first = bs.plan(study, 3, aim="k", fixed=FLOORS, **LEAST).best
    next_one = bs.plan(study, 3, aim="k", fixed=FLOORS, **FEW, after=ranking).best
    # As many modes again, as precise: twice the precision, but for modes that may be missed.
    assert next_one.gain == pytest.approx(0.5 * math.log(2.0), abs=0.05)
    assert first.gain > next_one.gain + 1.0


BAD = {
    "a layout of 4 sensors cannot be had": {"n_sensors": 4},
    "no degree of freedom 'roof'": {"candidates": ["floor 1", "roof"]},
    "fixed: no candidate 'roof'": {"fixed": ["roof"]},
    "no aim 'k9'": {"aim": "k9"},
    "n_tests must be at least 50, got 10": {"n_tests": 10},
    "n_draws must be at least 50, got 0": {"n_draws": 0},
    "one configuration, without a name; got 'bare'": {"configurations": ["bare"]},
    "do not fit into memory": {"n_tests": 1_000_000, "n_draws": 1000},
}


@pytest.mark.parametrize("message", BAD)
def test_bad_input_is_named(two_classes, message):
    assert_refused(message, bs.plan, two_classes, **{"n_sensors": 2, **FEW, **BAD[message]})


def frequencies(structure, values):
    return np.log(structure.modes(values).frequencies_hz)


@pytest.mark.parametrize(
    ("what", "aim"),
    [
        # All frequencies of one factor of stiffness move alike.
        (3, frequencies),
        (1, lambda structure, values: 7.0 + 0.0 * frequencies(structure, values)[:, :1]),
    ],
)
def test_an_aim_without_an_end_of_information_is_refused(two_classes, what, aim):
    with pytest.raises(ValueError, match=rf"the {what} values that the aim predicts .* 'alike'"):
        bs.plan(two_classes.only(["alike"]), 2, aim=aim, **LEAST)


def test_classes_without_a_rival_or_with_correlated_errors_are_refused(two_classes):
    assert_refused("'alike' is alone", bs.plan, two_classes.only(["alike"]), 2)
    error = bs.ErrorModel(0.01, 0.05, between_modes=0.5)
    own = bs.ModelClass("own", building(3, (factor("k"),) * 3), any_data(), error, pairing={"1": 1})
    assert_refused("correlated", bs.plan, bs.Study("one", [own]), 2, aim="k")


def test_layouts_are_drawn_in_space(two_classes, whole, small):
    with figures_for_files():
        assert {text.get_text().strip() for text in plot_layout(whole).texts} == {*FLOORS, *"xyz"}
        places = [
            bs.Candidate(name, name, coordinates=(i, 0, i), direction=(1, 0, 0))
            for i, name in enumerate(FLOORS)
        ]
        in_space = bs.plan(two_classes, 1, candidates=places, **LEAST)
        best = in_space.best  # of one sensor, whose MAC is NaN
        assert (best.sensors, best.gain) == (small.best.sensors, small.best.gain)
        assert plot_layout(in_space).name == "3d"


def test_more_draws_are_chosen_until_no_check_fails(two_classes, monkeypatch):
    monkeypatch.setattr("bayes_ssi.studies.planning.layout_plans.DRAWS", (50, 60))
    seen = []

    def fails_at_first(draws, _):
        seen.append(draws.shape)
        return ["few draws"] if len(seen) < 2 else []

    monkeypatch.setattr("bayes_ssi.studies.planning.layout_plans._failed_checks", fails_at_first)
    assert bs.plan(two_classes, 1, n_tests=50).failed_checks == ()
    assert len(seen) == 2
    seen.clear()
    assert bs.plan(two_classes, 1, n_tests=50, n_draws=50).failed_checks == ("few draws",)


def test_ties_are_called_ties(small):
    best = small.best
    tie = replace(best, sensors=("other",), gain=best.gain - 0.9 * best.error)
    worse = replace(best, sensors=tuple("abcdefghij"), gain=best.gain - 1.1 * best.error)
    tied = replace(small, layouts=(best, tie, worse))
    assert [row[0] for row in layout_rows(tied)[1:4]] == ["best", "tie", ""]
    assert layout_rows(tied)[3][1] == "a, b, c, d, e, f, g, h and 2 more"
    assert "(a tie within its error with other)" in tied.summary()
    one, two, three = best, *(replace(best, sensors=FLOORS[:n]) for n in (2, 3))
    wide = replace(small, layouts=(three,), by_number=(one, two, three), knee=2)
    gain = f"{best.gain:.3f} ± {best.error:.3f}"
    for knee, sensors in ((2, "floor 1 and floor 2"), (1, "frequencies alone, as of one sensor")):
        said = f" Fewer sensors say nearly as much: {sensors}, {gain} nats."
        assert replace(wide, knee=knee).summary().endswith(said)
    assert "Fewer" not in replace(wide, knee=3).summary()
    doubtful = replace(tied, failed_checks=("few draws",)).summary()
    assert doubtful == f"(!) few draws.\n\n{tied.summary()}"
