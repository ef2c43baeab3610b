"""The guide's picture of close modes: how far a pair turns, and what that is in the likelihood.

    python runs/close_modes_turn.py [FILE]

Left, the law of the angle of two modes a distance apart, where the stiffness is off by so much that
frequencies move by 1 %: matrices drawn at random, and the likelihood's density. Right, three floors
that are equal in x and y but for 0.3 % of the frequency, with data whose three pairs are turned in
plan: the log-likelihood of the building itself, with turns and with each shape compared with one
eigenvector. Draws FILE, runs/results/close_modes.png if not given.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import i0

import bayes_ssi as bs
from bayes_ssi.plots.figure_style import STYLE, style

HERE = Path(__file__).parent
SD = 0.01
DISTANCES = {0.0: STYLE.grey, 0.01: STYLE.orange, 0.02: STYLE.vermilion, 0.05: "black"}
FLOORS = tuple(f"floor {i} {axis}" for i in (1, 2, 3) for axis in "xy")


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "results" / "close_modes.png"
    with style():
        figure = Figure(figsize=(9.0, 3.2), layout="constrained")
        law, likelihoods = figure.subplots(1, 2)
        draw_law(law)
        draw_likelihoods(likelihoods)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=110)
    print(f"drawn in {path}")


def draw_law(ax: Axes) -> None:
    """Angles of the eigenvectors of diag(λ) + 2 σ λ̄ W whose eigenvalues are as far apart."""
    rng = np.random.default_rng(0)
    angles = np.radians(np.linspace(-90, 90, 361))
    for distance, color in DISTANCES.items():
        w = rng.standard_normal((400_000, 2, 2))
        w = 0.5 * (w + w.transpose(0, 2, 1))
        squares = np.array([1 - 0.5 * distance, 1 + 0.5 * distance]) ** 2
        values, vectors = np.linalg.eigh(np.diag(squares) + 2 * SD * squares.mean() * w)
        apart = np.sqrt(values[:, 1] / values[:, 0]) - 1
        turned = np.arctan(vectors[:, 1, 0] / vectors[:, 0, 0])
        near = np.abs(apart - max(distance, 0.005)) < 0.002
        edges = np.linspace(-90, 90, 37)
        heights, _ = np.histogram(np.degrees(turned[near]), edges, density=True)
        middles = 0.5 * (edges[1:] + edges[:-1])
        ax.plot(middles, heights, "o", color=color, markersize=2.5)
        kappa = max(distance, 0.005) * distance / (2 * SD**2)
        density = np.exp(kappa * np.cos(2 * angles)) / (np.pi * i0(kappa)) * np.pi / 180
        ax.plot(np.degrees(angles), density, color=color, label=f"{100 * distance:g} % apart")
    ax.set_xlabel("turn of the pair (degrees)")
    ax.set_ylabel("density")
    ax.set_xticks([-90, -45, 0, 45, 90])
    ax.legend(fontsize=8)


def draw_likelihoods(ax: Axes) -> None:
    building = bs.ShearBuilding3D(
        (1.0,) * 3, (1.0,) * 3, (bs.Parameter("k", bs.LogNormal(199.323, 0.2)),) * 3,
        (1.003**2 * 199.323,) * 3, (1e5,) * 3,
    )  # fmt: skip
    frequencies, shapes = (each[0] for each in building.modes(np.array([[199.323]])))
    rows = [building.degrees_of_freedom.index(floor) for floor in FLOORS]
    shapes, turns, with_turns, alone = shapes[rows][:, :6], np.arange(0, 91, 3), [], []
    for turn in np.radians(turns):
        c, s = np.cos(turn), np.sin(turn)
        in_plan = np.kron(np.eye(3), [[c, -s], [s, c]])
        modes = tuple(
            bs.IdentifiedMode(str(i + 1), float(frequencies[i]), in_plan @ shapes[:, i])
            for i in range(6)
        )
        data = bs.ModalData(modes, (0.5, 5.0), FLOORS)
        pairing = {mode.label: i for i, mode in enumerate(modes, 1)}
        error = bs.ErrorModel(0.005, 0.02)
        likelihood = bs.ModelClass("b", building, data, error, pairing=pairing).likelihoods[0]
        values = np.array([[199.323]])
        terms = likelihood.terms(values)
        with_turns.append(terms.total()[0])
        distances = likelihood.pairs.shape_distances(
            likelihood.shapes_at_sensors(likelihood.modes(values))
        )
        unturned = likelihood.compared_modes(values)._replace(
            shape_distances=distances, turned=np.zeros(distances.shape)
        )
        alone.append(likelihood.log_density(values, unturned)[0])
    ax.plot(turns, with_turns, color="black", label="close modes turn together")
    ax.plot(turns, alone, color=STYLE.vermilion, label="one eigenvector a shape")
    ax.set_yscale("symlog", linthresh=100)
    ax.set_xlabel("the data's pairs turned in plan (degrees)")
    ax.set_ylabel("log-likelihood of the true building")
    ax.set_xticks([0, 30, 60, 90])
    ax.legend(fontsize=8)


if __name__ == "__main__":
    main()
