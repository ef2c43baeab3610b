"""Example studies: a commented study and its identified modes, which run unchanged.

The modes are those of a shear building of three storeys with unit masses, its first frequency
1 Hz and its second storey 20 % softer, with identification errors of half a per cent.
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["write_study"]

DATA = """\
# source, an example; replace it by the origin of your modes
# band_hz, 0, 6
# One row per mode, one column per sensor; frequency_cov, shape_sd and damping are optional.
label, frequency_hz, frequency_cov, shape_sd, floor 1, floor 2, floor 3
1,     0.960,        0.005,         0.02,     0.291,   0.608,   0.738
2,     2.755,        0.005,         0.02,     -0.779,  -0.294,  0.554
3,     3.840,        0.005,         0.02,     -0.546,  0.737,   -0.399
"""

HEAD = '''\
"""{title}

Run it with: bayes-ssi rank {stem}.py
"""
{imports}
import bayes_ssi as bs

# The identified modes; `bayes-ssi check {stem}.csv` shows how they are read.
modes = bs.read_modal_data(Path(__file__).with_suffix(".csv"))

# The parameters to infer: factors of nominal stiffnesses, about 1 and known to 30 %.
prior = bs.LogNormal(median=1.0, cov=0.3)
k, k1, k2, k3 = (bs.Parameter(name, prior) for name in ("k", "k1", "k2", "k3"))

'''

TAIL = """
# Prediction errors of the model, beyond the identification errors: standard deviations of
# frequencies (as a fraction) and of shapes (per component). Without it, both are inferred.
error = bs.ErrorModel(frequency_cov=0.005, shape_sd=0.02)

# Identified mode -> model mode. Modes left out count as spurious; "any" infers the pairing.
pairing = {"1": 1, "2": 2, "3": 3}

study = bs.Study(
    "One factor for all storeys, or one for each?",
    [
        bs.ModelClass("one factor", structure(k, k, k), modes, error, pairing=pairing),
        bs.ModelClass("each its own", structure(k1, k2, k3), modes, error, pairing=pairing),
    ],
)
"""

SHEAR_BUILDING = '''
def structure(*factors):
    """Three floors of 1 t; storeys of 199.3 kN/m, times a factor (units: t, kN, m, s)."""
    stiffnesses = [199.3 * factor for factor in factors]
    return bs.ShearBuilding(masses=(1.0, 1.0, 1.0), stiffnesses=stiffnesses)

'''

MATRICES = '''
def storey(i):
    """The nominal stiffness matrix of storey i, as your finite-element program writes it."""
    # bs.read_matrix("model.mat", key="K1") reads MATLAB files, .npz and Matrix Market files.
    direction = np.zeros(3)
    direction[i] = 1.0
    if i > 0:
        direction[i - 1] = -1.0
    return 199.3 * np.outer(direction, direction)


def structure(*factors):
    """K = sum of factor times matrix; the matrices may be sparse and of any size."""
    return bs.MatrixStructure(
        stiffness=[(factor, storey(i)) for i, factor in enumerate(factors)],
        mass=np.eye(3),
        # Name of a sensor -> its degree of freedom, from 0.
        sensors={"floor 1": 0, "floor 2": 1, "floor 3": 2},
        n_modes=3,
    )  # .reduced() after it makes models with thousands of degrees of freedom fast

'''

FUNCTION = '''
def model(factor_1, factor_2, factor_3):
    """Your own program: numbers in; K and M out, or frequencies (Hz) and shapes out."""
    a, b, c = 199.3 * factor_1, 199.3 * factor_2, 199.3 * factor_3
    stiffness = np.array([[a + b, -b, 0.0], [-b, b + c, -c], [0.0, -c, c]])
    return stiffness, np.eye(3)


def structure(*factors):
    """`bayes-ssi rank --workers N` calls the function in N processes."""
    return bs.FunctionStructure(
        model,
        arguments=dict(zip(("factor_1", "factor_2", "factor_3"), factors, strict=True)),
        # Name of a sensor -> its degree of freedom, from 0. For a function that returns shapes:
        # the names of their rows.
        sensors={"floor 1": 0, "floor 2": 1, "floor 3": 2},
        n_modes=3,
    )

'''

WITH_NUMPY = "\nfrom pathlib import Path\n\nimport numpy as np\n"
KINDS = {
    "shear-building": ("A shear building.", "\nfrom pathlib import Path\n", SHEAR_BUILDING),
    "matrices": ("A structure by its matrices.", WITH_NUMPY, MATRICES),
    "function": ("A structure by a function.", WITH_NUMPY, FUNCTION),
}


def write_study(name: str | Path, kind: str) -> tuple[Path, Path]:
    """Write a study and its data.

    Args:
        name: of the files, with or without ``.py``; its directory must exist.
        kind: one of ``KINDS``.

    Returns:
        The paths of the study and of the data.

    Raises:
        FileExistsError: one of the files exists; nothing is written.
        ValueError: there is no such kind, or the name is not one of a file.
        OSError: they cannot be written.
    """
    if kind not in KINDS:
        raise ValueError(f"kind of study: no {kind!r}; choose from {', '.join(KINDS)}")
    path = Path(name)
    path = path.with_suffix("") if path.suffix == ".py" else path
    if not path.name or not path.name.isprintable():
        raise ValueError(f"name of the study: {str(name)!r} is not a file name")
    study, data = (path.with_name(path.name + suffix) for suffix in (".py", ".csv"))
    for file in (study, data):
        if file.exists():
            raise FileExistsError(f"{file}: exists already and is not overwritten")
    title, imports, structure = KINDS[kind]
    head = HEAD.format(title=title, stem=path.name, imports=imports)
    with data.open("x", encoding="utf-8") as file_of_data:
        file_of_data.write(DATA)
    with study.open("x", encoding="utf-8") as file_of_study:
        file_of_study.write(head + structure + TAIL)
    return study, data
