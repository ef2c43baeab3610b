"""Examples in the docstrings of public names give what they show."""

import doctest

import numpy as np
import pytest

import bayes_ssi as bs

FINDER = doctest.DocTestFinder(recurse=False)
EXAMPLES = {
    name: FINDER.find(getattr(bs, name), name, globs={"bs": bs, "np": np}) for name in bs.__all__
}
WITH_EXAMPLE = [name for name, (found, *_) in EXAMPLES.items() if found.examples]


def test_the_names_that_are_used_most_have_examples():
    assert len(WITH_EXAMPLE) >= 20


@pytest.mark.parametrize("name", WITH_EXAMPLE)
def test_an_example_gives_what_it_shows(name):
    runner = doctest.DocTestRunner(optionflags=doctest.REPORT_ONLY_FIRST_FAILURE)
    said = []
    runner.run(EXAMPLES[name][0], out=said.append)
    assert runner.failures == 0, "".join(said)
