"""Reports: all that is stored is reported, from records alone; and the script of pages."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from importlib.resources import files
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import assert_one_line_error
from html_page import Page, of_two_storeys, page_of
from matplotlib.figure import Figure

import bayes_ssi as bs
from bayes_ssi.inference.criticism.adequacy import misfit_text
from bayes_ssi.plots.figure_style import style
from bayes_ssi.report import page_content as texts
from bayes_ssi.report.page_content import interval, percent
from bayes_ssi.report.report_figures import _drawn_classes, _of_most_interest, embedded_file
from bayes_ssi.report.tables.layout import number
from bayes_ssi.results.result_files import write_json
from bayes_ssi.studies.ranking.comparison import Check


@pytest.fixture(scope="module")
def reported(tiny_ranking, tmp_path_factory):
    """A report of the tiny study, with predictions."""
    directory = tmp_path_factory.mktemp("r") / "result"
    bs.save_result(tiny_ranking, directory, study_file="tiny.py",
                command="bayes-ssi rank tiny.py --seed 7")  # fmt: skip
    predictions = directory / "predictions"
    predictions.mkdir()
    record = {"predictions_of": ["average"], "draws": 500, "configuration": "", "damping": 0.02}
    write_json(predictions / "predictions.json", record)
    (predictions / "peaks.csv").write_text("model_class,place,median\naverage,floor 2,3.25\n")
    return bs.write_report(directory)


@pytest.fixture(scope="module")
def page(reported):
    return Page(reported.read_text(encoding="utf-8"))


def test_the_page_is_whole_and_needs_nothing_else(reported, page):
    assert len(page.ids) == len(set(page.ids)), "identities are unique"
    for address in page.addresses:
        assert address.startswith(("#", "data:image/png;base64,")), address
        if address.startswith("#"):
            assert address[1:] in page.ids
    text = reported.read_text(encoding="utf-8")
    assert 'data-tip="one k: log evidence' in text
    # Evidences; identified modes and frequencies; shapes of two classes, joint densities of one.
    assert text.count("<figure ") == 6
    assert "http://www.w3.org" in text  # names of XML, which nothing fetches
    assert not re.findall(r"(?:src|@import|url\()\s*=?\s*[\"']?https?:", text)


def test_the_page_holds_what_is_stored(page, tiny_ranking):
    best = tiny_ranking.comparison.best
    shown = page.text
    assert "One stiffness or two?" in shown
    for row in tiny_ranking.comparison.classes:
        assert f"{row.log_evidence:.3f} ± {row.error:.3f}" in shown
        assert row.probability_text in shown
    for parameter in next(p for p in tiny_ranking.posteriors if p.name == best.name).summary:
        ends = f"{parameter.median:.4g} ({parameter.quantile_05:.4g} to {parameter.quantile_95:.4g}"
        assert ends in shown
    # Quantiles of a lognormal of median 1 and c.o.v. 0.3: exp(±1.645 √ln 1.09).
    assert "1 (0.617 to 1.62)" in shown
    for words in ("LogNormal(median=1.0, cov=0.3)", "bayes-ssi rank tiny.py --seed 7",
                  "0.618", "two-storey building", tiny_ranking.comparison.data_digest,
                  "floor 2 3.25", "All checks passed",
                  f"yes ({misfit_text(tiny_ranking.comparison.best.misfit_sds)})",
                  f"numpy {np.__version__}"):  # fmt: skip
        assert words in shown, words


def test_modes_before_and_after_are_those_of_the_structure(page, tiny_ranking):
    """At the prior medians the tiny building has the identified modes: no error, MAC 1."""
    rows = [row[5:] for row in page.rows if row[:5] == ["2", "1.618", "2", "1.618", "0.0 %"]]
    assert len(rows) == 2
    posteriors = {posterior.name: posterior for posterior in tiny_ranking.posteriors}
    ranked = tiny_ranking.comparison.classes
    for best_first, (after, _, mac_before, _, misfit) in zip(ranked, rows, strict=True):
        posterior = posteriors[best_first.name]
        assert misfit == f"{posterior.adequacy.modes[1].misfit.sds:.1f} sd"
        median = np.median(posterior.frequencies_hz[..., 1])
        assert float(after.split()[0]) == pytest.approx(median, rel=2e-3)
        assert mac_before == "1.0000"


def test_the_same_result_gives_the_same_report(reported, tmp_path):
    again = bs.write_report(reported.parent.parent, tmp_path / "again")
    assert again.read_text("utf-8") == reported.read_text("utf-8")


def test_a_report_is_not_overwritten_unless_asked(run, reported, tmp_path):
    result = reported.parent.parent
    before = reported.read_bytes()
    assert_one_line_error(run("report", result), "exists already", "--overwrite")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    refused = run("report", result, "--out", tmp_path / "mine", "--overwrite")
    assert_one_line_error(refused, "is not overwritten")
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "years of work"
    assert reported.read_bytes() == before


@pytest.mark.usefixtures("no_drawings")
@pytest.mark.parametrize(
    ("file", "content", "words"),
    [
        ("result.json", '{"format": 2}', "a result of format 2, this version reads"),
        ("predictions/predictions.json", "{}", "predictions.json: damaged: no configuration"),
    ],
)
def test_a_damaged_result_is_one_line(run, reported, tmp_path, file, content, words):
    copy = tmp_path / "copy"
    shutil.copytree(reported.parent.parent, copy, ignore=shutil.ignore_patterns("report"))
    (copy / file).write_text(content)
    assert_one_line_error(run("report", copy), str(copy), words)
    assert not (copy / "report").exists()


def two_classes(make_posterior, **changes):
    """A ranking of two classes of equal evidence, whose names hold markup."""
    modes = (bs.IdentifiedMode("a|b", 1.0), bs.IdentifiedMode("2", 2.0))
    data = bs.ModalData(modes, (0.0, 3.0), source="<b>x</b>")
    pairings = {name: {"a|b": 1} for name in ("<script>alert(1)</script>", "b*c_d")}
    return of_two_storeys(make_posterior, data, (1.0, 1.2), pairings, "k<1>", **changes)


@pytest.mark.usefixtures("no_drawings")
def test_classes_that_are_not_distinguishable_and_their_remarks(make_posterior, tmp_path):
    """Remarks on samples, as of the error of a reduced model, and on settings are no failures."""
    remark = "2302 degrees of freedom reduced to 93 by 19 full solutions"
    ranking = two_classes(make_posterior, remarks=(remark,))
    first, *others = ranking.comparison.classes
    setting = Check("setting", "the band's end hardly matters", fails=False)
    comparison = replace(ranking.comparison, classes=(replace(first, checks=(setting,)), *others))
    page = page_of(replace(ranking, comparison=comparison), tmp_path / "r")
    shown = page.text
    assert "the data do not distinguish between class 'b*c_d' (probability 0.5498) and" in shown
    assert "2 counts as spurious" in shown
    assert "is the most probable" not in shown
    assert f"{first.name}: {remark}." in shown
    assert "All checks passed" in shown
    assert shown.index("What does not change the answer") > shown.index("Model classes")
    assert f"{first.name!r}: the band's end hardly matters" in shown
    # Names are no markup.
    assert "<script>alert" not in page.source
    assert "<b>x</b>" not in page.source
    assert "k<1>" in shown


@pytest.mark.usefixtures("no_drawings")
def test_failed_checks_stand_at_the_top(make_posterior, tmp_path):
    ranking = two_classes(make_posterior, failed_checks=("the ensembles differ",))
    shown = page_of(ranking, tmp_path / "r").text
    assert "2 checks failed. Do not trust the ranking" in shown
    assert shown.index("'b*c_d': the ensembles differ") < shown.index("Ranking")
    assert "All checks passed" not in shown


@pytest.mark.usefixtures("no_drawings")
def test_the_findings_of_a_search(found_in_case_c, tmp_path):
    study = replace(found_in_case_c.ranking.study, mass_unit="kg")
    ranking = replace(found_in_case_c.ranking, study=study)
    record = replace(found_in_case_c.record, mass_unit="kg")
    shown = page_of(ranking, tmp_path / "r", extra={"search.json": record}).text
    assert "That there is an appendage is virtually certain: the probability of at least" in shown
    best = found_in_case_c.ranking.comparison.best
    (appendage,) = found_in_case_c.record.hypothesis(best.name).features
    assert interval(appendage.amounts["frequency_hz"], 3) in shown
    assert interval(appendage.amounts["mass_ratio"], 2) in shown
    assert interval(appendage.amounts["mass"], 3) in shown
    assert "vibrating mass (kg)" in shown
    assert "Masses of structures are in kg, stiffnesses in N/m, lengths in m." in shown


def test_the_map_of_a_search_stands_next_to_the_answer(found_in_case_c, tmp_path, monkeypatch):
    drawn = "bayes_ssi.report.report_figures._drawn_classes"
    monkeypatch.setattr(drawn, lambda stored: [(stored.comparison.best.name, False)])
    page = page_of(found_in_case_c, tmp_path / "r")
    answer, rest = page.source.split('<nav aria-label="Sections">')
    assert 'aria-label="Probability of an appendage by place, over all hypotheses"' in answer
    assert 'data-tip="infill 1-2: probability' in answer
    assert "Probability of an appendage by place, over all hypotheses" not in rest


def test_a_saved_figure_is_shown_at_its_size(tmp_path):
    with style():
        Figure(figsize=(2.5, 1.0)).savefig(tmp_path / "drawn.png")
    assert 'width="240"' in embedded_file(tmp_path / "drawn.png", "a figure").html
    (tmp_path / "drawn.png").write_bytes(b"\x89PNG")
    with pytest.raises(ValueError, match=r"drawn\.png: damaged: not a PNG file"):
        embedded_file(tmp_path / "drawn.png", "a figure")


def test_columns_settings_and_numbers_as_they_are_written():
    assert texts.heading("identified_hz") == "identified (Hz)"
    assert list(map(texts.of_numbers, ("low", "before_hz", "mode"))) == [True, True, False]
    assert texts.settings(bs.SamplingSettings()).startswith("log evidence error 0.01, searches 4, ")
    assert number(None) == number(float("nan")) == interval(None) == percent(None) == "-"
    assert number(-0.001, ".2f") == "0.00"
    assert interval((1.0, 2.0, 3.0)) == "2 (1 to 3)"
    assert percent(0.0125) == "1.25 %"
    assert texts.error_percent(0.9, 1.0) == "-10.0 %"
    assert texts.error_percent(0.99999, 1.0) == "0.0 %"


PAGE = """
const listen = { addEventListener(kind, act) { this[kind] = act; } };
const cell = ([text, value]) => ({ textContent: text, getAttribute: () => value });
const head = () => ({
  given: {}, firstChild: null,
  appendChild(button) { this.button = button; },
  getAttribute(name) { return this.given[name] ?? null; },
  setAttribute(name, value) { this.given[name] = value; },
  removeAttribute(name) { delete this.given[name]; },
});
const heads = [head(), head()];
const body = {
  rows: ROWS.map((row) => ({ cells: row.map(cell) })),
  appendChild(row) { this.rows = this.rows.filter((each) => each !== row).concat(row); },
};
const scroll = (width) => ({
  scrollWidth: width, clientWidth: 361, classList: { toggle(name, on) { this[name] = on; } },
});
const folds = [true, false].map((first) => ({ ...listen, hasAttribute: () => first, open: true }));
const wide = [361, 362, 571].map(scroll);
const found = {
  "table.sortable": [{ tHead: { rows: [{ cells: heads }] }, tBodies: [body] }],
  "details.fold": folds, "details": folds, ".scroll": wide,
};
const document = {
  ...listen, documentElement: { classList: { add() {} } },
  querySelectorAll: (selector) => found[selector] ?? [],
  createElement: () => ({ ...listen }), getElementById: () => ({ style: {} }),
};
const window = { ...listen };
const location = { hash: "" };
"""
REPORTED = """
const shown = () => body.rows.map((row) => row.cells[0].textContent);
const orders = [0, 0, 1, 1].map((column) => { heads[column].button.click(); return shown(); });
const open = () => folds.map((each) => each.open);
const states = [open()];
for (const kind of ["beforeprint", "afterprint"]) { handlers[kind](); states.push(open()); }
console.log(JSON.stringify([orders, heads.map((each) => each.given), states,
                            wide.map((each) => each.classList.cut)]));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js")
