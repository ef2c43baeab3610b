"""The search for hidden appendages: its hypotheses, what it finds, and how it is shown."""

import io
import json
import math
from dataclasses import replace
from functools import partial

import matplotlib as mpl
import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

mpl.use("Agg")

from matplotlib.figure import Figure

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.modal import Modes
from bayes_ssi.plots import plot_places, save_figures, save_places
from bayes_ssi.results import load_result
from bayes_ssi.search import (
    Place,
    SearchSettings,
    hypothesis,
    places_of,
    search,
    search_record,
)
from bayes_ssi.structures import Structure
from bayes_ssi.tables import averaged_table, search_notes, search_table

COARSE = bs.SamplingSettings(log_evidence_error=1.0, particles=40, searches=1, max_steps=10)
ONE = SearchSettings(number_weights=(1.0, 1.0))
PENDULUM_1, PENDULUM_3 = Place("pendulum", (1,)), Place("pendulum", (3,))
INFILL_12, INFILL_01 = Place("infill", (1, 2)), Place("infill", (0, 1))


@pytest.fixture
def bare(frame, case_c, fixed_error):
    """The numerical study's frame without its infill, which the data know of."""
    return bs.ModelClass("bare", frame, case_c, fixed_error, pairing={"1": 1})


@pytest.fixture
def fake_sampling(monkeypatch, make_posterior):
    """Replaces sampling by posteriors of given log evidence; returns the names sampled, by level.

    Every hypothesis has draws of its own.
    """

    def install(log_evidence):
        levels = []

        def sample_all(candidates, seed, settings, progress, workers, checkpoint):
            del seed, settings, progress, workers
            if checkpoint is not None:  # as its journals do
                checkpoint.directory.mkdir(exist_ok=True)
            levels.append([candidate.name for candidate in candidates])
            found = []
            for candidate in candidates:
                n = len(candidate.parameters)
                rng = np.random.default_rng(list(candidate.name.encode()))
                centre = rng.normal(1.0, 0.3, n)
                found.append(
                    make_posterior(
                        candidate.name,
                        log_evidence(candidate.name),
                        names=candidate.parameter_names,
                        draws=centre * np.exp(0.5 * rng.standard_normal((4, 250, n))),
                        log_likelihoods=rng.standard_normal((4, 250)),
                    )
                )
            return found

        monkeypatch.setattr("bayes_ssi.search.sample_all", sample_all)
        return levels

    return install


def by_count(*log_evidences):
    """Log evidence by the number of appendages; a little more for those named later."""
    return lambda name: (
        log_evidences[0 if name == "no appendage" else 1 + name.count(" + ")]
        + 0.01 * sum(name.encode()) / 1000
    )


# Places and settings


def test_places_are_floors_and_storeys(frame):
    assert [place.name for place in places_of(frame)] == [
        "pendulum 1", "pendulum 2", "pendulum 3", "infill 0-1", "infill 1-2", "infill 2-3",
    ]  # fmt: skip


def test_elements_that_are_there_already_are_no_places(augmented, frame):
    assert places_of(augmented) == places_of(frame)


@pytest.mark.parametrize("weights", [(), (1.0,), (1.0, 0.0), (1.0, -1.0), (math.inf, 1.0),
                                     (1.0, math.nan)])  # fmt: skip
def test_bad_weights_of_numbers_are_refused(weights):
    with pytest.raises(ValueError, match="number_weights must be two or more positive numbers"):
        SearchSettings(number_weights=weights)


def test_no_branch_is_refused():
    with pytest.raises(ValueError, match="branches must be at least 1, got 0"):
        SearchSettings(branches=0)


@pytest.mark.parametrize("changes", [{"mass_ratio": 0.05}, {"mass_ratio": None},
                                     {"frequency": (1.0, 2.0)}])  # fmt: skip
def test_what_is_no_prior_is_refused(changes):
    with pytest.raises(TypeError, match=f"{next(iter(changes))} must be a prior, got"):
        SearchSettings(**changes)


def test_weights_of_numbers_may_be_a_list():
    assert SearchSettings(number_weights=[1, 2]).number_weights == (1, 2)


