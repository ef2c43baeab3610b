"""Arguments of finite-element models, as users give them."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import listed_choices
from bayes_ssi.structures.finite_elements.finite_element_settings import FEM
from bayes_ssi.structures.geometry import Geometry, motion_of

Sensors = Mapping[str, "int | str"] | Sequence["int | str"]


def sensor_rows(
    n: int, labels: Sequence[str] | None, sensors: Sensors | None
) -> tuple[tuple[str, ...], NDArray[np.intp]]:
    """Names and rows of the measured degrees of freedom.

    Args:
        n: number of degrees of freedom of the model.
        labels: labels of all degrees of freedom, or None.
        sensors: name → label, or number from 0, of a degree of freedom; or labels alone; or
            None for all.
    """
    if isinstance(labels, str) or isinstance(sensors, str):
        raise TypeError("labels and sensors must be several names, got a single text")
    if labels is not None:
        _require_names("labels", labels)
        if len(labels) != n:
            raise ValueError(f"labels: {len(labels)} for {n} degrees of freedom")
    if sensors is None:
        if n > (most := FEM.sensors_named_above):
            raise ValueError(
                f"sensors: a model of more than {most} degrees of freedom, here "
                f'{n}, must name the measured ones, as in sensors={{"roof x": 1203}}'
            )
        return tuple(labels or (f"dof {i}" for i in range(n))), np.arange(n)
    if not isinstance(sensors, Mapping):
        if not all(isinstance(sensor, str) for sensor in sensors):
            raise TypeError(
                "sensors: a list holds labels; to give numbers, name them, as in "
                f'sensors={{"roof x": 1203}}, got {sensors!r}'
            )
        _require_names("sensors", list(sensors))
        sensors = {str(sensor): sensor for sensor in sensors}
    _require_names("sensors", list(sensors))
    row_of = {label: i for i, label in enumerate(labels or ())}
    rows = [_row(name, place, n, row_of) for name, place in sensors.items()]
    return tuple(sensors), np.array(rows, dtype=np.intp)


def _row(name: str, place: object, n: int, row_of: Mapping[str, int]) -> int:
    if isinstance(place, str) and place in row_of:
        return row_of[place]
    # A whole number, of numpy perhaps, but not True.
    row = int(place) if isinstance(place, Integral) and not isinstance(place, bool) else -1
    if 0 <= row < n:
        return row
    labels = listed_choices(row_of) if row_of else "none was given"
    raise ValueError(
        f"sensor {name!r}: must be the number of a degree of freedom, from 0 to {n - 1}, or its "
        f"label ({labels}), got {place!r}"
    )


def _require_names(what: str, names: Sequence[object]) -> None:
    for name in names:
        if not isinstance(name, str) or not name.strip():
            raise TypeError(f"{what} must be text and not empty, got {name!r}")
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise ValueError(f"{what}: {repeated[0]!r} names two degrees of freedom")


def checked_n_modes(
    n_modes: int | None, up_to_hz: float | None, n: int
) -> tuple[int | None, float | None]:
    if (n_modes is None) == (up_to_hz is None):
        raise ValueError("give either n_modes or up_to_hz, to say how many modes are computed")
    if n_modes is None:
        if not (isinstance(up_to_hz, (int, float)) and 0 < up_to_hz < math.inf):
            raise ValueError(f"up_to_hz must be a positive frequency in Hz, got {up_to_hz!r}")
        return None, float(up_to_hz)
    if not isinstance(n_modes, Integral) or isinstance(n_modes, bool) or not 1 <= n_modes <= n:
        raise ValueError(
            f"n_modes must be a whole number from 1 to {n}, the degrees of freedom, got {n_modes!r}"
        )
    return int(n_modes), None


def checked_influence(influence: ArrayLike | None, n: int) -> FloatArray | None:
    if influence is None:
        return None
    array = np.array(influence, dtype=float)
    if array.shape != (n,) or not np.isfinite(array).all():
        raise ValueError(
            f"influence must be {n} finite numbers, one per degree of freedom, got "
            f"shape {array.shape}"
        )
    array.setflags(write=False)
    return array


def require_nodes(geometry: Geometry | None, labels: Sequence[str]) -> None:
    if geometry is None or any(geometry.location(motion_of(label)) for label in labels):
        return
    raise ValueError(
        "geometry: no degree of freedom is at any of its nodes; labels are "
        f"{listed_choices(labels, 3)}, nodes {listed_choices(geometry.nodes, 3)}, and a label is "
        "the name of a node and a direction, such as 'node 7 x'"
    )
