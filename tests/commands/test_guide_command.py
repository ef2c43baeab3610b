"""``bayes-ssi guide`` opens the pages that were built with the package."""

import webbrowser

import pytest
from conftest import assert_one_line_error


@pytest.fixture
def opened(monkeypatch):
    """Addresses that a browser was asked to open."""
    addresses = []
    monkeypatch.setattr(webbrowser, "open", addresses.append)
    return addresses


@pytest.fixture
def package(tmp_path, monkeypatch):
    monkeypatch.setattr("bayes_ssi.commands.guide.files", lambda _: tmp_path)
    return tmp_path


@pytest.mark.parametrize(("options", "n_opened"), [((), 1), (("--no-browser",), 0)])
def test_the_guide_is_opened_and_its_path_printed(run, package, opened, options, n_opened):
    page = package / "guide" / "html" / "index.html"
    page.parent.mkdir(parents=True)
    page.touch()
    result = run("guide", *options)
    assert result.exit_code == 0
    assert result.stdout.strip() == str(page)
    assert opened == [page.as_uri()] * n_opened


@pytest.mark.usefixtures("package")
def test_a_guide_that_was_not_built_is_an_error(run, opened):
    assert_one_line_error(run("guide"), "the guide is not built", "pip install")
    assert not opened
