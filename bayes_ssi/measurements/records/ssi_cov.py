"""Covariance-driven stochastic subspace identification, by pyOMA2 (an optional extra).

Standard deviations of frequencies and dampings are those of pyOMA2's first-order perturbation
(Döhler and Mevel 2013). Those of its shapes lack the normalisation, are 25 to 300 times too large
(version 1.4.3), and are not used. Every order is computed: with steps of two, pyOMA2 leaves out
singular vectors, and standard deviations come out at 0.6 to 0.8 of the scatter; data-driven
identification ("dat") claims 0.4 to 0.7 of it, and is not offered.
"""

from __future__ import annotations

import logging
from contextlib import redirect_stderr
from io import StringIO
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.records.modal_estimates import Poles, real_shapes
from bayes_ssi.measurements.records.record import Record

# Lags reach over so many periods of the lowest frequency, in two halves.
PERIODS = 3.0
# Segments from which the covariance of correlations is estimated (pyOMA2's own choice).
SEGMENTS = 50


class SubspaceModes(NamedTuple):
    """Modes by SSI-cov.

    Attributes:
        frequency_sds: standard deviations of the frequencies in Hz (m,).
        damping_sds: of the dampings (m,).
    """

    poles: Poles
    frequency_sds: FloatArray
    damping_sds: FloatArray


def ssi_cov(record: Record, band_hz: tuple[float, float], near: Poles) -> SubspaceModes:
    """The modes nearest to some, from the order of twice their number."""
    try:
        from pyoma2.functions import ssi
    except ImportError:
        raise ValueError(
            'pyOMA2 is not installed; install it with pip install "bayes_ssi[oma]"'
        ) from None
    low, high = record.checked_band(band_hz)
    slow = record.decimated_to(high)
    half = round(0.5 * PERIODS * slow.rate_hz / low)
    order = 2 * len(near.frequencies_hz)
    samples = np.array(slow.samples)
    logging.getLogger("pyoma2").setLevel(logging.WARNING)
    with redirect_stderr(StringIO()):  # bars of progress
        hankel, root = ssi.build_hank(samples, samples, half, "cov", calc_unc=True, nb=SEGMENTS)
        states = ssi.SSI_fast(hankel, half, order)
        frequencies, dampings, shapes, _, sds, damping_sds, *_ = ssi.SSI_poles(
            *states[:3], order, 1.0 / slow.rate_hz, calc_unc=True, H=hankel, T=root
        )
    of_order = frequencies[:, -1]
    chosen = []
    for frequency in near.frequencies_hz:
        apart = np.abs(of_order / frequency - 1.0)
        if not np.nanmin(apart, initial=np.inf) < 0.05:
            raise ValueError(f"SSI-cov: order {order} shows no mode at {frequency:.4g} Hz")
        chosen.append(int(np.nanargmin(apart)))
    return SubspaceModes(
        Poles(of_order[chosen], dampings[chosen, -1], real_shapes(shapes[chosen, -1].T)),
        sds[chosen, -1],
        damping_sds[chosen, -1],
    )
