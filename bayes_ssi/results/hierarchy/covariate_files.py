"""Covariates of tests, such as the temperature, from CSV files."""

from __future__ import annotations

import csv
from pathlib import Path

from bayes_ssi.foundations.text_files import require_regular_file


def read_covariate(path: str | Path) -> tuple[str, dict[str, float]]:
    """Name and values of a covariate: name of a test → value.

    The file has two columns, the tests and the covariate, and a heading for each; the second one
    names the covariate::

        test, temperature in °C
        2026-01-14, -3.5
        2026-04-02, 11
    """
    path = Path(path)
    try:
        require_regular_file(path)
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not a text file in UTF-8") from None
    rows = csv.reader(text.splitlines(), skipinitialspace=True)
    numbered = [(rows.line_num, [cell.strip() for cell in row]) for row in rows]
    lines = [(n, row) for n, row in numbered if any(row) and not row[0].startswith("#")]
    if not lines or len(lines[0][1]) != 2 or not lines[0][1][1]:
        got = lines[0][1] if lines else "nothing"
        raise ValueError(f"{path}: the first line must be 'test, NAME OF THE COVARIATE', got {got}")
    name, values = lines[0][1][1], {}
    for line, row in lines[1:]:
        where = f"{path}, line {line}"
        if len(row) != 2 or not row[0]:
            raise ValueError(f"{where}: expected a test and its {name}, got {','.join(row)!r}")
        if row[0] in values:
            raise ValueError(f"{where}: a second value for test {row[0]!r}")
        try:
            values[row[0]] = float(row[1])
        except ValueError:
            raise ValueError(f"{where}: {name} must be a number, got {row[1]!r}") from None
    return name, values
