"""The IASC-ASCE benchmark: the modes that are simulated are the published ones."""

import make_asce_benchmark as benchmark
import numpy as np
import pytest
from conftest import kept_study

PUBLISHED_HZ = {
    "none": (9.411, 11.791, 16.383, 25.545, 32.006, 38.663),
    "pattern 1": (6.241, 9.909, 11.731),
    "pattern 2": (5.824, 9.507, 11.014),
    "pattern 3": (8.890, 11.791, 16.005),
    "pattern 6": (9.265,),
}


@pytest.mark.parametrize("pattern", PUBLISHED_HZ)
def test_frequencies_are_the_published_ones(pattern):
    """Stiffnesses are given to five digits, and losses to four."""
    published = np.array(PUBLISHED_HZ[pattern])
    ours, _ = benchmark.modes(benchmark.braces_left(pattern))
    assert ours[: len(published)] == pytest.approx(published, rel=1.5e-4)


PUBLISHED_LOSSES = {
    "pattern 1": {("x", 1): 0.4524, ("y", 1): 0.7103, ("torsion", 1): 0.6496},
    "pattern 2": {("x", 3): 0.4524, ("y", 3): 0.7103, ("torsion", 3): 0.6496},
    "pattern 3": {("y", 1): 0.1776, ("torsion", 1): 0.0812},
    "pattern 4": {("y", 1): 0.1776, ("x", 3): 0.1131},
    "pattern 6": {("y", 1): 0.0592},
}


@pytest.mark.parametrize("pattern", PUBLISHED_LOSSES)
def test_losses_of_storeys_are_the_published_ones(pattern):
    ours = benchmark.of_storeys(benchmark.braces_left(pattern))
    for place, loss in PUBLISHED_LOSSES[pattern].items():
        assert ours[place] == pytest.approx(loss, abs=1.1e-4)


def test_the_finer_model_has_the_frequencies_of_120_degrees_of_freedom():
    frequencies_hz, _ = benchmark.modes(finer=True)
    assert frequencies_hz[:3] == pytest.approx((8.588, 9.181, 14.580), rel=1e-6)


@pytest.mark.parametrize("pattern", PUBLISHED_HZ)
def test_the_study_has_the_benchmark_s_modes_where_its_faces_lose_what_braces_take(pattern):
    """Stiffnesses of faces are rounded to five digits, those of middle columns to four."""
    structure = kept_study("asce_benchmark").model_classes[0].configurations[0].structure
    left = benchmark.braces_left(pattern)
    faces = [[1.0 - benchmark.of_faces(left)[each.name] for each in structure.parameters]]
    ours = structure.modes(np.array(faces)).frequencies_hz[0]
    assert ours == pytest.approx(benchmark.modes(left)[0], rel=3e-5)
