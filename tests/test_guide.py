"""The guide builds without a warning, and its code runs, chapter by chapter."""

import math
import re
import subprocess
import sys
from dataclasses import replace
from functools import partial
from html import unescape

import click
import numpy as np
import pytest
from click.testing import CliRunner
from code_blocks import CHAPTERS, PAGES, ROOT, blocks, commands, run_page
from conftest import COARSE, succeeded

import bayes_ssi as bs
from bayes_ssi import plots
from bayes_ssi.cli import main
from bayes_ssi.structures.elements import Element

GUIDE = ROOT / "bayes_ssi" / "guide"
WITH_CODE = [page for page in CHAPTERS if {b.language for b in blocks(page)} & {"python", "sh"}]


@pytest.fixture
def printed(tmp_path, monkeypatch, capsys):
    """Runs a chapter next to the repository's studies; returns its output."""
    monkeypatch.chdir(tmp_path)
    for folder in ("model_classes", "runs"):
        (tmp_path / folder).mkdir()
    for source in (ROOT / "model_classes").iterdir():
        (tmp_path / "model_classes" / source.name).symlink_to(source)
    for sampled in (bs.rank, bs.sample):
        monkeypatch.setattr(bs, sampled.__name__, partial(sampled, settings=COARSE), raising=False)

    def coarse(error=COARSE.log_evidence_error, **given):
        return replace(COARSE, **{"log_evidence_error": error, **given})

    monkeypatch.setattr(bs, "SamplingSettings", coarse, raising=False)

    def run(page):
        run_page(page)
        return capsys.readouterr().out

    return run


def check_concepts(printed):
    first, second, refused = printed.splitlines()
    assert first == "both modes 0.0 best"
    assert second.startswith("first mode only -")
    assert "explain different data" in refused


def check_your_own_structure(printed):
    elements, floor, shapes, stiffness = printed.splitlines()
    text = (GUIDE / "your_own_structure.md").read_text("utf-8")
    assert f"# {elements}\n" in text
    assert f"# {shapes}\n" in text
    assert "pendulum" in floor
    # (2π · 6.13 / 1.8751²)² = 120.0: the stiffness that gives the first frequency.
    assert float(stiffness) == pytest.approx(120.0, rel=0.03)


def check_finite_elements(printed):
    """The strip as a whole is a cantilever: (βL)² √(EI/(ρA L⁴))/2π, β_1 L = 1.8751."""
    lines = printed.splitlines()
    size, first = re.match(r"(\d+) \[\s*([\d.]+)", lines[0]).groups()
    root = math.sqrt(210e9 * 0.01**2 / 12.0 / (7850.0 * 2.0**4))
    assert int(size) == 400
    assert float(first) == pytest.approx(1.8751041**2 * root / (2.0 * math.pi), abs=0.01)
    for line, name, true in zip(
        lines[2:4], ("modulus", "upper thickness"), (0.9, 1.1), strict=True
    ):
        mean, sd = map(float, line.removeprefix(f"{name}: ").split(" ± "))
        assert mean == pytest.approx(true, abs=2.0 * sd)
    assert float(lines[6].removeprefix("largest error ")) < 1e-5
    n_evaluations, *_, ground, _, link = lines[7].split()
    assert int(n_evaluations) < 3000
    assert float(ground) == pytest.approx(1.1, abs=0.02)
    assert float(link) == pytest.approx(0.9, abs=0.02)


def check_solver_files(printed):
    """Three storeys of 500 kg: the eigenvalues of their matrices; the walls were weaker."""
    lines = printed.splitlines()
    assert lines[0] == "CalculiX matrix storage: 3 degrees of freedom, N, m, kg"
    assert "mass that moves, in kg: 1500 in x" in lines
    k = 1e3 * np.array([[3600.0, -1800.0, 0.0], [-1800.0, 3000.0, -1200.0], [0.0, -1200.0, 1200.0]])
    expected = np.sqrt(np.linalg.eigvalsh(k) / 500.0) / (2.0 * math.pi)
    shown = next(line for line in lines if line.startswith("["))
    assert [float(each) for each in shown.strip("[]").split()] == pytest.approx(expected, abs=6e-4)
    text = (GUIDE / "solver_files.md").read_text("utf-8")
    for line in ("K = columns K_columns + walls K_walls", "M = M_0"):
        assert line in lines
        assert f"{line}\n" in text
    assert "Wrote parameters, and 3 modes at 3 nodes, to runs/results/frame/updated." in lines
    assert any(re.fullmatch(r"both.sti: predicted to \d\.\de-1[5-9]", line) for line in lines)
    # Emulated from runs, and by the matrices: errors of coarse sampling are in both.
    for pair in re.findall(r"^ln evidence (\S+) (\S+)$", printed, re.M):
        assert float(pair[0]) == pytest.approx(float(pair[1]), abs=0.3)
    apart = re.findall(r"^\w+: .* ± .* ± \S+ (-?[\d.]+)$", printed, re.M)
    assert len(apart) == 6 + 4
    assert max(abs(float(each)) for each in apart) < 0.5


def check_plots_and_arviz(printed):
    assert re.search(r"^k1 ", printed, re.M)
    assert re.search(r"^k2 ", printed, re.M)
    (first, more), (second, less) = re.findall(r"^(alike|unlike) .* (-?\d+\.\d+)$", printed, re.M)
    assert (first, second) == ("alike", "unlike"), "as leaving modes out ranks them"
    assert float(more) - float(less) == pytest.approx(1.1, abs=0.3), "log evidences"


