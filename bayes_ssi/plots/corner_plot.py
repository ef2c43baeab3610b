"""Marginal and joint posterior densities of parameters."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_ssi.plots.style import BLUE, draw_as_they_are, style
from bayes_ssi.posterior.posterior import Posterior

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["corner_size", "plot_corner"]

# A panel holds so many letters of a name at the size of 9 points.
LETTERS = 16


def plot_corner(
    posterior: Posterior, figure: Figure | None = None, parameters: Sequence[str] | None = None
) -> Figure:
    """Marginal and joint posterior densities of the parameters, or of those that are named.

    Raises:
        ValueError: there is no parameter of such a name.
    """
    import matplotlib.pyplot as plt

    names = posterior.parameter_names if parameters is None else tuple(parameters)
    unknown = [name for name in names if name not in posterior.parameter_names]
    if unknown:
        raise ValueError(
            f"plot_corner: no parameter {unknown[0]!r}; choose from "
            f"{', '.join(map(repr, posterior.parameter_names))}"
        )
    columns = [posterior.parameter_names.index(name) for name in names]
    values = posterior.values[:, columns]
    n = len(names)
    size = 9.0 * min(1.0, LETTERS / max(map(len, names)))
    with style():
        if figure is None:
            # corner places its axes itself.
            figure = plt.figure(figsize=corner_size(n), layout="none")
        _corner()(
            values,
            labels=[name.replace("$", r"\$") for name in names],
            fig=figure,
            color=BLUE,
            bins=30,
            smooth=1.0,
            quantiles=[0.05, 0.5, 0.95],
            label_kwargs={"fontsize": size},
            labelpad=0.07,
            levels=(0.393, 0.865),
            max_n_ticks=4,
            plot_datapoints=False,
        )
        if n > 1:
            for i, (name, ax) in enumerate(zip(names, figure.axes[:: n + 1], strict=True)):
                low, median, high = np.quantile(values[:, i], [0.05, 0.5, 0.95])
                told = f"{name}\n{median:.4g}\n({low:.4g} to {high:.4g})"
                draw_as_they_are([ax.set_title(told, fontsize=min(7.5, size), loc="center")])
        height = figure.get_figheight()
        figure.subplots_adjust(top=1.0 - (1.0 if n > 1 else 0.8) / height)
        text = f"{posterior.name}\nmedian, 90 % interval" + ("; 1 and 2 sigma" if n > 1 else "")
        title = figure.suptitle(text, y=1.0 - 0.1 / height, va="top", fontsize=10)
        draw_as_they_are([title])
    return figure


def corner_size(n_parameters: int) -> tuple[float, float]:
    """Width and height, in inches, of a corner plot."""
    side = 1.4 + 1.5 * n_parameters
    return side, side + 0.8


@cache
def _corner() -> Callable[..., Any]:
    """corner's drawing of an array.

    ``import corner`` imports arviz besides, for draws that arviz holds: two seconds for nothing
    here. So its core is imported by itself, where there is one.
    """
    found = importlib.util.find_spec("corner")
    for place in (found and found.submodule_search_locations) or ():
        file = Path(place) / "core.py"
        spec = importlib.util.spec_from_file_location("corner_core", file)
        if file.is_file() and spec is not None and spec.loader is not None:
            core = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(core)
            if hasattr(core, "corner_impl"):
                return core.corner_impl
    import corner

    return corner.corner