class Plate(Structure):
    """A structure without floors."""

    parameters = (bs.Parameter("k", bs.Uniform(1.0, 2.0)),)
    degrees_of_freedom = ("x",)
    n_modes = 1

    def modes(self, values):
        return Modes(values[:, :1], np.ones((len(values), 1, 1)))


def test_a_structure_without_floors_is_refused():
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0),), (0.0, 3.0))
    with pytest.raises(ValueError, match=r"^model class 'p': a search needs .* got Plate$"):
        search(bs.ModelClass("p", Plate(), data, pairing={}))


# Hypotheses


def hand_built(frame, kind, where, mass, frequency):
    if kind == "pendulum":
        return frame.with_element(bs.Pendulum(on=where[0], mass=mass, frequency=frequency))
    return frame.with_element(bs.OutOfPlaneInfill(where, 2.0 * mass, frequency))


@pytest.mark.parametrize("place", [PENDULUM_1, PENDULUM_3, INFILL_12, INFILL_01])
def test_a_hypothesis_is_the_structure_with_the_element_on_it(frame, bare, place):
    """A mass ratio of 0.1 and a mean floor mass of 2 are a vibrating mass of 0.2."""
    frame = replace(frame, masses=(1.0, 2.0, 3.0))
    made = hypothesis(replace(bare, structure=frame), (place,))
    assert made.name == place.name
    values = {"k1": 1.1, "k2": 0.9, "k3": 1.2,
              f"mass ratio, {place.name}": 0.1, f"frequency, {place.name}": 2.5}  # fmt: skip
    assert set(made.parameter_names) == set(values)
    found = made.structure.modes(np.array([[values[name] for name in made.parameter_names]]))
    expected = hand_built(frame, place.kind, place.floors, 0.2, 2.5).modes(
        np.array([[1.1, 0.9, 1.2]])
    )
    np.testing.assert_allclose(found.frequencies_hz, expected.frequencies_hz, rtol=1e-11)


def test_a_hypothesis_with_two_appendages(bare):
    made = hypothesis(bare, (PENDULUM_1, INFILL_12))
    assert made.name == "pendulum 1 + infill 1-2"
    assert made.structure.n_modes == 5
    assert len(made.parameters) == 7


def test_no_appendage_is_the_baseline(bare):
    made = hypothesis(bare, ())
    assert (made.name, made.structure) == ("no appendage", bare.structure)


def prior_of(model_class, name):
    return next(p.prior for p in model_class.parameters if p.name == name)


def test_frequencies_reach_from_half_the_lowest_identified_to_the_end_of_the_band(bare):
    made = hypothesis(bare, (PENDULUM_1,))
    assert prior_of(made, "frequency, pendulum 1") == bs.LogUniform(0.5 * 0.98275928, 6.0)


def test_priors_of_the_user_are_used(bare):
    settings = SearchSettings(mass_ratio=bs.Uniform(0.01, 0.2), frequency=bs.LogUniform(2.0, 3.0))
    made = hypothesis(bare, (PENDULUM_1,), settings)
    assert prior_of(made, "frequency, pendulum 1") == bs.LogUniform(2.0, 3.0)
    assert prior_of(made, "mass ratio, pendulum 1") == bs.Uniform(0.01, 0.2)


def test_every_hypothesis_is_scored_over_all_pairings(bare, fake_sampling):
    fake_sampling(by_count(0.0, 0.0))
    found = search(bare, ONE)
    assert {candidate.pairing for candidate in found.ranking.study.model_classes} == {"any"}


def test_the_scale_of_masses_is_the_mean_floor_mass(case_c, fixed_error, fake_sampling):
    fake_sampling(by_count(0.0, 0.0))
    k = bs.Parameter("k", bs.LogNormal(100.0, 0.3))
    m = bs.Parameter("m", bs.LogNormal(4.0, 0.1))
    structure = bs.ShearBuilding((1.0, 2.5 * m, 1.0), (k, k, k))
    found = search(bs.ModelClass("b", structure, case_c, fixed_error, pairing={}), ONE)
    assert found.mass_scale == pytest.approx(4.0)


# Levels and weights


