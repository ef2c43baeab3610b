"""Is an appendage's frequency inferred without bias? A tank on a building of five storeys.

    python runs/benchmarks/appendage_frequency.py [--sets 200] [--only "in resonance"]

Every set simulates the four lowest modes at all floors, with errors of 0.2 % of the frequencies and
0.01 of the shapes at unit length, which the class is given. Storey stiffnesses are drawn from their
priors. The tank is tuned to the second mode exactly, or up to 15 % beside it with a mass drawn from
its prior. The table shows in how many sets 90 % intervals hold the true frequency and mass, and the
truth less the posterior mean of their logarithms, in posterior standard deviations.
"""

import argparse

import numpy as np

import bayes_ssi as bs

STOREYS, MODES = 5, 4
FLOOR_MASS, STIFFNESS, TANK_MASS = 1e5, 2e8, 2e4  # kg, N/m, kg
MASSES = (2e3, 2e5)  # kg, of the prior
FREQUENCY_COV, SHAPE_SD = 0.002, 0.01
FARTHEST = 0.15  # of the tank's frequency from that of the mode, in the logarithm
FACTORS = tuple(
    bs.Parameter(f"k{i}", bs.LogNormal(median=1.0, cov=0.3)) for i in range(1, STOREYS + 1)
)
FRAME = bs.ShearBuilding(
    masses=(FLOOR_MASS,) * STOREYS, stiffnesses=tuple(STIFFNESS * factor for factor in FACTORS)
)
FLOORS = tuple(f"floor {i}" for i in range(1, STOREYS + 1))
CASES = {
    "in resonance": ("log-uniform", False),
    "in resonance, lognormal prior of the mass": ("lognormal", False),
    "up to 15 % beside, mass from its prior": ("log-uniform", True),
}


def deviations(case, seed):
    """Deviations of ln frequency and ln mass in standard deviations, and whether 90 % hold them."""
    prior, is_drawn = CASES[case]
    rng = np.random.default_rng(seed)
    z = rng.standard_normal(STOREYS)
    factors = np.array([f.prior.from_normal(at) for f, at in zip(FACTORS, z, strict=True)])
    mode = FRAME.modes(factors[None]).frequencies_hz[0, 1]
    frequency = mode * np.exp(rng.uniform(-FARTHEST, FARTHEST)) if is_drawn else mode
    mass = np.exp(rng.uniform(*np.log(MASSES))) if is_drawn else TANK_MASS
    truth = FRAME.with_element(bs.Pendulum(STOREYS, float(mass), float(frequency)))
    true_modes = truth.modes(factors[None])
    frequencies, shapes = true_modes.frequencies_hz[0], true_modes.shapes[0, :STOREYS]
    identified = tuple(
        bs.IdentifiedMode(
            str(i + 1),
            float(frequencies[i] * (1.0 + FREQUENCY_COV * rng.standard_normal())),
            shapes[:, i] / np.linalg.norm(shapes[:, i]) + SHAPE_SD * rng.standard_normal(STOREYS),
        )
        for i in range(MODES)
    )
    band = (0.0, float(np.sqrt(frequencies[MODES - 1] * frequencies[MODES])))
    data = bs.ModalData(identified, band, FLOORS)
    of_mass = bs.LogUniform(*MASSES) if prior == "log-uniform" else bs.LogNormal(TANK_MASS, 1.0)
    of_frequency = bs.LogUniform(float(0.5 * frequencies[0]), band[1])
    tank = bs.Pendulum(
        STOREYS,
        bs.Parameter("mass", of_mass, unit="kg"),
        bs.Parameter("frequency", of_frequency, unit="Hz"),
    )
    pairing = {str(i): i for i in range(1, MODES + 1)}
    error = bs.ErrorModel(FREQUENCY_COV, SHAPE_SD)
    known = bs.ModelClass("tank", FRAME.with_element(tank), data, error, pairing=pairing)
    posterior = bs.sample(known, seed)
    rows = []
    for name, true in (("frequency", frequency), ("mass", mass)):
        draws = posterior.values[:, posterior.parameter_names.index(name)]
        logs = np.log(draws)
        rows.append(
            ((np.log(true) - logs.mean()) / logs.std(), 0.05 < (draws < true).mean() < 0.95)
        )
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--only", choices=CASES)
    given = parser.parse_args()
    for case in [given.only] if given.only else CASES:
        rows = np.array([deviations(case, seed) for seed in range(given.sets)])
        for name, own in zip(("frequency", "mass"), rows.transpose(1, 0, 2), strict=True):
            z = own[:, 0]
            print(
                f"{case}, {name}: {int(own[:, 1].sum())} of {given.sets} in 90 % intervals; mean "
                f"{z.mean():+.2f} ± {z.std() / np.sqrt(given.sets):.2f}, root mean square "
                f"{np.sqrt(np.mean(z**2)):.2f} sd",
                flush=True,
            )


if __name__ == "__main__":
    main()
