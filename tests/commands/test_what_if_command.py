"""``bayes-ssi what-if``: what it prints, and what it refuses."""

import json

import pytest
from conftest import assert_one_line_error


@pytest.fixture
def saved(tiny_result):
    return tiny_result.directory


def test_the_change_is_shown(run, saved, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    done = run("what-if", saved, "--prior", "k=Normal(1, 0.2)", "--weight", "one k=3")
    assert done.exit_code == 0, done.output
    assert "Changed: prior of 'k': LogNormal(median=1.0, cov=0.3) → Normal(" in done.stdout
    assert "Changed: prior weight of 'one k': 1 → 3." in done.stdout
    assert "'one k' is the most probable class before and after." in done.stdout
    assert all(len(line) <= 60 for line in done.stdout.splitlines() if "─" in line)


def test_where_the_draws_do_not_say_the_exit_code_is_3(run, saved):
    done = run("what-if", saved, "--prior", "k=LogNormal(5, 0.05)")
    assert done.exit_code == 3, done.output
    assert "(!) 'one k': the draws do not cover the changed class: Pareto k is" in done.stdout
    assert "tiny.py, and run, with another --out: bayes-ssi" in " ".join(done.stdout.split())


def test_a_record(run, saved):
    done = run("what-if", saved, "--detection", "0.9", "--json")
    rows = json.loads(done.stdout)["answer"]["classes"]
    assert {row["name"] for row in rows} == {"one k", "each k"}
    assert all(row["problem"] == "" for row in rows)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), ("nothing is changed; give a prior",)),
        (("--prior", "k"), ("--prior: must be NAME=DISTRIBUTION", "'k'")),
        (("--prior", "k=Gamma(1, 2)"), ("--prior", "choose from Normal, LogNormal")),
        (("--prior", "k=Normal(1, -2)"), ("--prior: Normal: sd must be positive",)),
        (("--prior", "k=Normal(1, 2)", "--prior", "k=Normal(1, 3)"), ("'k' is given twice",)),
        (("--weight", "one k=x"), ("--weight: 'x' is not a number",)),
        (("--weight", "one k=0"), ("prior weight of 'one k'", "positive")),
        (("--spurious", "0"), ("expected_spurious_modes must be positive",)),
    ],
)
def test_bad_options(run, saved, options, words):
    assert_one_line_error(run("what-if", saved, *options), *words)
