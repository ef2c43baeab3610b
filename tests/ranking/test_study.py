"""Studies: what they accept, their files and lines at fault, ranking, averaged parameters."""

import json
import math
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from conftest import assert_refused
from searches import COARSE, screened

import bayes_ssi as bs
from bayes_ssi.inference.workers.workers import evaluate
from bayes_ssi.studies.ranking.study import averaged_parameters, load_study


def test_only_keeps_the_order_of_the_study(model_classes):
    weights = {"1-a": 1.0, "1-b": 2.0, "2": 3.0, "3": 4.0}
    study = bs.Study("s", model_classes.values(), prior_weights=weights, description="why")
    assert study.names == ("1-a", "1-b", "2", "3")
    part = study.only(["3", "1-b"])
    assert part.names == ("1-b", "3")
    assert part.prior_weights == {"1-b": 2.0, "3": 4.0}
    assert (part.name, part.description) == ("s", "why")
    assert bs.Study("s", model_classes.values()).only(["2"]).prior_weights is None
    with pytest.raises(ValueError, match="study 's': no model class '4'; choose from '1-a', '1-b'"):
        study.only(["3", "4"])


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda _: [], ValueError, "study 's': no model class"),
        (lambda c: [c["3"], c["2"], c["3"]], ValueError, "two model classes are named '3'"),
        (lambda c: [c["3"], "2"], TypeError, "study 's': '2' is not a ModelClass"),
    ],
)
def test_studies_that_make_no_sense_are_refused(model_classes, make, error, message):
    with pytest.raises(error, match=message):
        bs.Study("s", make(model_classes))


@pytest.mark.parametrize(
    ("weights", "other_data", "message"),
    [
        ({"1-a": 1.0}, False, "prior weight"),
        (None, True, "study 's': model classes '1-a' and 'other' explain diff"),
    ],
)
def test_what_cannot_be_compared_is_refused_before_anything_is_sampled(
    model_classes, weights, other_data, message
):
    first, second = model_classes["1-a"], model_classes["1-b"]
    if other_data:
        second = replace(second, name="other", data=second.data.without_shapes())
    run = bs.Run(progress=lambda *_: pytest.fail("sampling begins"))
    with pytest.raises(ValueError, match=message):
        bs.rank(bs.Study("s", [first, second], prior_weights=weights), run=run)


def test_rank(tiny_ranking, tiny_study):
    assert tiny_ranking.study is tiny_study
    assert tiny_ranking.seed == 7
    assert tiny_ranking.settings == bs.SamplingSettings()
    assert [posterior.name for posterior in tiny_ranking.posteriors] == ["one k", "each k"]
    comparison = tiny_ranking.comparison
    assert {row.name for row in comparison.classes} == {"one k", "each k"}
    for posterior in tiny_ranking.posteriors:
        (row,) = [row for row in comparison.classes if row.name == posterior.name]
        assert row.log_evidence == posterior.evidence.log_evidence
        assert posterior.failed_checks == ()


def test_a_class_does_not_depend_on_the_others(tiny_ranking, tiny_study):
    alone = bs.rank(tiny_study.only(["each k"]), seed=7).posteriors[0]
    among_others = tiny_ranking.posteriors[1]
    assert alone.evidence == among_others.evidence
    assert (alone.draws == among_others.draws).all()


def test_settings_reach_the_sampling(tiny_study):
    settings = bs.SamplingSettings(max_steps=20)
    ranking = bs.rank(tiny_study.only(["one k"]), settings=settings)
    posterior = ranking.posteriors[0]
    assert posterior.draws.shape[1] + posterior.burn_in == 20
    assert ranking.settings is settings


@pytest.mark.usefixtures("screening_for_appendages")
def test_progress_names_class_and_step(tiny_study, monkeypatch):
    def screen(hypothesis, target, seed, effort):
        del target, seed, effort
        return screened(hypothesis[0], 0.0)

    monkeypatch.setattr("bayes_ssi.studies.search.approximate_evidence._screened", screen)
    seen = []
    bs.rank(tiny_study, settings=COARSE, run=bs.Run(progress=lambda *call: seen.append(call)))
    # Last, whether an appendage on the most probable class explains the data as well.
    assert list(dict.fromkeys(name for name, _, _ in seen)) == ["one k", "each k", "all hypotheses"]
    assert [call for call in seen if call[0] == "each k"][-1] == ("each k", "evidence", 1.0)
    assert seen[-1][2] == pytest.approx(1.0)


