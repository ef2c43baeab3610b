"""Searches for layouts: all where they are few, else sensor after sensor, with exchanges."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import comb

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.studies.planning.layout_values import Sensors
from bayes_ssi.studies.planning.plan_settings import PLANNING


@dataclass(eq=False)
class LayoutSearch:
    """A search for the layout of candidates that is worth most."""

    gain: Callable[[Sensors], float]
    fixed: Sensors  # in every layout
    free: Sensors  # that may be
    tried: dict[Sensors, float] = field(default_factory=dict)

    def is_exhaustive(self, number: int) -> bool:
        """Whether all layouts of that many sensors are tried."""
        return comb(len(self.free), number - len(self.fixed)) <= PLANNING.most_exhaustive

    def best(self, number: int, start: Sensors) -> Sensors:
        """The best layout of ``number`` sensors; a greedy search begins with those of ``start``."""
        if not self.is_exhaustive(number):
            return self.exchanged(self.grown(start, number))
        more = combinations(self.free, number - len(self.fixed))
        return max((self._valued((*self.fixed, *own)) for own in more), key=self.tried.__getitem__)

    def grown(self, layout: Sensors, number: int) -> Sensors:
        """The layout with the best sensor added, one after the other."""
        while len(layout) < number:
            larger = [self._valued((*layout, i)) for i in self.free if i not in layout]
            layout = max(larger, key=self.tried.__getitem__)
        return layout

    def exchanged(self, layout: Sensors) -> Sensors:
        """The layout after exchanges of one sensor, until none makes it better."""
        layout, before = self._valued(layout), self.fixed[:0]
        while layout != before:
            before = layout
            for sensor in before:
                if sensor not in self.fixed:
                    rest = tuple(other for other in layout if other != sensor)
                    layout = self.grown(rest, len(before))
        return layout

    def _valued(self, layout: Sensors) -> Sensors:
        layout = tuple(sorted(layout))
        if layout not in self.tried:
            self.tried[layout] = self.gain(layout)
        return layout


def effective_independence(shapes: FloatArray, number: int, fixed: Sequence[int] = ()) -> Sensors:
    """Sensors that keep the shapes of one model linearly independent, as placed by habit.

    The candidate that contributes least to the rank of the shapes goes, until ``number`` are left
    (Kammer 1991, Journal of Guidance, Control, and Dynamics 14).

    Args:
        shapes: (n_candidates, n_modes), at unit modal mass.
        number: of sensors.
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
