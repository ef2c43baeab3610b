"""A record's modes by this package beside SSI-cov of pyOMA2 as it comes.

    pip install ".[oma]"
    python runs/benchmarks/ssi_cov.py FILE --band LOW HIGH [--quantity acceleration] [--unit m/s2]

SSI-cov of the record decimated to the band, 45 block rows, orders to 60, and its clustering
"Kvaale"; nothing is tuned. Standard deviations are its own, by 30 blocks. Scripts beside this one
ask it for the same records by ``--peer``.
"""

import argparse
import logging
import time
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from typing import NamedTuple

import numpy as np
from scipy.signal import decimate

import bayes_ssi as bs


class PeerModes(NamedTuple):
    """Of SSI-cov, in the band; standard deviations are NaN where none were asked for."""

    frequencies_hz: np.ndarray
    dampings: np.ndarray
    shapes: np.ndarray  # (sensors, modes), real, of unit length
    frequency_sds_hz: np.ndarray
    damping_sds: np.ndarray


def by_ssi_cov(record, band_hz, uncertain=False):
    """The clusters of a record's stable poles; ValueError where pyOMA2 ends without any."""
    from pyoma2.algorithms.data.run_params import Clustering
    from pyoma2.algorithms.ssi import SSI
    from pyoma2.setup import SingleSetup

    logging.disable(logging.CRITICAL)
    factor = max(1, int(0.8 * record.nyquist_hz / band_hz[1]))
    slow = record.samples if factor == 1 else decimate(record.samples, factor, ftype="fir")
    setup = SingleSetup(np.array(slow).T, record.rate_hz / factor)
    algorithm = SSI(name="ssi", method="cov", br=45, ordmax=60, calc_unc=uncertain, nb=30)
    algorithm.add_clustering(Clustering(name="modes", quick="Kvaale", freqlim=tuple(band_hz)))
    setup.add_algorithms(algorithm)
    with redirect_stderr(StringIO()), redirect_stdout(StringIO()):  # bars of progress
        try:
            setup.run_by_name("ssi")
            algorithm.run_all_clustering()
        except (IndexError, AttributeError, np.linalg.LinAlgError) as error:
            raise ValueError(f"pyOMA2: {error}") from None
    result = algorithm.result.clustering_results["modes"]
    shapes = np.asarray(result.Phi)
    real = (shapes * np.exp(-0.5j * np.angle((shapes**2).sum(0)))).real
    nothing = np.full(len(result.Fn), np.nan)
    return PeerModes(
        np.asarray(result.Fn),
        np.asarray(result.Xi),
        real / np.linalg.norm(real, axis=0),
        np.asarray(result.Fn_std) if uncertain else nothing,
        np.asarray(result.Xi_std) if uncertain else nothing,
    )


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("file")
    parser.add_argument("--band", type=float, nargs=2, required=True)
    parser.add_argument("--quantity", default="acceleration")
    parser.add_argument("--unit", default="m/s2")
    given = parser.parse_args()
    probe = np.atleast_2d(np.genfromtxt(given.file, delimiter=",", skip_header=1, max_rows=1))
    sensors = [f"s{i}" for i in range(1, probe.shape[1])]
    record = bs.read_record(given.file, quantity=given.quantity, unit=given.unit, sensors=sensors)
    begun = time.process_time()
    identified = bs.identify(record, given.band)
    seconds = time.process_time() - begun
    peer = by_ssi_cov(record, given.band, uncertain=True)
    print(f"{'f in Hz':>17} {'damping in %':>14}   {'SSI-cov':>8} {'damping in %':>19}    MAC")
    quoted, left = identified.quoted, set(range(len(peer.frequencies_hz)))

    def of_peer(i):
        f, z, _, sf, sz = (value[..., i] for value in peer)
        return f"{f:8.3f} ± {sf:.3f} {100 * z:6.2f} ± {100 * sz:.2f}"

    for mode, shape in zip(quoted.modes, quoted.unit_shapes.T, strict=True):
        own = (
            f"{mode.frequency_hz:8.3f} ± {mode.frequency_cov * mode.frequency_hz:.3f} "
            f"{100 * mode.damping:6.2f} ± {100 * mode.damping_sd:.2f}"
        )
        macs = {i: (shape @ peer.shapes[:, i]) ** 2 for i in left}
        near = [
            i for i in left
            if abs(peer.frequencies_hz[i] / mode.frequency_hz - 1.0) < 0.03 and macs[i] > 0.5
        ]  # fmt: skip
        if near:
            best = max(near, key=macs.get)
            left.remove(best)
            own += f"   {of_peer(best)}   {macs[best]:.3f}"
        print(own)
    for i in sorted(left):
        print(f"{'':35}{of_peer(i)}")
    for hz, why in identified.not_identified:
        print(f"not identified, {hz:.3f} Hz: {why}")
    for check in identified.failed_checks:
        print(f"failed check: {check}")
    print(f"CPU s: {seconds:.1f} here, {time.process_time() - begun - seconds:.1f} SSI-cov")


if __name__ == "__main__":
    main()
