"""Targets and a model class whose posteriors are known."""

import math

import numpy as np

import bayes_ssi as bs
from bayes_ssi.inference.sampling.target import log_standard_normal

STIFFNESS = (2.0 * math.pi) ** 2  # of a unit mass at 1 Hz


def peaks(centres, sd, shares):
    """Likelihood times prior is a mixture of normals: their shares are the maxima's masses."""
    d = centres.shape[1]

    def log_likelihood(z):
        away = ((z[None] - centres[:, None]) ** 2).sum(-1) / sd**2
        parts = np.log(shares)[:, None] - 0.5 * away - 0.5 * d * math.log(2.0 * math.pi * sd**2)
        return np.logaddexp.reduce(parts, axis=0) - log_standard_normal(z)

    return log_likelihood


def two_bumps(small=0.1):
    """This share of the mass is at -2, the rest at 2 (in each of two coordinates)."""
    return peaks(np.array([[2.0, 2.0], [-2.0, -2.0]]), 0.1, [1.0 - small, small])


def one_mass(name="one mass", prior=None, error=0.05):
    """A unit mass on a spring; its frequency is √k Hz, and was identified at 1.1 Hz."""
    k = bs.Parameter("k", prior or bs.LogNormal(1.0, 0.3))
    data = bs.ModalData((bs.IdentifiedMode("1", 1.1),), band_hz=(0.0, 3.0))
    building = bs.ShearBuilding((1.0,), (STIFFNESS * k,))
    return bs.ModelClass(name, building, data, bs.ErrorModel(error, 0.05), pairing={"1": 1})
