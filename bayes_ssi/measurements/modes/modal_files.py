"""Files of identified modes, in any format that the package reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.universal_files import is_universal_file
from bayes_ssi.measurements.modes.modal_csv import read_modal_csv
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.modes.modal_uff import read_modal_uff


@checked
def read_modal_data(
    path: str | Path,
    *,
    band_hz: Sequence[float] | None = None,
    sensors: Mapping[str, tuple[int, str]] | None = None,
) -> ModalData:
    """Read identified modes from a CSV file, or from the data sets 55 of a universal file.

    A universal file is recognised by its first line; :mod:`bayes_ssi.measurements.modes.modal_csv`
    describes the CSV file.

    Args:
        path: the file.
        band_hz: lowest and highest frequency (Hz) of the search. A CSV file can
            state them itself, a universal file cannot.
        sensors: for a universal file, name → (node, direction); the direction is x, y or z, or
            -x, -y or -z where the sensor points the other way. If None, every node and direction
            that moves is a sensor, named ``12 x``. A CSV file names its sensors itself.

    Raises:
        OSError: the file cannot be read.
        ValueError: the content is not understood, the band is missing, or sensors are given for
            a CSV file; the message names the file and, for CSV, the line and the column.
    """
    path = Path(path)
    if is_universal_file(path):
        if band_hz is None:
            raise ValueError(f"{path}: give band_hz; a universal file does not state the band")
        return read_modal_uff(path, band_hz=band_hz, sensors=sensors)
    if sensors is not None:
        raise ValueError(f"{path}: sensors are given, but the columns of a CSV file name its own")
    return read_modal_csv(path, band_hz=band_hz)
