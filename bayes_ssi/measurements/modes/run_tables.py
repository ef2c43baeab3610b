"""Modes of runs of a program that exports no matrices: a table for each run.

A directory holds ``design.csv``, with a column ``run`` and the factors of properties in the others,
and for each run a table of modes (:mod:`bayes_ssi.measurements.modes.modal_files`, without a band):
``1.csv`` of run 1, or sheet ``1`` of a workbook. Runs without a table are still to be made.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.text_files import WORKBOOKS, read_table, sheet_names
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.modes.modal_files import read_modal_data

DESIGN = "design.csv"
ALL_HZ = (0.0, 1e9)


@checked
def read_runs(directory: str | Path) -> dict[str, Any]:
    """Read the runs of a program, as arguments of :class:`bayes_ssi.EmulatedRuns`.

    Returns:
        ``runs``, property → its factor in each of N runs; ``frequencies_hz`` (N, m), ``shapes``
        (N, n_sensors, m) and ``sensors``; m is the least number of modes of a run.

    Raises:
        OSError: a file cannot be read.
        ValueError: a table is not understood, no run was made, or runs differ in their sensors.
    """
    directory = Path(directory)
    (first, *names), rows = read_table(directory / DESIGN)
    if first != "run" or not names:
        raise ValueError(f"{directory / DESIGN}: columns must be run and the properties")
    made = [
        (where, _factors(cells, names, where), modes)
        for where, (run, *cells) in rows
        if (modes := _table(directory, run)) is not None
    ]
    if not made:
        raise ValueError(f"{directory}: no run has a table, such as {directory / '1.csv'}")
    sensors = made[0][2].sensors
    n_modes = min(len(modes.modes) for *_, modes in made)
    shapes = []
    for where, _, modes in made:
        if set(modes.sensors) != set(sensors):
            raise ValueError(f"{where}: sensors {modes.sensors}, in the first run {sensors}")
        shapes.append(modes.unit_shapes[[modes.sensors.index(name) for name in sensors]])
        if np.isnan(shapes[-1][:, :n_modes]).any():
            raise ValueError(f"{where}: a shape is not stated at all sensors")
    return {
        "runs": dict(zip(names, np.transpose([factors for _, factors, _ in made]), strict=True)),
        "frequencies_hz": np.array([modes.frequencies_hz[:n_modes] for *_, modes in made]),
        "shapes": np.array([shape[:, :n_modes] for shape in shapes]),
        "sensors": sensors,
    }


def _factors(cells: Sequence[str], names: Sequence[str], where: str) -> list[float]:
    try:
        factors = [float(cell) for cell in cells]
    except ValueError:
        factors = []
    if len(factors) != len(names) or not min(factors) > 0.0:
        raise ValueError(f"{where}: must be a run and {len(names)} positive factors")
    return factors


def _table(directory: Path, run: str) -> ModalData | None:
    """The modes of a run, in ascending order; None where there are none yet."""
    if (file := directory / f"{run}.csv").exists():
        return read_modal_data(file, band_hz=ALL_HZ)
    books = [file for file in sorted(directory.iterdir()) if file.suffix.lower() in WORKBOOKS]
    book = next((book for book in books if run in sheet_names(book)), None)
    return None if book is None else read_modal_data(book, band_hz=ALL_HZ, sheet=run)
