"""The figures of a report: which it shows, and where.

To add one, state its caption and draw it in the section that shows it.
"""

import base64
import io
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_ssi import plots
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.figure_style import HOVER, MOST_CLASSES, RC, figures_for_files, whole_figure
from bayes_ssi.results.stored_result import StoredResult
from bayes_ssi.structures.modal import SHAPE_SCALE
from bayes_ssi.studies.planning.plan_record import Plan
from bayes_ssi.studies.search.findings import FamilyRecord

# A caption, and the figure that is drawn when it is asked for.
Plot = tuple[str, Axes | Figure]


# Most items of each kind that a report shows; the result directory holds the others.
LIMITS = SimpleNamespace(
    classes=8,
    hypotheses=12,
    places=12,
    sensors=8,
    classes_with_modes=2,
    classes_in_frequencies=5,
    parameters_in_corner=6,
    column_width=448,  # pixels of one of two columns of figures on the page
    # Smallest probability of a class that is drawn, unless it is the first, or the second of one
    # test, or cannot be distinguished from the first.
    least_probability=0.01,
)


@dataclass(frozen=True)
class EmbeddedFigure:
    """One figure, as part of the page; its width is in pixels of 1/96 in."""

    caption: str
    html: str
    width: int

    @property
    def is_wide(self) -> bool:
        return bool(self.width > LIMITS.column_width)


def embedded_drawing(figure: Figure, caption: str, prefix: str) -> EmbeddedFigure:
    """A figure as an SVG drawing whose points show their hover texts."""
    figure.set_dpi(72)  # SVG is drawn in points
    # Laid out once: a figure that is saved with its layout engine is drawn twice.
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None}, transparent=True)
    svg = file.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(rf'<g id="{HOVER}([^"]*)"', r'<g class="point" tabindex="0" data-tip="\1"', svg)
    svg = re.sub(r'\bid="([^"]*)"', rf'id="{prefix}.\1"', svg)
    svg = re.sub(r'href="#([^"]*)"', rf'href="#{prefix}.\1"', svg)
    svg = re.sub(r"url\(#([^)]*)\)", rf"url(#{prefix}.\1)", svg)
    html = svg.replace("<svg", f'<svg role="img" aria-label="{escape(caption, quote=True)}"', 1)
    return EmbeddedFigure(caption, html, round(96 * figure.get_figwidth()))


def embedded_file(path: Path, caption: str) -> EmbeddedFigure:
    """A PNG file saved in the package's style, at its intended size."""
    content = path.read_bytes()
    if not content.startswith(b"\x89PNG\r\n\x1a\n") or len(content) < 24:
        raise ValueError(f"{path}: damaged: not a PNG file")
    pixels = int.from_bytes(content[16:20], "big")  # the width, first of the first chunk
    width = round(96 * pixels / RC["savefig.dpi"])
    data = base64.b64encode(content).decode("ascii")
    alt = escape(caption, quote=True)
    html = f'<img alt="{alt}" width="{width}" src="data:image/png;base64,{data}">'
    return EmbeddedFigure(caption, html, width)


def draw_figures(
    stored: StoredResult, predictions: Mapping[str, Any], plan: Plan | None = None
) -> dict[str, list[EmbeddedFigure]]:
    """The figures of a report by section: ``"test NAME"`` and ``"class NAME"`` are of one each."""
    figures: dict[str, list[EmbeddedFigure]] = defaultdict(list)
    with figures_for_files():
        for i, (section, caption, plot) in enumerate(_drawn(stored, plan), 1):
            figures[section].append(embedded_drawing(whole_figure(plot), caption, f"figure-{i}"))
    for path in predictions.get("figures", ()):
        caption = f"Predictions: {path.stem.replace('_', ' ')}"
        figures["predictions"].append(embedded_file(path, caption))
    return figures


def _drawn(stored: StoredResult, plan: Plan | None) -> Iterator[tuple[str, str, Axes | Figure]]:
    """The section, the caption and the drawing of each figure, drawn one after the other."""
    evidence = plots.plot_evidence(stored.comparison, most=MOST_CLASSES)
    yield "ranking", "Log evidence of every model class", evidence
    if stored.search is not None:
        caption = f"Probability of {stored.search.a_feature} by place, over all hypotheses"
        yield "search", caption, plots.plot_places(stored.search)
    if plan is not None:
        yield "plan", "Sensors of the next test", plots.plot_layout(plan)
    for name, data in stored.tests.items():
        for caption, plot in _of_test(name, data, stored.ranked_posteriors):
            yield f"test {name}", caption, plot
    for name, with_corner in _drawn_classes(stored):
        for caption, plot in _of_class(stored, stored.posterior(name), with_corner):
            yield f"class {name}", caption, plot


def _drawn_classes(stored: StoredResult) -> Iterator[tuple[str, bool]]:
    """Names of the classes that are drawn, and whether their joint densities are."""
    rows = stored.comparison.classes
    always = 2 if len(stored.tests) == 1 else 1
    least = LIMITS.least_probability
    chosen = (r for r in rows[always:] if r.probability >= least or not r.distinguishable)
    for row in [*rows[:always], *chosen][: LIMITS.classes_with_modes]:
        yield row.name, row is rows[0] or not row.distinguishable


def _of_test(name: str, data: ModalData, ranked: tuple[Posterior, ...]) -> Iterator[Plot]:
    where = label_in(name, "")
    best = ranked[: LIMITS.classes_in_frequencies]
    scale = "; shapes are scaled to a largest component of ±1" if data.sensors else ""
    yield f"{where}Identified modes{scale}", plots.plot_identified_modes(data, configuration=name)
    frequencies = plots.plot_frequencies(data, best, configuration=name)
    yield f"{where}Model frequencies relative to the identified ones", frequencies


def _of_class(stored: StoredResult, posterior: Posterior, with_corner: bool) -> Iterator[Plot]:
    of = f"of model class {posterior.name!r}"
    for modes in posterior.configurations:
        if modes.updated.modes and modes.updated.places:
            shapes = plots.plot_mode_shapes(modes.updated, stored.tests[modes.name])
            yield f"{label_in(modes.name, '')}Mode shapes {of}, {SHAPE_SCALE}", shapes
    if with_corner:
        parameters = stored.record.model_class(posterior.name).parameters
        units = {each.name: each.unit for each in parameters if each.unit}
        names = _of_most_interest(posterior, stored.search)
        few = len(names) < len(posterior.parameter_names)
        first = stored.search and f"those of the {stored.search.feature}s, and "
        which = f"{first or ''}the best determined ones"
        note = f": {len(names)} parameters, {which}" if few else ""
        corner = plots.plot_corner(posterior, parameters=names, units=units)
        yield f"Joint posterior densities {of}{note}", corner


def _of_most_interest(posterior: Posterior, search: FamilyRecord | None) -> list[str]:
    """Parameters of features, then those whose spread the data reduce most; in their order."""
    of_baselines = [each.name for each in search.averaged_parameters] if search else []
    spreads = dict(zip(posterior.parameter_names, posterior.relative_spreads, strict=True))
    ordered = sorted(spreads, key=lambda name: (name in of_baselines, spreads[name]))
    return [name for name in spreads if name in ordered[: LIMITS.parameters_in_corner]]