def test_one_appendage_at_most(bare, fake_sampling):
    levels = fake_sampling(by_count(0.0, 9.0, 20.0))
    search(bare, ONE)
    assert [len(level) for level in levels] == [7]


def test_two_are_tried_on_the_best_ones(bare, fake_sampling):
    heights = {"no appendage": 0.0, "infill 1-2": 5.0, "pendulum 3": 4.0}
    levels = fake_sampling(lambda name: heights.get(name, -1.0))
    search(bare)
    assert len(levels) == 2
    # Five places beside each of the two best, the pair of both counted once.
    assert len(set(levels[1])) == len(levels[1]) == 9
    assert all("infill 1-2" in name or "pendulum 3" in name for name in levels[1])
    assert "pendulum 3 + infill 1-2" in levels[1]


def test_one_branch_extends_only_the_best(bare, fake_sampling):
    levels = fake_sampling(lambda name: {"infill 1-2": 5.0}.get(name, -1.0))
    search(bare, SearchSettings(branches=1))
    assert len(levels[1]) == 5


def test_two_are_not_tried_where_one_does_not_help(bare, fake_sampling):
    levels = fake_sampling(by_count(1.0, 0.0, 50.0))
    search(bare)
    assert [len(level) for level in levels] == [7]


def test_three_are_not_tried_where_two_do_not_help(bare, fake_sampling):
    levels = fake_sampling(by_count(0.0, 9.0, 8.0, 50.0))
    search(bare, SearchSettings(number_weights=(1.0, 1.0, 1.0, 1.0)))
    assert [len(level) for level in levels] == [7, 9]


def test_more_than_there_are_places_are_not_tried(tiny_study, fake_sampling):
    levels = fake_sampling(by_count(0.0, 1.0, 2.0, 3.0, 4.0))
    found = search(
        tiny_study.model_classes[0], SearchSettings(number_weights=(1.0,) * 9, branches=9)
    )
    assert [len(level) for level in levels] == [5, 6, 4, 1]
    assert max(map(len, found.places.values())) == 4


def test_a_number_shares_its_weight_among_all_ways_to_place_so_many(bare, fake_sampling):
    fake_sampling(by_count(0.0, 1.0, 2.0))
    found = search(bare, SearchSettings(number_weights=(2.0, 3.0, 0.5)))
    assert found.ranking.study.prior_weights == pytest.approx(
        {
            name: (2.0, 3.0, 0.5)[len(places)] / math.comb(6, len(places))
            for name, places in found.places.items()
        }
    )
    assert sum(len(places) == 1 for places in found.places.values()) == 6


def shares(found, log_evidence):
    """Probability of every hypothesis, from evidence and prior weight."""
    weights = found.ranking.study.prior_weights
    plain = {name: weights[name] * math.exp(log_evidence(name)) for name in weights}
    return {name: share / sum(plain.values()) for name, share in plain.items()}


def test_probabilities_of_places_are_sums_over_hypotheses(bare, fake_sampling):
    log_evidence = by_count(0.0, 1.0, 3.0)
    fake_sampling(log_evidence)
    found = search(bare)
    expected = shares(found, log_evidence)
    for place in places_of(bare.structure):
        total = sum(share for name, share in expected.items() if place.name in name)
        assert found.place_probabilities[place] == pytest.approx(total, rel=1e-9)
    assert found.probability_of_any == pytest.approx(1.0 - expected["no appendage"], rel=1e-9)


def test_averaged_parameters_are_those_of_the_mixture(frame, case_c, fake_sampling):
    """With an inferred error, whose column moves as appendages add theirs."""
    log_evidence = by_count(0.0, 0.5, 1.0)
    fake_sampling(log_evidence)
    found = search(bs.ModelClass("b", frame, case_c, pairing={}))
    expected = shares(found, log_evidence)
    draws = {p.name: dict(zip(p.parameter_names, p.values.T, strict=True))
             for p in found.ranking.posteriors}  # fmt: skip
    naive = draws["no appendage"]
    assert [row.name for row in found.averaged_parameters] == list(naive)
    for row in found.averaged_parameters:
        x = np.concatenate([own[row.name] for own in draws.values()])
        w = np.repeat([expected[name] / 1000 for name in draws], 1000)
        mean = float(w @ x)
        assert row.mean == pytest.approx(mean, rel=1e-9)
        assert row.sd == pytest.approx(math.sqrt(w @ (x - mean) ** 2), rel=1e-9)
        quantiles = np.quantile(x, [0.05, 0.95], weights=w, method="inverted_cdf")
        assert (row.quantile_05, row.quantile_95) == pytest.approx(tuple(quantiles), rel=1e-3)
        assert row.naive_mean == pytest.approx(naive[row.name].mean())
        assert row.naive_sd == pytest.approx(naive[row.name].std())


