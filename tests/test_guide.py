"""The guide's Python runs as it stands, page by page, and what it points to is there."""

import math
import re
from pathlib import Path

import pytest

import bayes_ssi
from bayes_ssi import plots

ROOT = Path(__file__).parent.parent
PAGES = sorted((Path(bayes_ssi.__file__).parent / "guide").glob("*.md"))


def blocks(page):
    return re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.DOTALL)


@pytest.fixture
def told(tmp_path, monkeypatch, capsys):
    """Runs a page in an empty directory; returns what it printed."""
    import matplotlib as mpl

    mpl.use("agg")
    monkeypatch.chdir(tmp_path)

    def run(name):
        namespace = {"__name__": "a_page"}
        for block in blocks(next(page for page in PAGES if page.stem == name)):
            exec(compile(block, name, "exec"), namespace)
        return capsys.readouterr().out

    return run


def test_there_are_pages_and_all_are_run():
    assert {page.stem for page in PAGES if blocks(page)} == {
        "concepts", "finite_elements", "plots_and_arviz", "reading_a_report", "your_own_structure",
    }  # fmt: skip


def test_concepts(told):
    first, second, refused = told("concepts").splitlines()
    assert first == "both modes 0.0 best"
    assert second.startswith("first mode only -")
    assert "explain different data" in refused


def test_a_structure_of_your_own(told):
    # (2π · 6.13 / 1.8751²)² = 120.0: the stiffness that gives the first frequency.
    assert float(told("your_own_structure")) == pytest.approx(120.0, rel=0.03)


def test_finite_elements(told):
    """The strip as a whole is a cantilever: (βL)² √(EI/(ρA L⁴))/2π, β_1 L = 1.8751."""
    lines = told("finite_elements").splitlines()
    size, first = re.match(r"(\d+) \[\s*([\d.]+)", lines[0]).groups()
    root = math.sqrt(210e9 * 0.01**2 / 12.0 / (7850.0 * 2.0**4))
    assert int(size) == 400
    assert float(first) == pytest.approx(1.8751041**2 * root / (2.0 * math.pi), abs=0.01)
    for line, name, true in zip(
        lines[1:], ("modulus", "upper thickness"), (0.9, 1.1), strict=False
    ):
        mean, sd = map(float, line.removeprefix(f"{name}: ").split(" ± "))
        assert mean == pytest.approx(true, abs=2.0 * sd)
    assert re.match(r"400 degrees of freedom reduced to \d+ by \d full solutions", lines[3])
    assert lines[4].startswith("confirmed by 16 full solutions")
    n_evaluations, *_, ground, _, link = lines[5].split()
    assert int(n_evaluations) < 3000
    assert float(ground) == pytest.approx(1.1, abs=0.02)
    assert float(link) == pytest.approx(0.9, abs=0.02)


def test_reading_a_report(told):
    assert told("reading_a_report").strip().endswith("report.html")
    assert Path("result/report/report.html").is_file()


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::UserWarning")
def test_plots_and_arviz(told):
    summary = told("plots_and_arviz")
    assert re.search(r"^k1 ", summary, re.M)
    assert re.search(r"^k2 ", summary, re.M)


def test_every_plot_has_an_example():
    page = next(page for page in PAGES if page.stem == "plots_and_arviz").read_text("utf-8")
    names = [name for name in plots.__all__ if name.startswith("plot_")]
    assert len(names) >= 15
    missing = [name for name in names if f"plots.{name}(" not in page]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_points_to_is_there(page):
    text = page.read_text("utf-8")
    for link in re.findall(r"\]\((\w+\.md)\)", text):
        assert (page.parent / link).is_file()
    for path in re.findall(
        r"(?:python|pytest|rank|search) ((?:runs|tests|model_classes)/\S+\.py)", text
    ):
        assert (ROOT / path).is_file(), path
