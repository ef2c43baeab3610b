"""``bayes-ssi guide``: the documentation that is installed with the package."""

from importlib.resources import files
from pathlib import Path

import click

from bayes_ssi.commands import terminal


@click.command()
@click.option("--no-browser", is_flag=True, help="Only print where the guide is.")
def guide(no_browser: bool) -> None:
    """Open the guide in a browser and print its path; it needs no network."""
    import webbrowser

    page = Path(str(files("bayes_ssi"))) / "guide" / "html" / "index.html"
    if not page.is_file():
        raise FileNotFoundError(
            f"the guide is not built: {page} does not exist; 'pip install' of bayes_ssi makes it"
        )
    terminal.say(str(page))
    if not no_browser:
        webbrowser.open(page.as_uri())