def test_appendages_are_medians_and_intervals_in_units_of_the_structure(bare, fake_sampling):
    fake_sampling(by_count(0.0, 1.0, 2.0))
    found = search(bare)
    name = next(name for name, places in found.places.items() if len(places) == 2)
    posterior = next(p for p in found.ranking.posteriors if p.name == name)
    for summary, place in zip(found.appendages(name), found.places[name], strict=True):
        assert summary.place == place
        for quantity, found_there in (("mass ratio", summary.mass),
                                      ("frequency", summary.frequency_hz)):  # fmt: skip
            column = posterior.parameter_names.index(f"{quantity}, {place.name}")
            expected = np.quantile(posterior.values[:, column], [0.05, 0.5, 0.95])
            assert found_there == pytest.approx(tuple(expected))
    assert found.appendages("no appendage") == ()


def test_the_record_is_all_of_it_and_is_json(bare, fake_sampling):
    fake_sampling(by_count(0.0, 1.0, 2.0))
    found = search(bare)
    record = json.loads(json.dumps(search_record(found)))
    assert record["probability_of_any"] == found.probability_of_any
    assert record["mass_scale"] == 1.0
    assert record["places"][4] == {
        "kind": "infill", "floors": [1, 2], "probability": found.place_probabilities[INFILL_12],
    }  # fmt: skip
    assert len(record["hypotheses"]) == len(found.places)
    assert sum(row["probability"] for row in record["hypotheses"]) == pytest.approx(1.0)
    assert [row["name"] for row in record["averaged_parameters"]] == ["k1", "k2", "k3"]


def test_progress_and_seed_reach_the_sampling(bare, monkeypatch, make_posterior):
    calls = []

    def sample_all(candidates, seed, settings, progress, pool, checkpoint):
        calls.append((seed, settings, pool, checkpoint))
        progress(candidates[0].name, "evidence", 1.0)
        return [make_posterior(c.name, names=c.parameter_names) for c in candidates]

    monkeypatch.setattr("bayes_ssi.search.sample_all", sample_all)
    said = []
    found = search(bare, ONE, 5, COARSE, lambda *what: said.append(what), checkpoint="there")
    assert calls == [(5, COARSE, None, "there")]
    assert said == [("no appendage", "evidence", 1.0)]
    assert (found.ranking.seed, found.ranking.settings) == (5, COARSE)


# What it finds, sampled coarsely


@pytest.fixture(scope="module")
def found_in_case_c(request):
    """The search on the numerical study's data, sampled once."""
    k = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in (1, 2, 3)]
    one = (math.pi / math.sin(math.pi / 14.0)) ** 2
    frame = bs.ShearBuilding((1.0, 1.0, 1.0), [one * x for x in k])
    path = request.config.rootpath / "model_classes" / "data" / "case_c.csv"
    data = bs.ModalData.load(path)
    error = bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)
    return search(bs.ModelClass("bare", frame, data, error, pairing={}), ONE, settings=COARSE)


def test_the_hidden_infill_is_found_where_it_is(found_in_case_c):
    assert found_in_case_c.ranking.comparison.best.name == "infill 1-2"
    assert found_in_case_c.place_probabilities[INFILL_12] > 0.99
    assert found_in_case_c.probability_of_any > 0.99


def test_the_hidden_infill_has_its_mass_and_frequency(found_in_case_c):
    (infill,) = found_in_case_c.appendages("infill 1-2")
    low, _, high = infill.mass
    assert low < 0.075 < high
    assert infill.mass[1] == pytest.approx(0.075, abs=0.01)
    assert infill.frequency_hz[1] == pytest.approx(2.80, abs=0.03)


