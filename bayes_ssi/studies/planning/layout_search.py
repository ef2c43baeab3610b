"""Searches for layouts: all where they are few, else sensor after sensor, with exchanges."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import comb

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.modal import mac
from bayes_ssi.studies.planning.layout_values import LayoutSums, Sensors, SimulatedPlan
from bayes_ssi.studies.planning.plan_settings import PLANNING


@dataclass(eq=False)
class LayoutSearch:
    """A search for the layout that is worth most.

    Attributes:
        plan: the simulated tests.
        objective: the worth of a layout by its sums.
        fixed: candidates in every layout.
        free: those that may be.
        tried: layout → its worth.
    """

    plan: SimulatedPlan
    objective: Callable[[LayoutSums], float]
    fixed: Sensors
    free: Sensors
    tried: dict[Sensors, float] = field(default_factory=dict)

    def is_exhaustive(self, number: int) -> bool:
        """Whether all layouts of that many sensors are tried."""
        return comb(len(self.free), number - len(self.fixed)) <= PLANNING.most_exhaustive

    def best(self, number: int, start: Sensors) -> Sensors:
        """The best layout of ``number`` sensors; a greedy search begins with those of ``start``."""
        if self.is_exhaustive(number):
            return self.all_layouts(number)
        return self.exchanged(self.grown(start, number))

    def all_layouts(self, number: int) -> Sensors:
        """The best of all layouts."""
        sums = self.plan.sums(self.fixed)
        layouts = list(self._grown_in_order(sums, self.fixed, 0, number - len(self.fixed)))
        return max(layouts, key=self.tried.__getitem__)

    def _grown_in_order(
        self, sums: LayoutSums, layout: Sensors, first: int, more: int
    ) -> Iterator[Sensors]:
        if more == 0:
            yield self._value(layout, sums)
            return
        for i in range(first, len(self.free) - more + 1):
            sensor = self.free[i]
            larger = self.plan.with_sensor(sums, sensor)
            yield from self._grown_in_order(larger, (*layout, sensor), i + 1, more - 1)

    def grown(self, layout: Sensors, number: int) -> Sensors:
        """The layout with the best sensor added, one after the other."""
        while len(layout) < number:
            sums = self.plan.sums(layout)
            layout = max(
                (
                    self._extended(layout, sums, sensor)
                    for sensor in self.free
                    if sensor not in layout
                ),
                key=self.tried.__getitem__,
            )
        return layout

    def exchanged(self, layout: Sensors) -> Sensors:
        """The layout after all exchanges of one sensor for another that make it better."""
        for _ in range(PLANNING.most_exchanges):
            before = layout
            for sensor in before:
                if sensor in self.fixed or sensor not in layout:
                    continue
                rest = tuple(other for other in layout if other != sensor)
                layout = self.grown(rest, len(layout))
            if layout == before:
                break
        return layout

    def _extended(self, layout: Sensors, sums: LayoutSums, sensor: int) -> Sensors:
        larger = tuple(sorted((*layout, sensor)))
        if larger not in self.tried:
            self._value(larger, self.plan.with_sensor(sums, sensor))
        return larger

    def _value(self, layout: Sensors, sums: LayoutSums) -> Sensors:
        layout = tuple(sorted(layout))
        self.tried[layout] = self.objective(sums)
        return layout


def effective_independence(shapes: FloatArray, number: int, fixed: Sequence[int] = ()) -> Sensors:
    """Sensors that keep the shapes of one model linearly independent, as placed by habit.

    The candidate that contributes least to the rank of the shapes goes, until ``number`` are left
    (Kammer 1991, Journal of Guidance, Control, and Dynamics 14).

    Args:
        shapes: (n_candidates, n_modes), at unit modal mass.
        fixed: candidates that stay.
    """
    left = list(range(len(shapes)))
    while len(left) > number:
        own = shapes[left]
        contributions = np.einsum("cm,mc->c", own, np.linalg.pinv(own))
        # With fewer sensors than modes all contribute 1: the one that moves least goes.
        order = np.lexsort((np.square(own).sum(axis=1), contributions.round(9)))
        left.remove(next(left[i] for i in order if left[i] not in fixed))
    return tuple(left)


def largest_mac(shapes: FloatArray) -> float:
    """The largest MAC (0 to 1) of two different modes at sensors (n_sensors, n_modes)."""
    if shapes.shape[1] < 2:
        return 0.0
    between = mac(shapes, shapes)
    return float(np.nan_to_num(between - np.diag(np.diag(between))).max())
