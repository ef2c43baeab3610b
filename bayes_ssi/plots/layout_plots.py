"""Plans of tests: the places of the best layout, and the gain against the number of sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_ssi.plots.figure_style import STYLE, axes_of, legend_below, legend_of_figure
from bayes_ssi.plots.space import draw_structure, frame_in_space, panels_in_space
from bayes_ssi.studies.planning.plan_record import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CHOSEN, OTHER = "sensor of the best layout", "other candidate"


def plot_layout(plan: Plan, ax: Axes | None = None) -> Axes:
    """The structure with the places of the best layout, and the other candidates.

    In space where candidates have coordinates, with arrows for directions; else by their heights.
    Axes that are given must have three dimensions for a drawing in space.
    """
    if any(each.coordinates for each in plan.candidates):
        return _in_space(plan, ax)
    heights = plan.heights.values()
    ax = axes_of(ax, (STYLE.width, 1.2 + 0.35 * len({*heights})))
    ax.plot([0.0, 0.0], [0.0, max(heights, default=1.0)], color=STYLE.grey, linewidth=1.5)
    ax.plot([-0.5, 0.5], [0.0, 0.0], color="black", linewidth=2.0)
    beside: dict[float, int] = {}
    for name, height in plan.heights.items():
        place = beside[height] = beside.get(height, -1) + 1
        chosen = name in plan.best.sensors
        ax.plot(0.9 * place, height, linestyle="none", marker="o", markersize=8.0,
                color=STYLE.vermilion if chosen else "white", markeredgecolor="black",
                label=CHOSEN if chosen else OTHER)  # fmt: skip
        ax.text(0.9 * place + 0.1, height, name, va="center", fontsize=STYLE.small)
    ax.set_xlim(-0.6, 0.9 * max(beside.values(), default=0) + 1.2)
    ax.margins(y=0.1)
    ax.axis("off")
    legend_below(ax, 2)
    return ax


def _in_space(plan: Plan, ax: Any) -> Any:
    located = [(each, each.coordinates) for each in plan.candidates if each.coordinates]
    nodes = plan.geometry.nodes.values() if plan.geometry else ()
    points = np.array([*(at for _, at in located), *nodes])
    length = 0.13 * (float(np.ptp(points, axis=0).max()) or 1.0)
    title = f"{len(plan.best.sensors)} of {len(plan.candidates)} candidates"
    if ax is None:
        _, (ax,) = panels_in_space([title], points, length, below=0.6)
    else:
        frame_in_space(ax, title, points, length)
    if plan.geometry is not None:
        draw_structure(ax, plan.geometry)
    for each, at in located:
        chosen = each.name in plan.best.sensors
        colour, label = (STYLE.vermilion, CHOSEN) if chosen else (STYLE.grey, OTHER)
        if each.direction and chosen:
            along = np.multiply(length, each.direction)
            ax.quiver(*at, *along, color=colour, linewidth=1.6,
                      arrow_length_ratio=0.4)  # fmt: skip
        ax.scatter(*at, s=30.0 if chosen else 8.0, color=[colour], label=label,
                   depthshade=False)  # fmt: skip
    legend_of_figure(ax.figure, [ax])
    return ax


def plot_gains(plan: Plan, ax: Axes | None = None) -> Axes:
    """The gain of the best layout against its number of sensors, with 90 % intervals."""
    ax = axes_of(ax, (STYLE.width, 2.6))
    numbers = [len(layout.sensors) for layout in plan.by_number]
    gains = [layout.gain for layout in plan.by_number]
    errors = [STYLE.sds_of_90_percent * layout.error for layout in plan.by_number]
    ax.errorbar(numbers, gains, yerr=errors, color=STYLE.blue, marker="o", label="best layout")
    if plan.greatest is not None:
        ax.axhline(plan.greatest, color=STYLE.grey, linestyle="--", label="settles it")
    ax.axvline(plan.knee, color=STYLE.orange, linestyle=":", label="knee")
    ax.set_xticks(numbers)
    ax.set_xlabel("number of sensors")
    ax.set_ylabel(f"information about {plan.aim} (nats)")
    legend_below(ax, 3)
    return ax