def test_the_pairing_of_the_best_hypothesis_is_the_right_one(found_in_case_c):
    (best,) = [p for p in found_in_case_c.ranking.posteriors if p.name == "infill 1-2"]
    assert list(best.pairing.values()) == [1, 2, 3, 4]


def test_a_bare_frame_hides_nothing(frame, fixed_error):
    stiffness = (math.pi / math.sin(math.pi / 14.0)) ** 2
    squares, shapes = np.linalg.eigh(
        stiffness * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    )
    frequencies = np.sqrt(squares) / (2.0 * math.pi)
    np.testing.assert_allclose(frequencies, [1.0, 2.80193774, 4.04891734], atol=1e-8)
    modes = [bs.IdentifiedMode(str(i), f, shapes[:, i]) for i, f in enumerate(frequencies)]
    data = bs.ModalData(tuple(modes), (0.0, 6.0), ("floor 1", "floor 2", "floor 3"))
    found = search(
        bs.ModelClass("bare", frame, data, fixed_error, pairing={}), ONE, settings=COARSE
    )
    assert found.ranking.comparison.best.name == "no appendage"
    assert found.probability_of_any < 0.2


def test_workers_do_not_change_a_bit(tiny_study, monkeypatch):
    monkeypatch.setattr("bayes_ssi.search.places_of", lambda _: (INFILL_01, INFILL_12))
    here, there = (
        search(tiny_study.model_classes[0], ONE, 3, COARSE, workers=workers)
        for workers in (None, 2)
    )
    assert [row.name for row in here.ranking.comparison.classes] == [
        row.name for row in there.ranking.comparison.classes
    ]
    for one, other in zip(here.ranking.posteriors, there.ranking.posteriors, strict=True):
        assert one.evidence == other.evidence
        assert one.draws.tobytes() == other.draws.tobytes()
        assert one.inferred_pairing == other.inferred_pairing
    assert here.averaged_parameters == there.averaged_parameters


# How it is shown


def lines(table, width=80):
    file = io.StringIO()
    Console(file=file, width=width).print(table)
    return [line.rstrip() for line in file.getvalue().splitlines()]


@pytest.fixture
def of_a_tall_building(fake_sampling):
    """Twenty storeys, masses in kg, two appendages: the longest names and numbers."""
    fake_sampling(
        lambda name: 10.0 * name.startswith("pendulum 20") + 9.0 * ("infill 19-20" in name) - 5.0
    )
    k = bs.Parameter("stiffness multiplier of all storeys", bs.LogNormal(1.0, 0.3))
    structure = bs.ShearBuilding((3.2e5,) * 20, [2.5e8 * k] * 20)
    data = bs.ModalData((bs.IdentifiedMode("1", 0.98),), (0.0, 6.0))
    return search(bs.ModelClass("tower", structure, data, bs.ErrorModel(0.01), pairing={}))


def test_tables_are_at_most_80_columns_wide(of_a_tall_building):
    for table in (search_table, averaged_table):
        assert max(map(len, lines(table(of_a_tall_building)))) <= 80
    assert max(map(len, search_notes(of_a_tall_building))) <= 80


def test_tables_do_not_break_the_names_of_places(of_a_tall_building):
    text = "\n".join(lines(search_table(of_a_tall_building)))
    for words in ("pendulum 20", "infill 19-20"):
        assert words in text


def test_tables_do_not_cut_numbers_off(of_a_tall_building):
    assert "…" not in "\n".join(lines(search_table(of_a_tall_building)))


def test_the_table_always_shows_no_appendage(of_a_tall_building):
    assert "no appendage" not in [
        row.name for row in of_a_tall_building.ranking.comparison.classes[:8]
    ]
    assert "-5.00" in "\n".join(lines(search_table(of_a_tall_building)))


