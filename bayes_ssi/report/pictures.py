"""The figures of a report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.model_class.configuration import label_in
from bayes_ssi.plots.changes import plot_mac_change, plot_modes_before_and_after
from bayes_ssi.plots.corner_plot import corner_size, plot_corner
from bayes_ssi.plots.identified_modes import data_size, plot_identified_modes, plot_pairing
from bayes_ssi.plots.mode_shapes import plot_mode_shapes, shapes_size
from bayes_ssi.plots.place_map import plot_places
from bayes_ssi.plots.ranking_plots import plot_evidence, plot_frequencies
from bayes_ssi.plots.style import style
from bayes_ssi.plots.summaries import plot_parameters, plot_sensitivity
from bayes_ssi.posterior.configuration_modes import ConfigurationModes
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.posterior.updated_modes import UpdatedModes
from bayes_ssi.ranking.comparison import Comparison
from bayes_ssi.report.stored_extras import StoredExtras
from bayes_ssi.results.load import StoredResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

from bayes_ssi.report.picture import Picture, png_figure, saved_figure, svg_figure

__all__ = ["Pictures", "draw"]

# A figure with more classes, or a corner plot with more parameters, has no room on a page.
MOST_CLASSES, MOST_IN_CORNER = 12, 6
# Model classes whose modes are drawn, and whose parameters are drawn against one another.
MOST_DRAWN, MOST_CORNERS = 2, 2
FITS_DRAWN = 5
# A class is drawn if it is at least so probable; the first one in any case, and of one test, where
# there are few figures, the second one, too.
WORTH_DRAWING = 0.01


@dataclass(frozen=True)
class Pictures:
    """The figures of a report, by what they belong to."""

    evidence: Picture
    sensitivity: Picture | None
    places: Picture | None
    tests: dict[str, list[Picture]]
    classes: dict[str, list[Picture]]
    predictions: list[Picture]

    def of_test(self, name: str) -> list[Picture]:
        return self.tests.get(name, [])

    def of_class(self, name: str) -> list[Picture]:
        return self.classes.get(name, [])


def draw(
    stored: StoredResult, beside: StoredExtras, progress: Callable[[float], object] = float
) -> Pictures:
    """Every figure of a report, from stored records; progress is told the share that is done."""
    from matplotlib import rc_context

    ranked = stored.ranked_posteriors
    top = stored.comparison.classes
    drawn = [
        row.name
        for i, row in enumerate(top)
        if i < (2 if len(stored.tests) == 1 else 1)
        or row.probability >= WORTH_DRAWING
        or not row.distinguishable
    ][:MOST_DRAWN]
    cornered = [row.name for row in top if row is top[0] or not row.distinguishable]
    # Drawings are the same, to the letter, whenever they are made.
    with style(), rc_context({"svg.hashsalt": "bayes_ssi"}):
        evidence, tests = _evidence(stored.comparison), {}
        for i, name in enumerate(stored.tests):
            tests[name] = _of_test(stored, i, ranked)
        progress(0.3)
        classes = {}
        for i, name in enumerate(drawn):
            corner = name in cornered[:MOST_CORNERS]
            classes[name] = _of_class(stored, stored.posterior(name), i, corner)
            progress(0.3 + 0.6 * (i + 1) / len(drawn))
        return Pictures(
            evidence=evidence,
            sensitivity=_sensitivity(beside),
            places=_places(beside),
            tests=tests,
            classes=classes,
            predictions=_predictions(beside),
        )


def _evidence(comparison: Comparison) -> Picture:
    best = replace(comparison, classes=comparison.classes[:MOST_CLASSES])

    def plot(figure: Figure) -> None:
        plot_evidence(best, figure.subplots())

    size = (6.4, 1.3 + 0.42 * len(best.classes))
    return svg_figure("evidence", "Log evidence of every model class", plot, size)


def _of_test(stored: StoredResult, i: int, ranked: tuple[Posterior, ...]) -> list[Picture]:
    name, data = list(stored.tests.items())[i]
    told = f" of configuration {name}" if name else ""

    def plot_data(figure: Figure) -> None:
        plot_identified_modes(data, figure, name)

    def plot_fits(figure: Figure) -> None:
        plot_frequencies(data, ranked[:FITS_DRAWN], figure.subplots(), name)

    alt = f"Model frequencies{told} beside the identified ones"
    return [
        svg_figure(f"data_{i + 1}", f"The identified modes{told}", plot_data, data_size(data)),
        svg_figure(
            f"frequencies_{i + 1}", alt, plot_fits, (max(6.4, 0.7 + 0.72 * len(data.modes)), 3.4)
        ),
    ]


def _of_class(
    stored: StoredResult, posterior: Posterior, i: int, with_corner: bool
) -> list[Picture]:
    found: list[Picture] = []
    told = f"of class {posterior.name!r}"
    for k, modes in enumerate(posterior.configurations):
        number = f"{i + 1}_{k + 1}"
        found += _of_modes(modes, stored.tests[modes.name], number, told)
    records = {each["name"]: each for each in stored.record["model_classes"]}
    own = records[posterior.name]["parameters"]
    priors = {each["name"]: each.get("prior_quantiles") for each in own}
    if all(priors.values()):

        def plot(figure: Figure) -> None:
            plot_parameters(posterior, priors, figure.subplots())

        alt = f"Parameters {told} before and after"
        found.append(svg_figure(f"parameters_{i + 1}", alt, plot, (6.4, 1.3 + 0.3 * len(priors))))
    if with_corner:
        found.append(_corner(posterior, i, told))
    return found


def _of_modes(
    modes: ConfigurationModes, data: ModalData, number: str, told: str
) -> Iterator[Picture]:
    """Shapes, frequencies and MACs, and the pairing, of one configuration of a class."""
    where = label_in(modes.name, "")
    updated, inferred = modes.updated, modes.inferred_pairing
    if updated is not None and updated.modes:

        def plot_shapes(figure: Figure) -> None:
            plot_mode_shapes(updated, data, figure)

        alt = f"{where}Mode shapes {told} on the structure"
        yield svg_figure(f"shapes_{number}", alt, plot_shapes, shapes_size(updated))
        yield _before_and_after(f"modes_{number}", f"{where}Modes {told}", updated, data)
    if inferred is not None:

        def plot_pairs(figure: Figure) -> None:
            plot_pairing(inferred, modes.n_modes, figure.subplots())

        size = min(7.0, 1.6 + 0.62 * (1 + modes.n_modes)), 1.1 + 0.34 * len(inferred.of_modes)
        yield svg_figure(
            f"pairing_{number}", f"{where}Probabilities of pairings {told}", plot_pairs, size
        )


def _before_and_after(name: str, alt: str, updated: UpdatedModes, data: ModalData) -> Picture:
    scored = sum(mode.mac_after is not None for mode in updated.modes)
    heights = [1.4 + 0.4 * len(updated.modes), *([1.4 + 0.35 * scored] if scored else [])]

    def plot(figure: Figure) -> None:
        panels = figure.subfigures(len(heights), squeeze=False, height_ratios=heights)[:, 0]
        plot_modes_before_and_after(updated, data, panels[0].subplots())
        if scored:
            plot_mac_change(updated, panels[1].subplots())

    return svg_figure(name, f"{alt} before and after updating", plot, (6.4, sum(heights)))


def _corner(posterior: Posterior, i: int, told: str) -> Picture:
    """Of many parameters, those that the data tell most about."""
    order = sorted(
        range(len(posterior.parameter_names)), key=posterior.relative_spreads.__getitem__
    )
    chosen = sorted(order[:MOST_IN_CORNER])
    names = [posterior.parameter_names[k] for k in chosen]
    alt = f"Joint posterior densities {told}"
    if len(names) < len(order):
        alt += f", the {len(names)} parameters that the data tell most about"

    def plot(figure: Figure) -> None:
        plot_corner(posterior, figure, names)

    return png_figure(f"corner_{i + 1}", alt, plot, corner_size(len(names)))


def _sensitivity(beside: StoredExtras) -> Picture | None:
    found = beside.sensitivity
    if found is None or len(found.rows[0].probabilities) < 2:
        return None

    def plot(figure: Figure) -> None:
        plot_sensitivity(found, figure.subplots())

    size = (6.4, 1.4 + 0.3 * len(found.rows))
    return svg_figure("sensitivity", "How the ranking moves with settings", plot, size)


def _places(beside: StoredExtras) -> Picture | None:
    found = beside.search
    if found is None or not found.places:
        return None

    def plot(figure: Figure) -> None:
        plot_places(found.places, figure.subplots())

    size = (4.6, 1.2 + 0.7 * max(max(place.floors) for place in found.places))
    return svg_figure("places", "Probability of an appendage, place by place", plot, size)


def _predictions(beside: StoredExtras) -> list[Picture]:
    found = beside.predictions
    if found is None:
        return []
    pictures = []
    for path in found.figures:
        told = "MAC with the identified shapes" if path.stem == "mac" else path.stem
        alt = f"Predictions: {told.replace('_', ' ')}"
        pictures.append(saved_figure(f"prediction_{path.stem}", alt, path))
    return pictures
