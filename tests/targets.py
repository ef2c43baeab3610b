"""Targets and a model class whose posteriors are known."""

import math

import numpy as np

import bayes_ssi as bs

STIFFNESS = (2.0 * math.pi) ** 2  # of a unit mass at 1 Hz


def two_bumps(small=0.1):
    """Likelihood times prior: this share of the mass at -2, the rest at 2 (in each coordinate)."""

    def log_likelihood(z):
        parts = [
            math.log(share) - 0.5 * (((z - centre) / 0.1) ** 2).sum(1) - 2.0 * math.log(0.1)
            for share, centre in ((1.0 - small, 2.0), (small, -2.0))
        ]
        return np.logaddexp(*parts) + 0.5 * (z**2).sum(1)

    return log_likelihood


def one_mass(name="one mass", prior=None, error=0.05):
    """A unit mass on a spring; its frequency is √k Hz, and was identified at 1.1 Hz."""
    k = bs.Parameter("k", prior or bs.LogNormal(1.0, 0.3))
    data = bs.ModalData((bs.IdentifiedMode("1", 1.1),), band_hz=(0.0, 3.0))
    building = bs.ShearBuilding((1.0,), (STIFFNESS * k,))
    return bs.ModelClass(name, building, data, bs.ErrorModel(error, 0.05), pairing={"1": 1})