def test_hypotheses_that_no_table_row_shows_are_counted(of_a_tall_building):
    """Eight by probability, and no appendage beside them."""
    n = len(of_a_tall_building.places)
    rows = of_a_tall_building.ranking.comparison.classes
    assert "no appendage" not in [row.name for row in rows[:8]]
    assert search_notes(of_a_tall_building)[-1].startswith(f"{n - 9} less probable hypotheses")


def test_notes_name_the_places_by_probability(found_in_case_c):
    notes = search_notes(found_in_case_c)
    assert notes[0] == "Probability that there is an appendage: > 0.9999. By place:"
    assert notes[1].startswith("  infill 1-2: ")
    assert len(notes) == 7


def test_the_figure_has_every_place_at_its_height(found_in_case_c):
    ax = plot_places(found_in_case_c, Figure().subplots())
    places = found_in_case_c.place_probabilities
    heights = sorted(float(c.get_offsets()[0][1]) for c in ax.collections)
    assert heights == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    said = {text.get_position(): text.get_text() for text in ax.texts}
    assert said[(0.2, 1.5)].replace("> ", "")[:3] in ("0.9", "1.0")
    assert len([text for text in said.values() if not text.startswith("floor")]) == len(places)


def test_the_figure_of_a_tall_building_is_written(of_a_tall_building, tmp_path):
    path = save_places(of_a_tall_building, tmp_path / "places.png")
    assert path.read_bytes().startswith(b"\x89PNG\r\n")


def test_figures_have_room_for_many_hypotheses(of_a_tall_building, tmp_path):
    ranking = of_a_tall_building.ranking
    by_name = {posterior.name: posterior for posterior in ranking.posteriors}
    ranked = [by_name[row.name] for row in ranking.comparison.classes][:40]
    data = ranking.study.model_classes[0].data
    assert len(save_figures(tmp_path / "figures", data, ranked, bs.compare(ranked))) == 3


# The command line


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Runs the command in an empty working directory, sampling coarsely."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    coarse = partial(bs.SamplingSettings, particles=60, searches=1, max_steps=400)
    monkeypatch.setattr("bayes_ssi.sampling.SamplingSettings", coarse)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


def assert_one_line_error(result, *words):
    assert result.exit_code == 2
    assert isinstance(result.exception, SystemExit), result.exception
    (line,) = result.stderr.splitlines()
    assert line.startswith("Error: ")
    for word in words:
        assert word in line


def test_search_saves_a_result(run, tiny_study_file, tmp_path, fake_sampling):
    levels = fake_sampling(by_count(0.0, 1.0, 2.0))
    out = tmp_path / "r"
    result = run("search", tiny_study_file, "--out", out, "--seed", 3)
    assert result.exit_code == 0, result.output
    assert len(levels) == 2
    for words in (
        "Appendages hidden in 'one k'",
        "no appendage",
        "naive mean",
        "Probability that there is an appendage",
        f"Saved in {out}, with 4 figures.",
    ):
        assert words in " ".join(result.stdout.split())
    record = json.loads((out / "search.json").read_text(encoding="utf-8"))
    assert len(record["hypotheses"]) == len(levels[0]) + len(levels[1])
    assert (out / "figures" / "places.png").read_bytes().startswith(b"\x89PNG\r\n")
    stored = load_result(out)
    assert stored.record["seed"] == 3
    assert len(stored.posteriors) == len(record["hypotheses"])


def test_where_a_search_goes_by_default(run, tiny_study_file, tmp_path, fake_sampling):
    fake_sampling(by_count(1.0, 0.0))
    assert run("search", tiny_study_file).exit_code == 0
    assert (tmp_path / "work" / "runs" / "results" / "tiny_search" / "search.json").is_file()


def test_the_baseline_is_chosen_by_name(run, tiny_study_file, tmp_path, fake_sampling):
    fake_sampling(by_count(1.0, 0.0))
    result = run("search", tiny_study_file, "--baseline", "each k", "--out", tmp_path / "r")
    assert "Appendages hidden in 'each k'" in result.stdout


def test_an_unknown_baseline_is_refused(run, tiny_study_file):
    result = run("search", tiny_study_file, "--baseline", "no k")
    assert_one_line_error(result, "no model class 'no k'", "'one k', 'each k'")


