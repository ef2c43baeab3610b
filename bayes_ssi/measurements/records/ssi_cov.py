"""Covariance-driven stochastic subspace identification, by pyOMA2 (an optional extra).

Standard deviations of frequencies and dampings are those of pyOMA2's first-order perturbation
(Döhler and Mevel 2013). Those of its shapes lack the normalisation, are 25 to 300 times too large
(version 1.4.3), and are not used. Every order is computed: with steps of two, pyOMA2 leaves out
singular vectors, and standard deviations come out at 0.6 to 0.8 of the scatter; data-driven
identification ("dat") claims 0.4 to 0.7 of it, and is not offered.
"""

import logging
from contextlib import redirect_stderr
from io import StringIO

import numpy as np

from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.identification_settings import METHODS
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.resonances import Resonances, real_shapes


def ssi_cov(record: Record, band_hz: tuple[float, float], near: Resonances) -> ModalData:
    """The modes nearest to some, from the order of twice their number."""
    with optional_package("pyOMA2", extra="oma"):
        from pyoma2.functions import ssi
    low, high = record.checked_band(band_hz)
    slow = record.decimated_to(high)
    half = round(0.5 * METHODS.correlation_periods * slow.rate_hz / low)
    order, n_segments = 2 * near.n_modes, METHODS.subspace_segments
    samples = np.array(slow.samples)
    logging.getLogger("pyoma2").setLevel(logging.WARNING)
    with redirect_stderr(StringIO()):  # bars of progress
        hankel, root = ssi.build_hank(samples, samples, half, "cov", calc_unc=True, nb=n_segments)
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
    found = of_order[chosen]
    return ModalData.from_arrays(
        found,
        real_shapes(shapes[chosen, -1].T),
        band_hz,
        record.sensors,
        frequency_cov=sds[chosen, -1] / found,
        damping=dampings[chosen, -1],
        damping_sd=damping_sds[chosen, -1],
    )