# Parameters averaged over model classes


def draws(seed, centre, n):
    return np.array(centre) * np.exp(0.3 * np.random.default_rng(seed).standard_normal((4, 250, n)))


@pytest.fixture
def three(make_posterior):
    """Classes with probabilities 1/6, 2/6 and 3/6; b is in all, a and c in two, d in one."""
    return [
        make_posterior("A", math.log(1.0), names="ab", draws=draws(1, [1.0, 2.0], 2)),
        make_posterior("B", math.log(2.0), names="cba", draws=draws(2, [5.0, 3.0, 1.5], 3)),
        make_posterior("C", math.log(3.0), names="bcd", draws=draws(3, [2.5, 4.0, 9.0], 3)),
    ]


def test_averages_are_those_of_the_mixture_of_the_classes_that_infer_it(three):
    averages = averaged_parameters(three, bs.compare(three))
    assert [(row.name, row.n_classes) for row in averages] == [("a", 2), ("b", 3), ("c", 2)]
    shares = {"a": {"A": 1 / 3, "B": 2 / 3}, "b": {"A": 1 / 6, "B": 2 / 6, "C": 3 / 6},
              "c": {"B": 2 / 5, "C": 3 / 5}}  # fmt: skip
    assert [row.probability for row in averages] == pytest.approx([1 / 2, 1.0, 5 / 6])
    for row in averages:
        own = {p.name: p.values[:, p.parameter_names.index(row.name)] for p in three
               if row.name in p.parameter_names}  # fmt: skip
        x = np.concatenate(list(own.values()))
        w = np.concatenate([np.full(1000, shares[row.name][name] / 1000) for name in own])
        assert row.mean == pytest.approx(w @ x, rel=1e-12)
        assert row.sd == pytest.approx(math.sqrt(w @ (x - w @ x) ** 2), rel=1e-12)
        # Weights of so many equal draws add up to just 5 %: the lower draw, whatever the rounding.
        levels = np.multiply([0.05, 0.95], 1.0 - 1e-12)
        expected = np.quantile(x, levels, weights=w, method="inverted_cdf")
        assert (row.quantile_05, row.quantile_95) == pytest.approx(tuple(expected), rel=1e-3)


def test_a_class_of_all_the_probability_is_the_average(make_posterior):
    one = make_posterior("A", 0.0, names="a", draws=draws(4, [1.0], 1))
    other = make_posterior("B", -900.0, names="a", draws=draws(5, [9.0], 1))
    (average,) = averaged_parameters([one, other], bs.compare([one, other]))
    assert average.mean == pytest.approx(one.values.mean(), rel=1e-12)
    assert average.n_classes == 2
    # What only impossible classes share is left out.
    three = one, *(replace(other, name=name, parameter_names=("b",)) for name in "BC")
    assert averaged_parameters(three, bs.compare(three)) == ()


@pytest.mark.usefixtures("coarse_command")
def test_ranking_shows_and_saves_the_averages(run, tiny_study_file, tmp_path):
    text = tiny_study_file.read_text(encoding="utf-8")
    tiny_study_file.write_text(text.replace('"k1"', '"k"'), encoding="utf-8")
    done = run("rank", tiny_study_file, "--out", tmp_path / "r", "--accept-failed-checks",
               "--verbose")  # fmt: skip
    assert "Parameters averaged over the model classes that infer them" in done.stdout
    rows = json.loads((tmp_path / "r" / "averaged_parameters.json").read_text(encoding="utf-8"))
    assert [(row["name"], row["n_classes"]) for row in rows] == [("k", 2)]


def test_loading_a_file_writes_none(tiny_study_file):
    before = sys.dont_write_bytecode
    study = load_study(tiny_study_file)
    assert (study.name, study.names) == ("Two storeys", ("one k", "each k"))
    assert load_study(str(tiny_study_file)).names == study.names
    assert list(tiny_study_file.parent.iterdir()) == [tiny_study_file]
    assert sys.dont_write_bytecode == before


