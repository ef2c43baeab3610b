"""Imports go one way, names stand for one thing, and starting up loads nothing heavy."""

import ast
import subprocess
import sys
from collections import Counter
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import bayes_ssi

PACKAGE = Path(bayes_ssi.__file__).parent
# Wings, and modules outside of any, each of which may import those before it.
ORDER = (
    "foundations", "parameters", "structures", "measurements", "inference", "studies", "results",
    "plots", "report", "api", "commands", "cli", "__main__",
)  # fmt: skip
# The same of the folders of a wing; its own modules, "", have a place among them.
FOLDERS = {
    "structures": ("", "finite_elements", "emulation", "solver_files"),
    "measurements": ("modes", "records"),
    "inference": ("likelihood", "model_class", "workers", "sampling", "calibration", "criticism",
                  "posterior", "posterior_sampling"),
    "studies": ("ranking", "search", "appendages", "changes", "planning", ""),
    "results": ("", "predictions", "hierarchy"),
    "report": ("tables", ""),
}  # fmt: skip
HEAVY = {
    "numpy", "scipy", "matplotlib", "arviz", "arviz_stats", "corner", "emcee", "jinja2", "h5py",
    "h5netcdf", "rich", "pandas", "xarray",
}  # fmt: skip


@cache
def trees():
    """The code of every module but those that Sphinx and Hatchling run to build the guide."""
    paths = [path for path in sorted(PACKAGE.rglob("*.py")) if path.parent.name != "guide"]
    names = (".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts) for path in paths)
    return {
        name.removesuffix(".__init__"): ast.parse(path.read_text("utf-8"))
        for name, path in zip(names, paths, strict=True)
    }


@cache
def modules():
    return [name for name in trees() if not (PACKAGE.parent / name.replace(".", "/")).is_dir()]


def imported(tree):
    """Modules of the package that a module imports or names, also inside functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in trees() else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            # Such as what import_module would load.
            yield from {node.value} & trees().keys() - {"bayes_ssi"}


@cache
def imports():
    return {name: set(imported(tree)) & set(trees()) for name, tree in trees().items()}


def layer(name):
    """The wing of a module, and its folder there, by number from below."""
    _, wing, *inside = name.split(".")
    folders = FOLDERS.get(wing, ("",))
    folder = inside[0] if inside and f"bayes_ssi.{wing}.{inside[0]}" not in modules() else ""
    # A wing's own name stands for all that its folders offer.
    return ORDER.index(wing), folders.index(folder) if inside else len(folders)


def test_every_module_has_its_place():
    for name in trees():
        assert name == "bayes_ssi" or layer(name)


def test_imports_go_down():
    arrows = [(name, other) for name in trees() if name != "bayes_ssi" for other in imports()[name]]
    assert [a for a in arrows if a[1] == "bayes_ssi" or layer(a[1]) > layer(a[0])] == []


def test_no_imports_go_in_a_circle():
    try:
        TopologicalSorter(imports()).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


def test_circles_and_imports_inside_functions_would_be_seen():
    tree = ast.parse("def f():\n    from bayes_ssi.parameters.priors import Normal")
    assert set(imported(tree)) == {"bayes_ssi.parameters.priors"}
    by_name = ast.parse('WORDS = "bayes_ssi.results.answer"')
    assert set(imported(by_name)) == {"bayes_ssi.results.answer"}
    assert imports()["bayes_ssi.api"] >= {
        "bayes_ssi.parameters.parameters",
        "bayes_ssi.inference.model_class.model_class",
    }
    with pytest.raises(CycleError):
        TopologicalSorter({"a": {"b"}, "b": {"a"}}).prepare()


def repeated(names):
    return [name for name, count in Counter(names).items() if count > 1]


def test_no_two_modules_have_one_name():
    assert repeated(name.split(".")[-1] for name in modules()) == []


def test_no_two_public_classes_have_one_name():
    classes = (
        node.name
        for tree in trees().values()
        for node in tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert repeated(classes) == []


@pytest.mark.parametrize(
    ("start", "heavy"),
    [
        ("import bayes_ssi", HEAVY),
        *(
            (f"from bayes_ssi.cli import main; main({words}, standalone_mode=False)", HEAVY)
            for words in (["--version"], ["--help"], ["rank", "--help"])
        ),
        # The guide's page of all public names is made where samplers and plots are not installed.
        ("import bayes_ssi.api", HEAVY - {"numpy", "scipy"}),
    ],
)
def test_starting_up_loads_nothing_heavy(start, heavy):
    code = f"{start}\nimport sys\nprint('\\nloaded:', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = done.stdout.split("loaded:")[1].split()
    assert "bayes_ssi" in loaded
    assert heavy.isdisjoint(loaded)


def named(nodes):
    """The modules, of any package, that import statements among nodes name."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield str(node.module)


def test_modules_import_what_takes_long_where_they_use_it():
    """Plots themselves are imported where they are drawn: they may import matplotlib."""
    slow = {"scipy.stats", "matplotlib", "arviz", "corner", "h5py", "h5netcdf", "xarray"}
    found = [(name, module) for name in modules() for module in slow & {*named(trees()[name].body)}]
    plots = [(name, "matplotlib") for name in modules() if name.startswith("bayes_ssi.plots.")]
    assert set(found) <= set(plots)


def test_one_module_touches_arviz():
    touching = [
        name
        for name, tree in trees().items()
        if any(module.startswith(("arviz", "xarray")) for module in named(ast.walk(tree)))
    ]
    assert touching == ["bayes_ssi.foundations.arviz_functions"]
