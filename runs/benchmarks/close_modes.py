"""Pairs of close modes, which turn together: do classes without an appendage stay right?

    python runs/benchmarks/close_modes.py floors [--first 0] [--number 5]
    python runs/benchmarks/close_modes.py antenna [--first 0] [--number 10]
    python runs/benchmarks/close_modes.py towers [--first 0] [--number 60] [--with-one]
    python runs/benchmarks/close_modes.py calibration [--first 0] [--number 200]

``floors``: three floors, equal in x and y but for 0.3 % of the frequency, whose principal
directions are turned in plan by 0 to 90 degrees; the class has them along x and y. Errors of the
data are 0.5 % and 2 %. The class without an antenna and one with an antenna at the top, at 30
degrees, mass 0.1 to 10 % of a floor and any frequency in the band, are ranked with any pairing;
``--number`` draws of the errors at each of seven turns. ``antenna``: the same with a true antenna
of 3 % within 3 % of the first modes' frequency.

``towers``: ``search`` on random nearly symmetric towers of 3 to 40 storeys, whose every storey is
off the class's stiffness by 2 to 6 % in x and in y, 6 to 20 sensors, errors of 0.2 to 0.5 % and of
1 to 5 %; three stiffness factors and both sizes of errors are inferred. With ``--with-one`` they
have a pendulum of 1 to 5 % of a floor's mass within a tenth of a mode's frequency at one of the
candidates.

``calibration``: ranks of true values among posterior draws. Factors and sizes of errors are drawn
from their priors; the true stiffness is off by symmetric normal numbers, ``Φᵀ K Φ`` by
2 σ_f λ_i^½ W_ij λ_j^½ in all modes at unit modal mass, which is a perturbed structure and not the
likelihood; shapes have errors of their own besides. Pairs are 0 to 10 % apart, σ_f 0.5 to 3 %. With
``--within-pairs`` W is zero but within pairs: modes of different pairs keep their shapes.

A line for each case; the numbers are seeds, so that any part can be run by itself.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
import scipy.linalg

import bayes_ssi as bs

TURNS = (0, 5, 10, 20, 30, 45, 90)
FLOORS = tuple(f"floor {i} {axis}" for i in (1, 2, 3) for axis in "xy")
SIZES = (0.005, 0.02)
SETTINGS = bs.SamplingSettings(log_evidence_error=0.1)
SPLIT = 0.003  # of frequencies
STIFFNESS = 199.323  # of a storey; the first modes are at 1 Hz


def floors(factors: list[bs.Value], split: float = SPLIT) -> bs.ShearBuilding3D:
    """Three floors of unit mass, as stiff in y as in x but for the split; torsion far above."""
    x = tuple(STIFFNESS * each for each in factors)
    y = tuple((1.0 + split) ** 2 * STIFFNESS * each for each in factors)
    return bs.ShearBuilding3D((1.0,) * 3, (1.0,) * 3, x, y, (1e3 * STIFFNESS,) * 3)


def storeys(x: np.ndarray, y: np.ndarray, turn: float) -> np.ndarray:
    """Stiffness matrix of floors in x and y, storeys with principal directions turned in plan."""
    n = len(x)
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    matrix = np.zeros((2 * n, 2 * n))
    for i in range(n):
        own = rotation @ np.diag([x[i], y[i]]) @ rotation.T
        rows = np.arange(2 * i, 2 * i + 2)
        matrix[np.ix_(rows, rows)] += own
        if i:
            matrix[np.ix_(rows - 2, rows - 2)] += own
            matrix[np.ix_(rows - 2, rows)] -= own
            matrix[np.ix_(rows, rows - 2)] -= own
    return matrix


def with_pendulum(
    stiffness: np.ndarray, masses: np.ndarray, motion: np.ndarray, mass: float, hz: float
) -> tuple[np.ndarray, np.ndarray]:
    n = len(masses)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n] = stiffness
    w = np.append(-motion, 1.0)
    return whole + mass * (2 * math.pi * hz) ** 2 * np.outer(w, w), np.append(masses, mass)


def identified(
    stiffness: np.ndarray,
    masses: np.ndarray,
    rows: np.ndarray,
    sensors: tuple[str, ...],
    sizes: tuple[float, float],
    band: tuple[float, float],
    rng: np.random.Generator,
) -> bs.ModalData:
    """The modes in the band, at the sensors, with errors of frequencies and unit shapes."""
    values, vectors = scipy.linalg.eigh(stiffness, np.diag(masses))
    modes = []
    for value, vector in zip(values, vectors.T, strict=True):
        hz = math.sqrt(value) / (2 * math.pi) * (1 + sizes[0] * rng.standard_normal())
        shape = vector[rows] / np.linalg.norm(vector[rows])
        shape = shape + sizes[1] * rng.standard_normal(len(rows))
        if band[0] < hz < band[1]:
            modes.append((hz, shape))
    modes.sort(key=lambda mode: mode[0])
    named = (bs.IdentifiedMode(str(i), hz, shape) for i, (hz, shape) in enumerate(modes, 1))
    return bs.ModalData(tuple(named), band, sensors)


def ranked_floors(turn: float, seed: int, antenna: tuple[float, float] | None) -> None:
    rng = np.random.default_rng([1, round(turn), seed])
    one = np.full(3, STIFFNESS)
    stiffness, masses = storeys(one, one * (1 + SPLIT) ** 2, math.radians(turn)), np.ones(6)
    cosines = (math.cos(math.radians(30)), math.sin(math.radians(30)))
    if antenna:
        motion = np.append(np.zeros(4), cosines)
        stiffness, masses = with_pendulum(stiffness, masses, motion, *antenna)
    data = identified(stiffness, masses, np.arange(6), FLOORS, SIZES, (0.5, 5.0), rng)
    building = floors([bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.2)) for i in (1, 2, 3)])
    mass = bs.Parameter("mass", bs.LogUniform(0.001, 0.1))
    frequency = bs.Parameter("frequency", bs.LogUniform(0.5, 5.0))
    place = dict(zip(("floor 3 x", "floor 3 y"), cosines, strict=True))
    hung = building.with_element(bs.Pendulum(on=place, mass=mass, frequency=frequency))
    error = bs.ErrorModel(*SIZES)
    classes = [
        bs.ModelClass(name, structure, data, error, pairing="any")
        for name, structure in (("without", building), ("antenna", hung))
    ]
    ranking = bs.rank(bs.Study("three floors", classes), seed, SETTINGS)
    rows = {row.name: row for row in ranking.comparison.classes}
    evidences = [rows[name].log_evidence for name in ("without", "antenna")]
    print(
        f"turned {turn:3.0f}, draw {seed}: {len(data.modes)} modes, log evidence without "
        f"{evidences[0]:7.2f}, with antenna {evidences[1]:7.2f}, probability of the antenna "
        f"{rows['antenna'].probability:.4f}",
        flush=True,
    )


def turned_floors(seeds: range) -> None:
    for turn in TURNS:
        for seed in seeds:
            ranked_floors(turn, seed, None)


def antennas(seeds: range) -> None:
    for seed in seeds:
        rng = np.random.default_rng([2, seed])
        ranked_floors(float(rng.uniform(0, 90)), seed, (0.03, float(rng.uniform(0.97, 1.03))))


def tower(seed: int, with_one: bool) -> None:
    rng = np.random.default_rng([3, seed, with_one])
    n = round(math.exp(rng.uniform(math.log(3), math.log(40))))
    off, split = rng.uniform(0.02, 0.06), rng.uniform(0.0, 0.01)
    base = STIFFNESS * np.linspace(1.0, rng.uniform(0.4, 1.0), n) * (n / 3) ** 2
    groups = [3 * i // n for i in range(n)]
    true = base * np.exp(0.1 * rng.standard_normal(3))[groups]
    x, y = (side * true * (1 + off * rng.standard_normal(n)) for side in (1.0, (1.0 + split) ** 2))
    stiffness, masses = storeys(x, y, 0.0), np.ones(2 * n)
    # Storeys are not quite along x and y either.
    stiffness = 0.5 * (stiffness + storeys(x, y, rng.uniform(0.0, math.pi)))
    levels = np.unique(np.linspace(n, 1, min(n, int(rng.integers(3, 11)))).round().astype(int))
    rows = np.array([2 * (level - 1) + axis for level in levels for axis in (0, 1)])
    sensors = tuple(f"floor {level} {axis}" for level in levels for axis in "xy")
    sizes = (float(rng.uniform(0.002, 0.005)), float(rng.uniform(0.01, 0.05)))
    hz = np.sqrt(scipy.linalg.eigvalsh(stiffness, np.diag(masses))) / (2 * math.pi)
    band = (0.4 * hz[0], float(0.5 * (hz[5] + (hz[6] if n > 3 else 1.5 * hz[5]))))
    places = [f"floor {level} {axis}" for level in (n, max(1, n // 2)) for axis in "xy"]
    truth = "none"
    if with_one:
        truth = str(rng.choice(places))
        motion = np.zeros(2 * n)
        level, axis = truth.split()[1:]
        motion[2 * (int(level) - 1) + "xy".index(axis)] = 1.0
        mode = float(hz[rng.integers(0, 4)])
        pendulum = float(rng.uniform(0.01, 0.05)), mode * float(rng.uniform(0.9, 1.1))
        stiffness, masses = with_pendulum(stiffness, masses, motion, *pendulum)
    data = identified(stiffness, masses, rows, sensors, sizes, band, rng)
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.2)) for i in (1, 2, 3)]
    terms = []
    for group, factor in enumerate(factors):
        own = np.where(np.array(groups) == group, base, 0.0)
        terms.append((factor, storeys(own, (1.0 + split) ** 2 * own, 0.0)))
    model = bs.MatrixStructure(
        terms, np.eye(2 * n), up_to_hz=band[1], sensors=sensors,
        labels=[f"floor {i} {axis}" for i in range(1, n + 1) for axis in "xy"],
    )  # fmt: skip
    baseline = bs.ModelClass("tower", model, data, pairing="any")
    candidates = [bs.Candidate(place, place) for place in places]
    result = bs.search(
        baseline, bs.SearchSettings(), seed, bs.SamplingSettings(log_evidence_error=0.2),
        candidates=candidates,
    )  # fmt: skip
    record = result.record
    shares = {str(each.place.candidate.place): each.probability for each in record.places}
    likely = max(shares, key=lambda place: shares[place])
    interval = ""
    for posterior in result.ranking.posteriors:
        if posterior.name == max(record.hypotheses, key=lambda each: each.probability).name:
            draws = posterior.values[:, posterior.parameter_names.index("shape_sd")]
            low, high = np.quantile(draws, [0.05, 0.95])
            interval = f", inferred shape error {low:.3f} to {high:.3f}"
    print(
        f"tower {seed}: {n} storeys, {len(data.modes)} modes, {len(sensors)} sensors, errors "
        f"{sizes[0]:.4f} {sizes[1]:.3f}{interval}; truth {truth}, "
        f"some appendage {record.probability_of_any:.4f}, "
        f"most likely at {likely} ({shares[likely]:.3f}), at the true place "
        f"{shares.get(truth, math.nan):.3f}",
        flush=True,
    )


def perturbed(seed: int, within_pairs: bool) -> dict[str, float]:
    """Share of posterior draws below the true value of each parameter."""
    rng = np.random.default_rng([4, seed])
    prior = bs.LogNormal(1.0, 0.1)
    factors = [bs.Parameter(f"k{i}", prior) for i in (1, 2, 3)]
    building = floors(factors, float(rng.uniform(0.0, 0.1)))
    middle = float(np.exp(rng.uniform(math.log(0.005), math.log(0.03))))
    error = bs.ErrorModel(
        bs.Parameter("frequency_cov", bs.LogNormal(middle, 0.5)),
        bs.Parameter("shape_sd", bs.LogNormal(0.02, 0.5)),
    )
    parameters = (*factors, *error.parameters)
    true = np.array([p.prior.quantile(rng.random()) for p in parameters])
    stiffness, mass = (each[0] for each in building.matrices(true[None, :3]))
    values, vectors = scipy.linalg.eigh(stiffness, np.diag(mass))
    bending = values < (2 * math.pi * 10.0) ** 2
    w = rng.standard_normal((bending.sum(),) * 2)
    w = 0.5 * (w + w.T)
    if within_pairs:
        w *= np.kron(np.eye(3), np.ones((2, 2)))
    roots = np.sqrt(values[bending])
    values, turned = np.linalg.eigh(
        np.diag(values[bending]) + 2 * true[3] * np.outer(roots, roots) * w
    )
    shapes = vectors[:, bending] @ turned
    labels = list(building.degrees_of_freedom)
    rows = [labels.index(sensor) for sensor in FLOORS]
    modes = []
    for i, (value, shape) in enumerate(zip(values, shapes.T, strict=True), 1):
        unit = shape[rows] / np.linalg.norm(shape[rows])
        hz = math.sqrt(value) / (2 * math.pi)
        modes.append(bs.IdentifiedMode(str(i), hz, unit + true[4] * rng.standard_normal(len(rows))))
    data = bs.ModalData(tuple(modes), (0.0, 8.0), FLOORS)
    pairing = {mode.label: i for i, mode in enumerate(modes, 1)}
    candidate = bs.ModelClass("perturbed", building, data, error, pairing=pairing)
    posterior = bs.sample(candidate, seed, SETTINGS)
    below = (posterior.values < true).mean(axis=0)
    return dict(zip(candidate.parameter_names, below.tolist(), strict=True))


def calibration(seeds: range, within_pairs: bool) -> None:
    inside: dict[str, list[bool]] = {}
    for seed in seeds:
        ranks = perturbed(seed, within_pairs)
        print(seed, {name: round(rank, 3) for name, rank in ranks.items()}, flush=True)
        for name, rank in ranks.items():
            inside.setdefault(name, []).append(0.05 < rank < 0.95)
    for name, each in inside.items():
        print(f"{name}: 90 % intervals hold {100 * np.mean(each):.1f} % of {len(each)}")
    print(f"all: {100 * np.mean(list(inside.values())):.1f} %")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("part", choices=("floors", "antenna", "towers", "calibration"))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--number", type=int)
    parser.add_argument("--with-one", action="store_true")
    parser.add_argument("--within-pairs", action="store_true")
    arguments = parser.parse_args()
    most = {"floors": 5, "antenna": 10, "towers": 60, "calibration": 200}[arguments.part]
    seeds = range(arguments.first, arguments.first + (arguments.number or most))
    if arguments.part == "towers":
        for seed in seeds:
            tower(seed, arguments.with_one)
    elif arguments.part == "calibration":
        calibration(seeds, arguments.within_pairs)
    else:
        {"floors": turned_floors, "antenna": antennas}[arguments.part](seeds)


if __name__ == "__main__":
    main()
