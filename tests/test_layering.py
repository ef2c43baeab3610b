"""Imports only go down one list of modules, and starting up loads nothing heavy."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import bayes_ssi

PACKAGE = Path(bayes_ssi.__file__).parent
# Each may import those above it. Of a package without a list, modules may import one another.
FREE = None
ORDER = {
    "priors": FREE, "parameters": (), "modal": (), "sensors": (), "versions": (),
    "new_directory": (),
    "structures": FREE,
    "response": (
        "ground_motion", "ground_motion_files", "time_stepping", "output", "modal_response",
    ),
    "data": ("identified_mode", "modal_data", "modal_csv", "modal_uff", "modal_pyoma2"),
    "identification": (
        "error_model", "shape_density", "paired_modes", "likelihood", "pairings",
        "any_pairing", "inferred_pairing",
    ),
    "model_class": ("description", "configuration", "model_class", "records"),
    "evaluation": ("batch", "journal", "in_workers", "futures", "dispatch", "workers"),
    "sampling": (
        "target", "mixture", "moves", "maxima", "discovery", "tempering", "regions",
        "production", "evidence", "sampled", "economical", "engine",
    ),
    "updating": (
        "updated_modes", "datum_terms", "configuration_modes", "calibration_problem", "calibration",
        "checks", "posterior", "to_posterior", "reduction",
    ),
    "ranking": (
        "checkpoint", "comparison", "averages", "progress_files", "class_sampling", "study",
        "sensitivity", "hypotheses", "found", "search",
    ),
    "results": ("arviz_store", "json_files", "result_directory", "saving", "stored_classes"),
    "predictions": (
        "class_draws", "bands", "predictions", "stored", "answers", "modes", "defaults", "files",
    ),
    "tables": FREE,
    "plots": (
        "style", "corner", "results", "places", "responses", "shapes", "changes", "modes",
        "mode_shapes", "summaries", "predictions",
    ),
    "report": FREE,
    "commands": FREE,
    "cli": (),
}  # fmt: skip
# Methods load and save are one line each that hand over to the file format.
EXCEPTIONS = {
    ("data.modal_data", "data.modal_csv"),
    ("data.modal_data", "data.modal_uff"),
    ("data.modal_data", "data.modal_pyoma2"),
    ("response.ground_motion", "response.ground_motion_files"),
}
HEAVY = {"matplotlib", "arviz", "corner", "emcee", "jinja2", "h5py", "rich"}
LIST = [
    layer
    for package, modules in ORDER.items()
    for layer in ([f"{package}.{module}" for module in modules] if modules else [package])
]
SOURCES = sorted(p for p in PACKAGE.rglob("*.py") if p.stem != "__init__")


def layer(path):
    """The place of a file: its package, where modules of that may import one another."""
    return layer_of(".".join(path.relative_to(PACKAGE).with_suffix("").parts))


def layer_of(module):
    parts = module.split(".")
    return ".".join(parts[:2]) if ORDER.get(parts[0]) else parts[0]


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
                yield layer_of(name.partition(".")[2]) if "." in name else "bayes_ssi"


def test_every_module_has_its_place():
    assert {layer(path) for path in SOURCES} == set(LIST)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_go_down(path):
    own = layer(path)
    for other in imported_layers(path):
        if (other == own and ORDER[own] is FREE) or (own, other) in EXCEPTIONS:
            continue
        assert other in LIST, f"{own} imports {other}"
        assert LIST.index(other) < LIST.index(own), f"{own} imports {other}"


@pytest.mark.parametrize("package", [name for name, modules in ORDER.items() if modules])
def test_a_package_shows_its_own_modules(package):
    shown = set(imported_layers(PACKAGE / package / "__init__.py"))
    assert {name.split(".")[0] for name in shown} <= {package}


def test_the_reader_of_imports_sees_lazy_ones():
    found = set(imported_layers(PACKAGE / "sampling" / "production.py"))
    assert "emcee" not in found
    assert {"sampling.mixture", "sampling.moves", "sampling.target"} <= found


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
