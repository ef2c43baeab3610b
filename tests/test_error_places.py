"""Errors in a user's own code are named by the line where they were raised."""

from pathlib import Path

from bayes_ssi.foundations.error_places import with_place


def inner():
    raise ValueError("no such\nfloor")


def outer():
    inner()


def test_it_is_the_last_of_the_users_lines():
    lines = Path(__file__).read_text("utf-8").splitlines()
    line = 1 + next(i for i, text in enumerate(lines) if "raise ValueError" in text)
    try:
        outer()
    except ValueError as error:
        said = with_place(error)
    assert said == f"ValueError: no such floor ({Path(__file__).name}, line {line})"
