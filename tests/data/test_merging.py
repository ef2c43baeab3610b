"""Merged modes: closed forms, exact shapes from setups, and calibration of claims and checks."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from identified_records import identified
from scipy.stats import chi2

import bayes_ssi as bs

BAND = (0.0, 6.0)


def record(*modes, sensors=("x", "y"), band=BAND, **others):
    return bs.ModalData(tuple(modes), band, sensors, **others)


def merged_of(**tests):
    return bs.merge_modal_data(tests)


def mode(label, frequency, shape=None, cov=0.002, sd=0.01, **others):
    sd = None if shape is None else sd
    return bs.IdentifiedMode(label, frequency, shape, frequency_cov=cov, shape_sd=sd, **others)


def test_frequencies_and_dampings_are_weighted_by_their_errors():
    merged = merged_of(
        a=record(mode("1", 2.00, cov=0.001, damping=0.02, damping_sd=0.002), sensors=()),
        b=record(mode("1", 2.01, cov=0.003, damping=0.04, damping_sd=0.004), sensors=()),
    )
    logs, weights = np.log([2.00, 2.01]), np.array([1e6, 1e6 / 9.0])
    mean = weights @ logs / weights.sum()
    (joined,) = merged.data.modes
    assert joined.frequency_hz == pytest.approx(math.exp(mean), rel=1e-12)
    assert joined.frequency_cov == pytest.approx(weights.sum() ** -0.5, rel=1e-9)
    squares = weights @ (logs - mean) ** 2
    assert merged.modes[0].frequency.ratio == pytest.approx(math.sqrt(squares), rel=1e-9)
    assert merged.modes[0].frequency.p_value == pytest.approx(chi2.sf(squares, 1), rel=1e-9)
    assert merged.modes[0].shape is None
    assert (joined.damping, joined.damping_sd) == pytest.approx((0.024, 0.004 / math.sqrt(5.0)))
    assert merged.failed_checks == ()


def test_shapes_at_two_sensors_are_angles_with_weights():
    angles, sds = (0.500, 0.506), (0.002, 0.004)
    tests = {
        name: record(mode("1", 2.0, sign * np.array([math.cos(a), math.sin(a)]), sd=sd))
        for name, a, sd, sign in zip("ab", angles, sds, (1.0, -3.0), strict=True)
    }
    merged = bs.merge_modal_data(tests)
    (joined,) = merged.data.modes
    # (4·0.500 + 0.506)/5; sines of differences below 0.006 are the differences to 10⁻⁷.
    assert math.atan2(*joined.unit_shape[::-1]) % math.pi == pytest.approx(0.5012, abs=1e-7)
    assert joined.shape_sd == pytest.approx(0.004 / math.sqrt(5.0), rel=1e-4)
    squares = 0.006**2 / (0.002**2 + 0.004**2)
    assert merged.modes[0].shape.ratio == pytest.approx(math.sqrt(squares), rel=1e-4)


SHAPES = np.array([
    [0.2, 0.4, 0.6, 0.8, 1.0, 0.9],
    [0.5, 0.9, 0.6, -0.1, -0.7, 0.3],
    [0.8, 0.2, -0.7, -0.4, 0.6, 1.0],
])  # fmt: skip
WHOLE = SHAPES / np.linalg.norm(SHAPES, axis=1, keepdims=True)
NAMES = tuple(f"s{i}" for i in range(1, 7))
SETUPS = {"first": (0, 1, 2, 3), "second": (1, 2, 4), "third": (5, 0, 1)}


def setups(rng=None, size=0.005):
    """Three setups of three modes at six sensors with errors of known joint covariances."""
    tests = {}
    for seed, (name, columns) in enumerate(SETUPS.items()):
        n = len(columns)
        own = np.random.default_rng(seed)
        factor = size * own.standard_normal((3 + 3 * n, 3 + 3 * n)) / math.sqrt(n)
        errors = np.zeros(3 + 3 * n) if rng is None else factor @ rng.standard_normal(3 + 3 * n)
        modes = []
        for j, (frequency, shape) in enumerate(zip((1.0, 2.6, 4.5), SHAPES, strict=True)):
            part = shape[list(columns)] / np.linalg.norm(shape[list(columns)])
            error = errors[3 + n * j : 3 + n * (j + 1)]
            part = part + error - part * (part @ error)
            modes.append(bs.IdentifiedMode(str(j), frequency * math.exp(errors[j]), part))
        sensors = tuple(NAMES[i] for i in columns)
        tests[name] = record(*modes, sensors=sensors, covariance=factor @ factor.T)
    return tests


def test_setups_without_error_give_the_whole_shapes():
    merged = bs.merge_modal_data(setups())
    assert merged.data.sensors == ("s1", "s2", "s3", "s4", "s5", "s6")
    assert merged.data.labels == ("0", "1", "2")
    agreement = np.abs((merged.data.unit_shapes.T * WHOLE).sum(axis=1))
    np.testing.assert_allclose(agreement, 1.0, rtol=1e-12)
    assert all(each.frequency.ratio < 1e-6 and each.shape.ratio < 1e-6 for each in merged.modes)


def test_claimed_errors_of_merged_setups_are_right():
    """Over 80 draws: chi-square of all errors has its mean, and right claims rarely fail."""
    rng, squares, failed = np.random.default_rng(7), [], 0
    for _ in range(80):
        merged = bs.merge_modal_data(setups(rng))
        data, shapes = merged.data, merged.data.unit_shapes.T
        signs = np.sign((shapes * WHOLE).sum(axis=1, keepdims=True))
        turned = np.r_[np.ones(3), np.repeat(signs, 6)]
        covariance = data.covariance * np.outer(turned, turned)
        off = (signs * shapes - WHOLE).ravel()
        errors = np.r_[np.log(data.frequencies_hz / [1.0, 2.6, 4.5]), off]
        squares.append(errors @ np.linalg.pinv(covariance, rcond=1e-9) @ errors)
        failed += bool(merged.failed_checks)
    # Three frequencies, and five directions of each of three shapes.
    assert np.mean(squares) == pytest.approx(18.0, abs=4.0 * math.sqrt(36.0 / 80.0))
    assert failed <= 4  # 0.8 expected, more than 4 once in 700


def test_a_change_between_records_is_a_failed_check():
    shape = [0.6, 0.8]
    (check,) = merged_of(
        morning=record(mode("1", 1.0, shape), mode("2", 2.50, [0.8, -0.6])),
        evening=record(mode("1", 1.001, shape), mode("2", 2.55, [0.8, -0.6])),
    ).failed_checks
    # ln(2.55/2.50) over 0.002 √2
    assert check.startswith(
        "mode '2' at 2.525 Hz: the tests' frequencies scatter by 7.0 times their errors (p = "
    )


def test_a_mode_that_a_test_lacks_is_said_and_labels_that_disagree_are_numbers():
    both = [[0.6, 0.8], [0.8, -0.6]]
    merged = merged_of(
        a=record(mode("1", 1.0, both[0]), mode("2", 1.1, both[1]), mode("3", 3.0, both[0])),
        b=record(mode("1", 1.0, both[0]), mode("2", 3.0, both[0])),
    )
    assert merged.data.labels == ("1", "2", "3")
    assert [dict(each.labels) for each in merged.modes] == [
        {"a": "1", "b": "1"}, {"a": "2"}, {"a": "3", "b": "2"},
    ]  # fmt: skip
    assert merged.remarks == ("mode '2': not in b",)
    assert merged.modes[1].frequency is None


def test_frequencies_alone_and_missing_sensors():
    first, second = mode("1", 1.0, [0.6, 0.8]), mode("1", 1.0, [0.6, np.nan, 0.7])
    alone = mode("2", 2.0)
    merged = merged_of(a=record(first, alone), b=record(second, alone, sensors=("x", "y", "z")))
    first, second = merged.data.modes
    np.testing.assert_allclose(first.shape / first.shape[0], [1.0, 0.8 / 0.6, 0.7 / 0.6])
    assert second.shape is None


LOW, HIGH = (0.0, 4.0), (3.0, 6.0)
FOUND = identified("tower.csv")


def test_bands_that_touch_are_joined_and_their_modes_are_different():
    """However alike their shapes are, and the only modes that could be nearest to each other."""
    merged = merged_of(
        high=record(mode("1", 5.0, [0.6, 0.8], cov=0.003), band=(2.5, 6.0)),
        low=record(mode("1", 1.0, [0.6, 0.8], cov=0.001), band=(0.5, 2.5)),
    )
    assert merged.data.band_hz == (0.5, 6.0)
    assert merged.data.labels == ("1", "2")
    np.testing.assert_allclose(merged.data.frequencies_hz, [1.0, 5.0], rtol=1e-12)
    covs = [each.frequency_cov for each in merged.data.modes]
    np.testing.assert_allclose(covs, [0.001, 0.003], rtol=1e-9)
    assert (merged.remarks, merged.failed_checks) == ((), ())


def test_in_an_overlap_of_two_records_a_mode_has_the_weights_of_both_errors():
    merged = merged_of(
        a=record(mode("1", 1.0), mode("2", 3.2), mode("3", 3.50, cov=0.001), band=LOW),
        b=record(mode("1", 3.51, cov=0.003), mode("2", 5.0), band=HIGH),
    )
    assert merged.data.band_hz == (0.0, 6.0)
    logs, weights = np.log([3.50, 3.51]), np.array([9.0, 1.0])
    assert np.log(merged.data.frequencies_hz[2]) == pytest.approx(weights @ logs / 10.0, rel=1e-12)
    assert merged.data.modes[2].frequency_cov == pytest.approx(0.001 * math.sqrt(0.9), rel=1e-9)
    # Neither band holds the other's modes; that of b holds the second of a.
    assert merged.remarks == ("mode '2': not in b",)


def test_of_one_record_a_mode_in_two_bands_counts_once():
    """It is taken from the band whose edges are farther away: 0.7 Hz, not 0.3 Hz."""
    low = record(
        mode("1", 1.0, [0.6, 0.8]),
        mode("2", 3.300, [0.8, -0.6], cov=0.001, damping=0.01, damping_sd=0.002),
        band=LOW, identifications=(FOUND,),
    )  # fmt: skip
    high = record(
        mode("1", 3.303, [0.8, -0.6], cov=0.002, damping=0.02, damping_sd=0.001),
        mode("2", 5.0, [0.6, 0.8]),
        band=HIGH, identifications=(FOUND,),
    )  # fmt: skip
    merged = bs.merge_modal_data({"low": low, "high": high})
    joined = merged.data.modes[1]
    assert (joined.frequency_hz, joined.frequency_cov, joined.damping) == pytest.approx(
        (3.300, 0.001, 0.01), rel=1e-12
    )
    assert merged.remarks == (
        "mode '2': from low alone; high is of the same record, in a band whose edge is nearer",
    )
    # They are compared nevertheless.
    assert merged.modes[1].frequency.ratio == pytest.approx(
        math.log(3.303 / 3.300) / math.hypot(0.001, 0.002), rel=1e-6
    )
    # Files of one name that are two records, as their duration or their one band shows, count both.
    longer = replace(FOUND, record=replace(FOUND.record, duration_s=900.0))
    several = bs.merge_modal_data({"low": low, "high": replace(high, identifications=(longer,))})
    assert several.data.modes[1].frequency_cov == pytest.approx(0.002 / math.sqrt(5.0), rel=1e-9)
    again = bs.merge_modal_data({"low": low, "again": replace(low, source="another day")})
    assert again.data.modes[1].frequency_cov == pytest.approx(0.001 / math.sqrt(2.0), rel=1e-9)


def test_estimates_on_both_sides_of_an_edge_are_one_mode_where_their_errors_allow():
    def joined(cov):
        low = record(mode("1", 2.998, [0.6, 0.8], cov=cov), band=(0.0, 3.0))
        high = record(mode("1", 3.002, [0.6, 0.8], cov=cov), band=(3.0, 6.0))
        return bs.merge_modal_data({"low": low, "high": high})

    # 0.0007 from the edge: less than three times 0.0005, more than three times 0.0001.
    assert len(joined(0.0005).modes) == 1
    assert len(joined(0.0001).modes) == 2


def test_a_mode_that_one_did_not_identify_and_another_did_is_identified():
    seen = ((2.01, "its fit is not explained"), (2.60, "too weak"))
    one = record(mode("1", 1.0), identifications=(replace(FOUND, not_identified=seen),))
    merged = merged_of(a=one, b=record(mode("1", 1.0), mode("2", 2.0)))
    assert merged.data.identifications[0].not_identified == seen[1:]
    (check,) = merged.data.all_failed_checks
    assert "2.6 Hz that is not identified (too weak)" in check


def test_failed_checks_of_merging_stay_with_the_modes(tmp_path):
    merged = merged_of(a=record(mode("1", 1.0)), b=record(mode("1", 1.05)))
    bs.write_modal_data(merged.data, tmp_path / "ab.csv")
    read = bs.read_modal_data(tmp_path / "ab.csv")
    assert read.all_failed_checks == merged.failed_checks != ()
    again = bs.merge_modal_data({"ab": read, "c": record(mode("1", 1.02))})
    assert again.data.all_failed_checks[-1:] == merged.failed_checks


@pytest.mark.parametrize(
    ("tests", "message"),
    [
        ({"a": record(mode("1", 1.0))}, "give two tests or more, got 1"),
        (
            {"a": record(mode("1", 9.0), band=(6.5, 10.0)),
             "b": record(mode("1", 1.0), band=(0.5, 4.0)),
             "c": record(mode("1", 3.0), band=(2.0, 5.0))},
            "no modes were sought from 5 to 6.5 Hz, below the band of a; merge bands that touch or",
        ),
        ({"a": record(mode("1", 1.0)), "b": record(mode("1", 1.0, cov=None))},
         "b: mode '1' has no frequency_cov; modes are merged by the weight of their errors"),
        (
            {"a": record(mode("1", 1.0, [0.6, 0.8])),
             "b": record(mode("1", 1.0, [0.6, 0.8]), sensors=("z", "w"))},
            "b shares no sensor with the other tests in the mode at 1 Hz",
        ),
        (
            {"a": record(mode("1", 1.0, [0.0, 1.0])),
             "b": record(mode("1", 1.0, [0.0, 1.0]), sensors=("x", "z"))},
            "sensors that the tests share do not move in a mode",
        ),
    ],
)  # fmt: skip
def test_tests_that_cannot_be_merged_are_refused(tests, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        bs.merge_modal_data(tests)