def test_tables_are_sorted_classes_fold_and_cut_tables_are_marked():
    rows = [
        (("class 2", None), ("0.5", "0.5")),
        (("class 10", None), ("< 0.0001", "1e-9")),
        (("class 1", None), ("-", "nan")),
        (("class 3", None), ("0.0400", "0.04")),
    ]
    script = (files("bayes_ssi") / "report/templates/script.js").read_text("utf-8")
    # One window listens to several events.
    handlers = "const handlers = {}; window.addEventListener = (k, act) => { handlers[k] = act; };"
    program = f"const ROWS = {json.dumps(rows)};{PAGE}{handlers}{script}{REPORTED}"
    done = subprocess.run(
        ["node", "-e", program], capture_output=True, text=True, timeout=60, check=True
    )
    orders, given, states, cut = json.loads(done.stdout)
    # Words by the numbers in them; numbers by their values, a missing one as if it were largest.
    by_name = [f"class {i}" for i in (1, 2, 3, 10)]
    by_value = [f"class {i}" for i in (10, 3, 2, 1)]
    assert orders == [by_name, by_name[::-1], by_value, by_value[::-1]]
    assert given == [{}, {"aria-sort": "descending"}]
    # The best class is open on the screen, and every class on paper.
    assert states == [[True, False], [True, True], [True, False]]
    # A pixel is rounding.
    assert cut == [False, False, True]


def test_parameters_of_features_come_before_those_of_baselines():
    """Six of eight in a figure: both of the feature, then the four least spread, in their order."""
    names = ("a", "b", "mass", "c", "d", "e", "f", "frequency")
    spreads = (0.1, 0.2, 0.9, 0.3, 0.4, 0.5, 0.6, 0.8)
    posterior = SimpleNamespace(parameter_names=names, relative_spreads=spreads)
    search = SimpleNamespace(averaged_parameters=[SimpleNamespace(name=one) for one in "abcdef"])
    assert _of_most_interest(posterior, search) == ["a", "b", "mass", "c", "d", "frequency"]
    assert _of_most_interest(posterior, None) == ["a", "b", "c", "d", "e", "f"]


@pytest.mark.parametrize(("tests", "drawn"), [(("",), ["a", "b"]), (("one", "two"), ["a"])])
def test_the_runner_up_is_drawn_though_improbable_where_there_is_one_test(tests, drawn):
    rows = [SimpleNamespace(name=n, probability=n == "a", distinguishable=True) for n in "abc"]
    stored = SimpleNamespace(tests=tests, comparison=SimpleNamespace(classes=rows))
    assert list(_drawn_classes(stored)) == [(name, name == "a") for name in drawn]