def test_a_study_may_define_dataclasses(tiny_study_file):
    text = tiny_study_file.read_text()
    head = "from __future__ import annotations\nfrom dataclasses import dataclass\n"
    tiny_study_file.write_text(head + text + "\n@dataclass\nclass Storey:\n    height: float\n")
    assert load_study(tiny_study_file).name == "Two storeys"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("s.py", None, "no such file"),
        ("s.txt", b"study = 1", r"a study is a Python file, its name ending in \.py"),
        ("s.py", b"", "defines no study; end it with a line such as study = "),
        ("s.py", b"x = 1\ndef (", r"line 2: not Python: "),
        ("s.py", b"x = '\xff'", "not Python"),
        ("s.py", b"x = 1\0", "null bytes"),
        ("s.py", b"x = 1\n\n1 / 0\n", "line 3: ZeroDivisionError: division by zero"),
        ("s.py", b"raise SystemExit('a\\nb')", "line 1: SystemExit: a b"),
        ("s.py", b"raise BaseException('odd')", "line 1: BaseException: odd"),
        ("s.py", b"import no_such_module", "line 1: ModuleNotFoundError: No module named"),
        ("s.py", b"raise ImportError('none', name='skfem.helpers')",
         r'ImportError: none; pip install "bayes_ssi\[fem\]"'),
    ],
)  # fmt: skip
def test_files_that_are_no_study_are_refused_in_one_line(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as caught:
        load_study(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_two_studies_in_one_file_are_refused_by_their_names(tiny_study_file):
    with tiny_study_file.open("a") as file:
        file.write("alias = study\n")
    assert load_study(tiny_study_file).name == "Two storeys"  # of two names
    with tiny_study_file.open("a") as file:
        file.write("another = study.only(['one k'])\n")
    assert_refused("defines several studies, study, another; keep one", load_study, tiny_study_file)


def test_errors_name_the_line_of_the_file(tiny_study_file):
    with tiny_study_file.open("a") as file:
        file.write("bs.LogNormal(median=1.0,\n            cov=-1.0)\n")
    n_lines = len(tiny_study_file.read_text().splitlines())
    message = rf"line ({n_lines - 1}|{n_lines}): ValueError: LogNormal: cov must be positive"
    assert_refused(message, load_study, tiny_study_file)


@pytest.mark.parametrize(
    ("helper", "study", "message"),
    [
        # Errors of constructors, also of a path that is relative.
        ("", "import bayes_ssi as bs\n\nbs.Sensor('', {})\n", "line 3: ValueError: Sensor: label"),
        ("def half(x):\n    return x / 0\n", "import helper_of_study\n\nhelper_of_study.half(1)\n",
         r"line 3: helper_of_study\.py, line 2: ZeroDivisionError: division by zero"),
        ("x = 1\nx = 1 / 0\n", "\nimport helper_of_study\n",
         r"line 2: helper_of_study\.py, line 2: ZeroDivisionError"),
        # What is not Python is the helper, and what is not UTF-8 is a file that the study reads.
        ("x = 1\nx = (\n", "\nimport helper_of_study\n",
         r"line 2: SyntaxError: .*\(helper_of_study\.py, line 2\)"),
        ("", "x = 1\nb'\\xff'.decode()\n", "line 2: UnicodeDecodeError: 'utf-8' codec"),
    ],
)  # fmt: skip
def test_errors_name_the_lines_of_the_study_and_of_what_it_calls(
    tmp_path, monkeypatch, helper, study, message
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "helper_of_study.py").write_text(helper)
    (tmp_path / "s.py").write_text(study)
    sys.modules.pop("helper_of_study", None)
    assert_refused(rf"^s\.py: {message}", load_study, "s.py")


def test_errors_of_a_function_that_is_called_later_have_their_line(tmp_path):
    path = tmp_path / "s.py"
    path.write_text("""import bayes_ssi as bs
k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
def modes(k):
    return [1.0], 1 / 0
structure = bs.FunctionStructure(modes, {"k": k}, n_modes=1)
data = bs.ModalData((bs.IdentifiedMode("1", 1.0),), (0.0, 2.0))
study = bs.Study("s", [bs.ModelClass("c", structure, data, pairing={"1": 1})])
""")
    (candidate,) = load_study(path).model_classes
    place = r"at k = 1: ZeroDivisionError: division by zero \(s\.py, line 4\)$"
    assert_refused(place, candidate.check_structure)
    assert re.search(place, evaluate(candidate.log_likelihood_at, np.zeros((1, 3))).failures[0])
