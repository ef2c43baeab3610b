"""What the files of a vibration record do not state themselves, as options of commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from bayes_ssi.measurements.records.record import Record

F = TypeVar("F", bound=Callable[..., Any])

OPTIONS = (
    click.option("--rate", type=float, help="Samples per second, if the files do not state it."),
    click.option(
        "--quantity", help="acceleration, velocity or displacement, if not stated; of .v2, which."
    ),
    click.option("--unit", help="Unit of the samples, if not stated."),
    click.option(
        "--sensor",
        "sensors",
        metavar="NAME",
        multiple=True,
        help="Name of a sensor, for all in their order, in place of the files' own names.",
    ),
    click.option(
        "--key",
        "keys",
        metavar="NAME",
        multiple=True,
        help="Array of a .mat, .npz or HDF5 file, or group of a TDMS file; may be repeated.",
    ),
)


def record_options(command: F) -> F:
    """The command with the options from which :func:`record_of` reads a record."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command


def record_of(
    files: Sequence[Path], rate: float | None, quantity: str | None, unit: str | None,
    sensors: tuple[str, ...], keys: tuple[str, ...],
) -> Record:  # fmt: skip
    """The record in the files."""
    from bayes_ssi.measurements.records.record_files import read_record

    return read_record(
        files, rate_hz=rate, quantity=quantity, unit=unit, sensors=sensors or None, keys=keys
    )
