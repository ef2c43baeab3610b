"""Chains and membranes of springs, whose modes are known in closed form."""

import numpy as np
import scipy.sparse as sp


def spring_chain(n, parts=1):
    """Stiffnesses (n, n) of unit springs in a row, the first on the ground, in equal parts."""
    drifts = np.eye(n) - np.eye(n, k=-1)
    return [drifts[own].T @ drifts[own] for own in np.array_split(np.arange(n), parts)]


def membrane(n):
    """A square membrane of n by n points: its modes come in pairs of equal frequency."""
    line = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return sp.csc_array(sp.kron(sp.eye_array(n), line) + sp.kron(line, sp.eye_array(n)))
