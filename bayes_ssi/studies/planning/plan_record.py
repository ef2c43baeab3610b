"""What a plan says, and the form that a test's modes go into."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bayes_ssi.foundations.displayed import InWords
from bayes_ssi.structures.geometry import Candidate, Geometry

# Aims of a plan that have a name.
CLASS, PARAMETERS = "class", "parameters"
# Where a result's report finds the plan of the next test.
SAVED = Path("plan", "plan.json")


@dataclass(frozen=True)
class Layout:
    """Sensors of a planned test, and what it is worth.

    Attributes:
        sensors: names of the candidates that are measured.
        band_hz: of the test.
        gain: expected information, in nats, and ``error``, its standard error.
        naming: probability that the class that is right is the most probable one after the test,
            where that is the aim.
        largest_mac: of two different modes in the band, at these sensors; NaN for one sensor.
    """

    sensors: tuple[str, ...]
    band_hz: tuple[float, float]
    gain: float
    error: float
    naming: float | None
    largest_mac: float

    def write_template(self, path: str | Path) -> None:
        """Write the form of a file of modes, which :func:`bayes_ssi.read_modal_data` reads.

        A column for each sensor, and rows for eight modes, to be filled in, or left out.

        Raises:
            FileExistsError: the file exists.
        """
        names = ["label", "frequency_hz", "frequency_cov", "shape_sd", "damping", *self.sensors]
        with Path(path).open("x", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["# source", "fill in: test and date"])
            writer.writerow(["# band_hz", *map(repr, self.band_hz)])
            writer.writerow(names)
            writer.writerows([str(number), *[""] * (len(names) - 1)] for number in range(1, 9))


@dataclass(frozen=True, eq=False, repr=False)
class Plan(InWords):
    """The plan of a test.

    Attributes:
        study: its name.
        aim: "class", "parameters", or the name of a parameter or prediction.
        classes: model class → its probability before the test.
        is_after_a_test: whether an earlier test is known, and not the priors alone.
        configuration: in which the best layout is worth most; empty where it has no name.
        layouts: the best layouts there, the best first.
        compared: other layouts, for comparison, by what they are.
        alternatives: configuration → its best layout, where there are several.
        by_number: the best layouts of fewer sensors, and the best of all.
        knee: the smallest number of sensors with nearly all of the gain.
        greatest: the gain that no test can exceed, where the aim is the class.
        n_tried: layouts that were tried, and ``is_exhaustive``, whether these are all.
        other_start: gain where the search ends from effective independence, less the best's.
        n_tests: simulated tests.
        effective_draws: of a class about a test that it gave, the median.
        bias: of the best gain, expected from few draws.
        failed_checks: why these numbers may be wrong, a sentence each.
        candidates: where sensors may be.
        geometry: of the structure, for drawings.
    """

    study: str
    aim: str
    classes: Mapping[str, float]
    is_after_a_test: bool
    configuration: str
    layouts: tuple[Layout, ...]
    compared: Mapping[str, Layout]
    alternatives: Mapping[str, Layout]
    by_number: tuple[Layout, ...]
    knee: int
    greatest: float | None
    n_tried: int
    is_exhaustive: bool
    other_start: float
    n_tests: int
    effective_draws: float
    bias: float
    failed_checks: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    geometry: Geometry

    @property
    def best(self) -> Layout:
        """The layout that is worth most."""
        return self.layouts[0]

    def _line(self) -> str:
        return f"for {self.aim!r}: {', '.join(self.best.sensors)}, {self.best.gain:.3f} nats"

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {"layout": ", ".join(layout.sensors), "gain": layout.gain, "error": layout.error,
             "naming": layout.naming, "largest MAC": layout.largest_mac}
            for layout in self.layouts
        ]  # fmt: skip
