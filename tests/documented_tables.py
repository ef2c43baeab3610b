"""Compare the ranking tables in the README and the guide with what the commands print today.

    python tests/documented_tables.py [PAGE.md …]

Runs the command that a page shows above each table of log evidences, and compares the order of the
classes and their log evidences, within three standard errors of the difference. The exit code is 1
where a page is out of date. All pages take a few minutes.
"""

import json
import math
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "bayes_ssi" / "guide").glob("*.md"))]
STANDARD_ERRORS = 3.0


@dataclass(frozen=True)
class Row:
    """A model class and its log evidence with its standard error."""

    name: str
    log_evidence: float
    error: float


@dataclass(frozen=True)
class DocumentedTable:
    """A ranking table on a page, the command that prints it, and whether rows were left out."""

    page: Path
    command: tuple[str, ...]
    rows: tuple[Row, ...]
    abridged: bool


def documented_tables(page: Path) -> Iterator[DocumentedTable]:
    """The ranking tables of a page, each with the last command in or above its block."""
    text = page.read_text("utf-8")
    for block in re.finditer(r"^```[^\n]*\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        cells = re.findall(r"^ (\S.*?)  +(-?\d+\.\d+) ± (\d+\.\d+) ", block[1], re.MULTILINE)
        if cells:
            rows = tuple(Row(name, float(value), float(error)) for name, value, error in cells)
            first_row = text.index(f" {rows[0].name} ", block.start())
            command = re.findall(r"bayes-ssi rank [^\n`&]+", text[:first_row])[-1]
            abridged = re.search(r"^ \.\.\.", block[1], re.MULTILINE) is not None
            yield DocumentedTable(page, tuple(shlex.split(command)), rows, abridged)


def differences(table: DocumentedTable, now: Sequence[Row]) -> Iterator[str]:
    """What a table shows that differs from the rows of a result, a sentence each."""
    shown = {row.name: row for row in table.rows}
    listed = [row for row in now if row.name in shown or not table.abridged]
    if list(shown) != [row.name for row in listed]:
        yield f"shows {', '.join(shown)}; now {', '.join(row.name for row in listed)}"
        return
    for row in listed:
        old = shown[row.name]
        limit = STANDARD_ERRORS * math.hypot(old.error, row.error)
        if abs(old.log_evidence - row.log_evidence) > limit:
            yield (
                f"{row.name}: shows {old.log_evidence} ± {old.error}; now "
                f"{row.log_evidence:.3f} ± {row.error:.3f}"
            )


def ranked_now(command: Sequence[str]) -> list[Row]:
    """The rows of the ranking that a command prints today; a study of ``new`` is written first."""
    with tempfile.TemporaryDirectory() as directory:
        study, folder = Path(command[2]), ROOT
        if not (ROOT / study).exists():
            folder = Path(directory)
            subprocess.run(["bayes-ssi", "new", study.stem], cwd=folder, check=True)
        own = [*command, "--json", "--out", str(Path(directory) / "result")]
        done = subprocess.run(own, cwd=folder, stdout=subprocess.PIPE, text=True, check=True)
    classes = json.loads(done.stdout)["classes"]
    return [Row(each["name"], each["log_evidence"], each["error"]) for each in classes]


def main() -> int:
    pages = [Path(name) for name in sys.argv[1:]] or PAGES
    out_of_date = False
    for table in (table for page in pages for table in documented_tables(page)):
        print(f"{table.page.name}: {shlex.join(table.command)}", flush=True)
        sentences = list(differences(table, ranked_now(table.command)))
        print(*(f"  {sentence}" for sentence in sentences or ["as shown"]), sep="\n", flush=True)
        out_of_date |= bool(sentences)
    return 1 if out_of_date else 0


if __name__ == "__main__":
    sys.exit(main())