def check_for_contributors(printed):
    """The median is 2 ln 2, the frequency √40/2π; the frequencies are made with a mass of 0.5."""
    prior, element, check, plot, form, family = printed.splitlines()
    assert float(prior.split()[1]) == pytest.approx(2.0 * math.log(2.0), abs=1e-4)
    assert float(element.split()[1]) == pytest.approx(math.sqrt(40.0) / math.tau, abs=1e-4)
    assert (check, plot) == ("check fewer than three modes were identified", "plot 1")
    assert form == "format (2, 3)"
    assert float(re.search(r", floor 2 ([\d.]+)", family)[1]) > 0.99


CHECKS = {name.removeprefix("check_"): f for name, f in globals().items() if "check_" in name}


@pytest.mark.usefixtures("close_figures", "coarse_command", "no_drawings", "quick_screening")
@pytest.mark.filterwarnings(  # arviz 0.23
    "ignore::FutureWarning", "ignore::UserWarning", r"ignore::DeprecationWarning:arviz\..*"
)
@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: page.stem)
def test_a_chapter_runs(page, printed):
    CHECKS.get(page.stem, bool)(printed(page))


def test_first_steps_print_what_they_show(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (GUIDE / "first_steps.md").read_text("utf-8")
    shown = " ".join(text.split())
    for command in ("new tower", "check tower.csv", "rank tower.py", "report runs/results/tower"):
        assert f"$ bayes-ssi {command}\n" in text
        done = succeeded(CliRunner().invoke(main, command.split(), env={"COLUMNS": "80"}))
        printed = " ".join(done.stdout.split())
        if command.startswith("rank"):
            for sentence in ("The most probable of the 2 model classes", "It pairs all 3"):
                assert re.search(rf"{sentence}.*?\. (?=[A-Z])", printed)[0] in shown
            assert re.search(r"k2 = 0\.81", printed)
        elif not command.startswith("check"):
            assert printed in shown


def test_the_page_of_commands_lists_all_of_them():
    text = (GUIDE / "commands.md").read_text("utf-8")
    assert re.search(r":commands: (.*)", text)[1].split(",") == list(main.commands)


def test_every_plot_has_a_picture_and_an_example():
    text = "".join(page.read_text("utf-8") for page in GUIDE.glob("*.md"))
    pictures = {name: f"runs/pictures/plots/{name[5:]}.png" for name in plots.__all__}
    for name, picture in pictures.items():
        if name.startswith("plot_"):
            assert f"(../../{picture})" in text, name
            assert f"plots.{name}(" in text, "an example"
            assert (ROOT / picture).is_file(), name


def test_every_element_has_an_example():
    code = "".join(b.text for b in blocks(GUIDE / "your_own_structure.md"))
    public = {name: getattr(bs, name) for name in bs.__all__}
    elements = [n for n, of in public.items() if isinstance(of, type) and issubclass(of, Element)]
    assert len(elements) >= 5
    assert [name for name in elements if f"bs.{name}(" not in code] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_exist_and_take_these_options(page, monkeypatch):
    """Also those that take too long to run here."""
    monkeypatch.chdir(ROOT)
    for program, *arguments in commands(page):
        if program == "python":
            assert (ROOT / arguments[0]).is_file(), arguments[0]
        else:
            command = main.get_command(click.Context(main), arguments[0])
            assert command.make_parser(click.Context(command)).parse_args(list(arguments[1:]))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_scripts_and_studies_that_a_page_names_exist(page):
    text = page.read_text("utf-8")
    for path in re.findall(r"\b(?:runs|tests|model_classes)/[\w/]+\.py", text):
        assert (ROOT / path).is_file(), path
    for command in re.findall(r"`(?:python|pytest) ([\w/]+\.py)", text):
        assert (ROOT / command).is_file(), command


@pytest.fixture(scope="module")
def html(tmp_path_factory):
    """The guide, built; any warning is an error."""
    built = tmp_path_factory.mktemp("html")
    doctrees = tmp_path_factory.mktemp("doctrees")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-d", doctrees]
    done = subprocess.run([*command, GUIDE, built], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return built


def test_built_pages_need_no_network(html):
    pages = sorted(html.glob("*.html"))
    assert {page.stem for page in CHAPTERS} <= {page.stem for page in pages}
    for page in pages:
        text = page.read_text("utf-8")
        loaded = re.findall(r"<(?:script|img|iframe)[^>]* src=\"([^\"]+)\"", text)
        loaded += re.findall(r"<link[^>]* href=\"([^\"#]+)[^\"]*\"", text)
        assert loaded
        for address in loaded:
            assert (page.parent / address.partition("?")[0]).is_file(), f"{page.name}: {address}"
    for sheet in html.rglob("*.css"):
        assert not re.search(r"url\(['\"]?(https?:)?//|@import", sheet.read_text("utf-8")), sheet


def test_the_built_api_page_shows_every_name_and_its_signature(html):
    text = (html / "api.html").read_text("utf-8")
    assert [name for name in bs.__all__ if f'id="bayes_ssi.{name}"' not in text] == []
    # A colon in the first line of a property's docstring would make the words before it a type.
    assert "Type<span" not in text
    plain = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", "", text))
    assert "Parameter(name: str, prior: Prior, unit: str = '')" in unescape(plain)
