"""``bayes-ssi guide`` opens the pages that were built with the package."""

import webbrowser

from conftest import assert_one_line_error


def test_the_guide_is_opened_and_its_path_printed(run, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr("bayes_ssi.commands.guide.files", lambda _: tmp_path)
    assert_one_line_error(run("guide"), "the guide is not built", "pip install")
    page = tmp_path / "guide" / "html" / "index.html"
    page.parent.mkdir(parents=True)
    page.touch()
    assert run("guide", "--no-browser").stdout.strip() == str(page)
    assert opened == []
    assert run("guide").stdout.strip() == str(page)
    assert opened == [page.as_uri()]
