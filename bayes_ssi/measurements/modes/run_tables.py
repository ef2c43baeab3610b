"""Modes of runs of a program that exports no matrices: a table for each run.

A directory holds ``design.csv``, with a column ``run`` and the factors of properties in the others,
and for each run a table of modes (:mod:`bayes_ssi.measurements.modes.modal_files`, without a band):
``1.csv`` of run 1, or sheet ``1`` of a workbook. Runs without a table are still to be made.
"""

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
    factors, made = list[list[float]](), list[ModalData]()
    for where, (run, *cells) in rows:
        if (modes := _table(directory, run)) is None:
            continue
        try:
            factors.append([float(cell) for cell in cells])
        except ValueError:
            cells = []
        if len(cells) != len(names) or not min(factors[-1]) > 0.0:
            raise ValueError(f"{where}: must be a run and {len(names)} positive factors")
        made.append(modes)
        if set(modes.sensors) != set(made[0].sensors):
            held = f"sensors {modes.sensors}, in the first run {made[0].sensors}"
            raise ValueError(f"{where}: {held}")
        if np.isnan(modes.unit_shapes).any():
            raise ValueError(f"{where}: a shape is not stated at all sensors")
    if not made:
        raise ValueError(f"{directory}: no run has a table, such as {directory / '1.csv'}")
    sensors = made[0].sensors
    m = min(len(modes.modes) for modes in made)
    shapes = [each.unit_shapes[[each.sensors.index(s) for s in sensors], :m] for each in made]
    return {
        "runs": dict(zip(names, np.transpose(factors), strict=True)),
        "frequencies_hz": np.array([modes.frequencies_hz[:m] for modes in made]),
        "shapes": np.array(shapes),
        "sensors": sensors,
    }


def _table(directory: Path, run: str) -> ModalData | None:
    """The modes of a run, in ascending order; None where there are none yet."""
    if (file := directory / f"{run}.csv").exists():
        return read_modal_data(file, band_hz=ALL_HZ)
    for book in sorted(file for file in directory.iterdir() if file.suffix.lower() in WORKBOOKS):
        if run in sheet_names(book):
            return read_modal_data(book, band_hz=ALL_HZ, sheet=run)
    return None
