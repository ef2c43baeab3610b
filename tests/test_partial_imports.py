"""Imports without optional dependencies, in processes of their own."""

import subprocess
import sys

import pytest


def run(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.parametrize(
    ("code", "optional", "package"),
    [
        ("import bayes_ssi.inference.sampling.moves", "scipy.stats", "emcee"),
        ("import bayes_ssi.plots.class_plots as p; p.import_corner()", "arviz", "corner"),
    ],
)
def test_what_takes_long_to_import_is_left_out_and_there_for_others(code, optional, package):
    show = f"import sys; print({optional!r} in sys.modules, {package!r} in sys.modules)"
    assert run(f"{code}; {show}; import {package}; {show}") == ["False", "False", "True", "True"]


def test_what_is_imported_already_is_used():
    moves = "bayes_ssi.inference.sampling.moves"
    code = f"import scipy.stats, emcee, {moves} as m; print(m.emcee is emcee)"
    assert run(code) == ["True"]
