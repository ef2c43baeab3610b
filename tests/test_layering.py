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
    "arrays": (), "versions": (), "codec": (), "file_names": (),
    "priors": FREE, "parameters": (), "modal": (),
    "structures": FREE, "finite_elements": FREE,
    "response": FREE,
    "data": FREE,
    "identification": FREE,
    "model_class": FREE,
    "execution": FREE,
    "sampling": FREE,
    "calibration": FREE,
    "posterior": FREE,
    "ranking": FREE,
    "appendages": FREE,
    "results": FREE,
    "predictions": FREE,
    "tables": FREE,
    "plots": FREE,
    "report": FREE,
    "commands": FREE,
    "cli": (),
}  # fmt: skip
HEAVY = {"matplotlib", "arviz", "emcee", "jinja2", "h5py", "rich"}
LIST = [
    layer
    for package, modules in ORDER.items()
    for layer in ([f"{package}.{module}" for module in modules] if modules else [package])
]
# What builds the guide is run by Sphinx and Hatchling, and is no part of the package.
SOURCES = sorted(
    path
    for path in PACKAGE.rglob("*.py")
    if path.stem != "__init__" and path.parent.name != "guide"
)


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
        if other == own and ORDER[own] is FREE:
            continue
        assert other in LIST, f"{own} imports {other}"
        assert LIST.index(other) < LIST.index(own), f"{own} imports {other}"


@pytest.mark.parametrize("package", [name for name, modules in ORDER.items() if modules])
def test_a_package_shows_its_own_modules(package):
    shown = set(imported_layers(PACKAGE / package / "__init__.py"))
    assert {name.split(".")[0] for name in shown} <= {package}


def test_the_reader_of_imports_sees_lazy_ones():
    found = set(imported_layers(PACKAGE / "sampling" / "ensembles.py"))
    assert "emcee" not in found
    assert {"sampling", "arrays"} <= found


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
