"""Compare tables and answers in the README and the guide with what the commands print today.

    python tests/documented_tables.py [PAGE.md …]

Runs the command that a page shows above each table of log evidences, and compares the order of the
classes and their log evidences, within three standard errors of the difference. Sentences of what
searches answer are to be printed as shown. The exit code is 1 where a page is out of date.
"""

import json
import math
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "bayes_ssi" / "guide").glob("*.md"))]
STANDARD_ERRORS = 3.0


def documented_tables(page):
    """The ranking tables of a page: the last command in or above each one's block, and its rows.

    Rows are the name of a class → its log evidence and error; "..." where some were left out.
    """
    text = page.read_text("utf-8")
    for block in re.finditer(r"^```[^\n]*\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        cells = re.findall(r"^ (\S.*?)  +(-?\d+\.\d+) ± (\d+\.\d+) ", block[1], re.MULTILINE)
        if cells:
            rows = {name: (float(value), float(error)) for name, value, error in cells}
            first_row = text.index(f" {cells[0][0]} ", block.start())
            command = re.findall(r"bayes-ssi rank [^\n`&]+", text[:first_row])[-1]
            if re.search(r"^ \.\.\.", block[1], re.MULTILINE):
                rows["..."] = (math.nan, math.nan)
            yield shlex.split(command), rows


def documented_answers(page):
    """The last search above each block that begins with its answer, and the sentences shown."""
    text, search = page.read_text("utf-8"), r"bayes-ssi (?:search|changes) [^\n`&\\]+$"
    for shown in re.finditer(r"^That (?:there|something) (?:.*\n)+?```$", text, re.MULTILINE):
        for command in re.findall(search, text[: shown.start()], re.MULTILINE)[-1:]:
            yield shlex.split(command), re.split(r"(?<=\.)\s+", shown[0].removesuffix("```"))


def rows_of(printed):
    """The rows of a ranking that is printed as JSON."""
    classes = json.loads(printed)["classes"]
    return {each["name"]: (each["log_evidence"], each["error"]) for each in classes}


def differences(shown, now):
    """What a table shows that differs from the rows of a result, a sentence each."""
    names = [name for name in shown if name != "..."]
    listed = [name for name in now if name in shown or "..." not in shown]
    if names != listed:
        yield f"shows {', '.join(names)}; now {', '.join(listed)}"
        return
    for name in names:
        (old, old_error), (new, error) = shown[name], now[name]
        if abs(old - new) > STANDARD_ERRORS * math.hypot(old_error, error):
            yield f"{name}: shows {old} ± {old_error}; now {new:.3f} ± {error:.3f}"


def printed_now(command, *options):
    """What a command prints today; a study of ``new`` is written first."""
    with tempfile.TemporaryDirectory() as directory:
        study, folder = Path(command[2]), ROOT
        if not (ROOT / study).exists():
            folder = Path(directory)
            subprocess.run(["bayes-ssi", "new", study.stem], cwd=folder, check=True)
        own = [*command, *options, "--out", str(Path(directory) / "result")]
        return subprocess.run(own, cwd=folder, stdout=subprocess.PIPE, text=True, check=True).stdout


def main():
    out_of_date = False
    for page in [Path(name) for name in sys.argv[1:]] or PAGES:
        for command, shown in documented_tables(page):
            print(f"{page.name}: {shlex.join(command)}", flush=True)
            sentences = list(differences(shown, rows_of(printed_now(command, "--json"))))
            print(*(f"  {each}" for each in sentences or ["as shown"]), sep="\n", flush=True)
            out_of_date |= bool(sentences)
        for command, shown in documented_answers(page):
            print(f"{page.name}: {shlex.join(command)}", flush=True)
            now = " ".join(printed_now(command, "--accept-failed-checks").split())
            missing = [each for each in shown if " ".join(each.strip(". \n").split()) not in now]
            print(*(f"  not printed: {each}" for each in missing), sep="\n", flush=True)
            out_of_date |= bool(missing)
    return 1 if out_of_date else 0


if __name__ == "__main__":
    sys.exit(main())