@pytest.mark.parametrize(("most", "n_levels"), [(1, 1), (2, 2), (3, 3)])
def test_the_largest_number_of_appendages(
    run, tiny_study_file, tmp_path, fake_sampling, most, n_levels
):
    levels = fake_sampling(by_count(0.0, 1.0, 2.0, 3.0, 4.0))
    assert run("search", tiny_study_file, "--most", most, "--out", tmp_path / "r").exit_code == 0
    assert len(levels) == n_levels


@pytest.mark.parametrize(
    "options",
    [("--most", 0), ("--mass-ratio", 0.0, 1.0), ("--frequency", 3.0, 1.0),
     ("--frequency", 0.0, 1.0), ("--error", -1.0)],
)  # fmt: skip
def test_bad_options_of_a_search_are_refused(run, tiny_study_file, options, fake_sampling):
    levels = fake_sampling(by_count(0.0, 0.0))
    assert_one_line_error(run("search", tiny_study_file, *options))
    assert levels == []


def test_priors_of_the_command_line_are_used(run, tiny_study_file, tmp_path, fake_sampling):
    fake_sampling(by_count(1.0, 0.0))
    arguments = ("--mass-ratio", 0.2, 0.5, "--frequency", 1.5, 2.5, "--out", tmp_path / "r")
    assert run("search", tiny_study_file, *arguments).exit_code == 0
    text = (tmp_path / "r" / "result.json").read_text(encoding="utf-8")
    classes = json.loads(text)["model_classes"]
    (one,) = [c for c in classes if c["name"] == "pendulum 1"]
    priors = {p["name"]: p["prior"] for p in one["parameters"]}
    assert priors["mass ratio, pendulum 1"] == bs.LogNormal(0.2, 0.5).as_dict()
    assert priors["frequency, pendulum 1"] == bs.LogUniform(1.5, 2.5).as_dict()


def test_a_stopped_search_goes_on_and_leaves_no_checkpoint(
    run, tiny_study_file, tmp_path, monkeypatch
):
    monkeypatch.setattr("bayes_ssi.search.places_of", lambda _: (INFILL_01,))
    out = tmp_path / "r"
    arguments = ("search", tiny_study_file, "--error", 0.5, "--accept-failed-checks", "--out", out)

    def stop(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("bayes_ssi.search.compare", stop)
        stopped = run(*arguments)
    assert stopped.exit_code == 1
    assert "the same command goes on from here" in stopped.stderr
    assert (tmp_path / ".r.checkpoint").is_dir()
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    assert "model class 'infill 0-1': continues after" in result.stderr
    assert not (tmp_path / ".r.checkpoint").exists()
    assert {p.name for p in load_result(out).posteriors} == {"no appendage", "infill 0-1"}


def test_a_failed_check_of_a_search_ends_with_3(run, tiny_study_file, tmp_path, monkeypatch):
    monkeypatch.setattr("bayes_ssi.search.places_of", lambda _: (INFILL_01,))
    monkeypatch.setattr("bayes_ssi.checks.R_HAT_LIMIT", 0.5)
    result = run("search", tiny_study_file, "--error", 0.5, "--out", tmp_path / "r")
    assert result.exit_code == 3
    assert "Checks that failed" in result.stdout
    assert (tmp_path / "r" / "search.json").is_file()


def test_rank_over_all_pairings(run, tiny_study_file, tmp_path):
    text = tiny_study_file.read_text(encoding="utf-8")
    old = "(K * k1, K * k2)), modes, error,\n                      pairing=pairing),"
    assert old in text
    new = '(K * k, K * k)), modes, error,\n                      pairing={"1": 2, "2": 1}),'
    tiny_study_file.write_text(text.replace(old, new), encoding="utf-8")
    result = run(
        "rank", tiny_study_file, "--any-pairing", "--accept-failed-checks", "--out", tmp_path / "r"
    )
    assert result.exit_code == 0, result.output
    assert "Modes of 'one k or each k':" in result.stdout
    assert "identified mode 1 is model mode 1 with probability" in result.stdout
    (posterior,) = load_result(tmp_path / "r").posteriors
    assert posterior.inferred_pairing.best == {"1": 1, "2": 2}
