"""Imports only go down one list of modules, and starting up loads nothing heavy."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import bayes_ssi

PACKAGE = Path(bayes_ssi.__file__).parent
# Each may import those above it.
ORDER = [
    "priors", "parameters", "modal", "sensors", "structures", "ground_motion",
    "ground_motion_files", "time_stepping", "response", "data", "modal_csv", "modal_uff",
    "modal_pyoma2", "errors", "shape_density", "likelihood", "pairings", "any_pairing",
    "inferred_pairing", "description", "configuration", "model_class", "updated_modes",
    "datum_terms", "configuration_modes", "calibration", "evaluation", "journal", "in_workers",
    "dispatch", "workers", "target", "mixture", "moves", "maxima", "discovery", "tempering",
    "regions", "production", "evidence", "sampled", "economical", "sampling", "checks",
    "posterior", "reduction", "versions", "checkpoint", "comparison", "averages",
    "progress_files", "class_sampling", "study", "sensitivity", "search", "arviz_store",
    "new_directory", "results", "class_draws", "predictions", "stored_classes",
    "stored_predictions", "prediction_answers", "prediction_modes", "prediction_defaults",
    "prediction_files", "tables", "figure_style", "plots", "response_plots", "mode_plots",
    "summary_plots", "prediction_figures", "report", "terminal", "study_argument", "saved_run",
    "scaffold", "commands", "cli",
]  # fmt: skip
# Methods load and save are one line each that hand over to the file format.
EXCEPTIONS = {
    ("data", "modal_csv"),
    ("data", "modal_uff"),
    ("data", "modal_pyoma2"),
    ("ground_motion", "ground_motion_files"),
}
# Packages, whose modules may import one another.
PACKAGES = {"structures", "tables", "commands", "report"}
HEAVY = {"matplotlib", "arviz", "corner", "emcee", "jinja2", "h5py", "rich"}
SOURCES = sorted(p for p in PACKAGE.rglob("*.py") if p.parent != PACKAGE or p.stem != "__init__")


def layer(path):
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imported_layers(path):
    """Modules of the package that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for name in names:
            if name.split(".")[0] == "bayes_ssi":
                yield name.split(".")[1] if "." in name else "bayes_ssi"


def test_every_module_has_its_place():
    assert {layer(path) for path in SOURCES} == set(ORDER)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_go_down(path):
    own = layer(path)
    for other in imported_layers(path):
        if other == own in PACKAGES or (own, other) in EXCEPTIONS:
            continue
        assert other in ORDER, f"{own} imports {other}"
        assert ORDER.index(other) < ORDER.index(own), f"{own} imports {other}"


def test_the_reader_of_imports_sees_lazy_ones():
    assert "emcee" not in set(imported_layers(PACKAGE / "production.py"))
    assert {"mixture", "moves", "target"} <= set(imported_layers(PACKAGE / "production.py"))


@pytest.mark.parametrize(
    "start",
    [
        "import bayes_ssi",
        "from bayes_ssi.cli import main; main(['--help'], standalone_mode=False)",
        "from bayes_ssi.cli import main; main(['rank', '--help'], standalone_mode=False)",
    ],
)
def test_starting_up_loads_nothing_heavy(start):
    code = f"{start}\nimport sys\nprint('\\nloaded:', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = done.stdout.split("loaded:")[1].split()
    assert "bayes_ssi" in loaded
    assert HEAVY.isdisjoint(loaded)
