"""What a plan says, as records that JSON holds, and the form that a test's modes go into."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bayes_ssi.foundations.displayed import Displayed
from bayes_ssi.structures.geometry import Candidate, Geometry

# Aims of a plan that have a name.
CLASS, PARAMETERS = "class", "parameters"


@dataclass(frozen=True)
class Layout:
    """Sensors of a planned test, and what it is worth.

    Attributes:
        sensors: names of the candidates that are measured.
        band_hz: of the test.
        gain: expected information, in nats.
        error: standard error of the gain, over simulated tests.
        naming: probability that the class that is right is the most probable one after the test;
            None where the aim is not the class, and ``naming_error`` its standard error.
        largest_mac: of two different modes in the band, at these sensors.
    """

    sensors: tuple[str, ...]
    band_hz: tuple[float, float]
    gain: float
    error: float
    naming: float | None = None
    naming_error: float | None = None
    largest_mac: float | None = None

    def write_template(self, path: str | Path, n_modes: int = 8) -> None:
        """Write the form of a file of modes: a column for each sensor, a row for each mode.

        Filled in, :func:`bayes_ssi.read_modal_data` reads it.

        Args:
            path: of a new CSV file.
            n_modes: number of rows.

        Raises:
            FileExistsError: the file exists.
        """
        with Path(path).open("x", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["# source", "fill in: test and date"])
            writer.writerow(["# band_hz", *map(repr, self.band_hz)])
            writer.writerow(
                ["label", "frequency_hz", "frequency_cov", "shape_sd", "damping", *self.sensors]
            )
            empty = [""] * (4 + len(self.sensors))
            writer.writerows([str(number), *empty] for number in range(1, n_modes + 1))


@dataclass(frozen=True)
class Change:
    """What something would change in the gain of the best layout, in nats."""

    what: str
    gain: float
    error: float


@dataclass(frozen=True)
class ConfigurationPlan:
    """Layouts for one configuration of the structure.

    Attributes:
        name: of the configuration; empty where it has none.
        candidates: where sensors may be, with coordinates where they are known.
        heights: of candidates, in storeys above the ground, where known.
        best: the layout that is worth most.
        others: the next ones that the search met.
        compared: other layouts by their names, for comparison.
        by_number: the best layouts of one sensor and more.
        knee: the smallest number of sensors with nearly all of the gain.
        left_out: sensors of the best layout, and the gain without each.
        added: candidates, and the gain with each.
        smaller_errors: the gain with errors half as large.
        greatest: what no test can exceed; None where the aim is not the class.
        is_exhaustive: whether all layouts of that many sensors were tried.
        n_tried: number of layouts tried.
        other_start: gain that the search finds from the layout of effective independence, less that
            of the best; None where all layouts were tried.
        effective_draws: about a simulated test, of its own class, the median.
        bias: of the best gain, expected from the few draws.
        failed_checks: why these numbers may be wrong, a sentence each.
        geometry: of the structure, for drawings.
    """

    name: str
    candidates: tuple[Candidate, ...]
    heights: Mapping[str, float]
    best: Layout
    others: tuple[Layout, ...]
    compared: Mapping[str, Layout]
    by_number: tuple[Layout, ...]
    knee: int
    left_out: tuple[Change, ...]
    added: tuple[Change, ...]
    smaller_errors: Change
    greatest: float | None
    is_exhaustive: bool
    n_tried: int
    other_start: float | None
    effective_draws: float
    bias: float
    failed_checks: tuple[str, ...]
    geometry: Geometry | None


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Displayed):
    """The plan of a test: layouts of sensors, for one or more alternative configurations.

    Attributes:
        study: its name.
        aim: "class", "parameters", or the name of a parameter or prediction.
        n_sensors: that the layouts have.
        classes: model class → its probability before the test.
        is_after_a_test: whether earlier modes are known, and not the priors alone.
        n_tests: number of simulated tests.
        n_draws: parameter values of each class about each of them.
        seed: of the simulation.
        configurations: the alternatives.
    """

    study: str
    aim: str
    n_sensors: int
    classes: Mapping[str, float]
    is_after_a_test: bool
    n_tests: int
    n_draws: int
    seed: int
    configurations: tuple[ConfigurationPlan, ...]

    @property
    def best(self) -> ConfigurationPlan:
        """The alternative whose best layout is worth most."""
        return max(self.configurations, key=lambda each: each.best.gain)

    @property
    def failed_checks(self) -> tuple[str, ...]:
        """Failed checks of all alternatives, a sentence each."""
        return tuple(
            f"{each.name}: {check}" if each.name else check
            for each in self.configurations
            for check in each.failed_checks
        )

    def _line(self) -> str:
        best = self.best
        where = f" in {best.name!r}" if best.name else ""
        sensors = ", ".join(best.best.sensors)
        return f"for {self.aim!r}: {sensors}{where}, {best.best.gain:.3f} nats"

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {"configuration": each.name or None, "layout": ", ".join(layout.sensors),
             "gain": layout.gain, "error": layout.error, "naming": layout.naming}
            for each in self.configurations
            for layout in (each.best, *each.others)
        ]  # fmt: skip
