"""Imports go one way, names stand for one thing, and starting up loads nothing heavy."""

import ast
import subprocess
import sys
from collections import Counter
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import bayes_ssi

PACKAGE = Path(bayes_ssi.__file__).parent
# Packages, and modules outside of any, each of which may import those before it.
ORDER = (
    "arrays", "argument_types", "versions", "codec", "file_names", "text_files", "universal_files",
    "error_places", "partial_imports",
    "priors", "parameters", "repeated_modes", "modal",
    "structures", "finite_elements", "solver_files", "response",
    "data", "identification", "records", "model_class",
    "execution", "sampling", "calibration", "posterior",
    "ranking", "appendages",
    "results", "predictions", "hierarchical",
    "tables", "plots", "report", "api",
    "commands", "cli",
)  # fmt: skip
HEAVY = {
    "numpy",
    "scipy",
    "matplotlib",
    "arviz",
    "corner",
    "emcee",
    "jinja2",
    "h5py",
    "h5netcdf",
    "rich",
    "pandas",
    "xarray",
}


def module_name(path):
    parts = ("bayes_ssi", *path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


# What builds the guide is run by Sphinx and Hatchling, and is no part of the package.
TREES = {
    module_name(path): ast.parse(path.read_text("utf-8"))
    for path in sorted(PACKAGE.rglob("*.py"))
    if path.parent.name != "guide"
}
MODULES = [name for name in TREES if not (PACKAGE.parent / name.replace(".", "/")).is_dir()]


def imported(tree):
    """Modules of the package that a module imports, anywhere in it, also inside functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in TREES else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


IMPORTS = {name: set(imported(tree)) & set(TREES) for name, tree in TREES.items()}


def layer(name):
    return name.split(".")[1]


def test_every_module_has_its_place():
    assert {layer(name) for name in TREES if name != "bayes_ssi"} == set(ORDER)


@pytest.mark.parametrize("name", [name for name in TREES if name != "bayes_ssi"])
def test_imports_go_down(name):
    assert "bayes_ssi" not in IMPORTS[name]
    for other in IMPORTS[name]:
        assert ORDER.index(layer(other)) <= ORDER.index(layer(name)), f"{name} imports {other}"


def test_no_imports_go_in_a_circle():
    try:
        TopologicalSorter(IMPORTS).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


def test_circles_and_imports_inside_functions_would_be_seen():
    tree = ast.parse("def f():\n    from bayes_ssi.priors.families import Normal")
    assert set(imported(tree)) == {"bayes_ssi.priors.families"}
    assert IMPORTS["bayes_ssi.api"] >= {"bayes_ssi.parameters", "bayes_ssi.model_class.model_class"}
    with pytest.raises(CycleError):
        TopologicalSorter({"a": {"b"}, "b": {"a"}}).prepare()


def repeated(names):
    return [name for name, count in Counter(names).items() if count > 1]


def test_no_two_modules_have_one_name():
    assert repeated(name.split(".")[-1] for name in MODULES) == []


def test_no_two_public_classes_have_one_name():
    classes = (
        node.name
        for tree in TREES.values()
        for node in tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert repeated(classes) == []


@pytest.mark.parametrize(
    "start",
    [
        "import bayes_ssi",
        "from bayes_ssi.cli import main; main(['--version'], standalone_mode=False)",
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


@pytest.mark.parametrize("name", MODULES)
def test_modules_import_what_takes_long_where_they_use_it(name):
    slow = {"scipy.stats", "matplotlib", "arviz", "corner", "h5py", "h5netcdf"}
    statements = [
        node for node in TREES[name].body if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    imports = {
        alias.name if isinstance(node, ast.Import) else node.module
        for node in statements
        for alias in node.names
    }
    assert slow.isdisjoint(imports)
