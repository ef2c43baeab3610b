"""Identified modes: what they hold, what is refused, and what they warn of."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from conftest import assert_refused

import bayes_ssi as bs

NAN = math.nan


def mode(label="1", frequency=1.0, shape=None, **kwargs):
    return bs.IdentifiedMode(label, frequency, shape, **kwargs)


def data(*modes, band=(0.0, 6.0), sensors=("a", "b", "c"), **kwargs):
    return bs.ModalData(modes, band, sensors, **kwargs)


@pytest.mark.parametrize(
    ("shape", "unit"),
    [
        ([3.0, 4.0], [0.6, 0.8]), ([-30, 40], [-0.6, 0.8]), ([3e-5, NAN, 4e-5], [0.6, NAN, 0.8]),
        ([NAN, -2.0], [NAN, -1.0]), ([3e-90, 4e-90], [0.6, 0.8]), ([3e90j, 4e90j], [0.6, 0.8]),
    ],
)  # fmt: skip
def test_unit_shape(shape, unit):
    np.testing.assert_allclose(mode(shape=shape).unit_shape, unit, rtol=1e-14)


@pytest.mark.parametrize("phase_deg", [0.0, 20.0, 90.0, 137.0, 180.0, 300.0])
@pytest.mark.parametrize("shape", [[0.6, 0.8], [0.48, NAN, -0.8, 0.36]])
def test_a_complex_shape_on_a_line_is_rotated_to_it(shape, phase_deg):
    rotated = mode(shape=7.0 * np.array(shape) * np.exp(1j * math.radians(phase_deg)))
    measured = np.isfinite(shape)
    cosine = rotated.unit_shape[measured] @ np.array(shape)[measured]
    assert abs(cosine) == pytest.approx(1.0, rel=1e-14)
    assert np.isnan(rotated.unit_shape[~measured]).all()
    assert rotated.phase_scatter_deg == pytest.approx(0.0, abs=1e-6)


def test_a_complex_shape_keeps_the_real_part_at_its_longest():
    shape = np.array([1.0 + 0.3j, -0.4 + 0.5j, 0.2 - 0.9j])
    parts = (shape * np.exp(1j * np.linspace(0.0, math.pi, 20001))[:, None]).real
    longest = parts[np.argmax((parts**2).sum(1))]
    cosine = mode(shape=shape).unit_shape @ longest / np.linalg.norm(longest)
    assert abs(cosine) == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("phase_deg", [0.0, 33.0, 250.0])
@pytest.mark.parametrize(
    ("shape", "scatter_deg"),
    [
        ([1.0, 1j], 45.0),
        ([2.0, 1j], math.degrees(math.atan2(1.0, 2.0))),
        ([math.sqrt(3.0), 1j, 0.0], 30.0),
        ([3.0 + 0j, -4.0], 0.0),
    ],
)
def test_phase_scatter(shape, scatter_deg, phase_deg):
    turned = mode(shape=np.array(shape) * np.exp(1j * math.radians(phase_deg)))
    assert turned.phase_scatter_deg == pytest.approx(scatter_deg, abs=1e-6)


@pytest.mark.parametrize(
    ("shape", "n_measured", "scored"),
    [
        (None, 0, False), ([NAN, NAN], 0, False), ([NAN, 2.0], 1, False), ([1.0, 2.0], 2, True),
        ([1.0, NAN, 2.0], 2, True),
    ],
)  # fmt: skip
def test_a_shape_is_scored_at_two_sensors_or_more(shape, n_measured, scored):
    held = mode(shape=shape)
    assert held.n_measured == n_measured
    assert (held.scored_shape is not None) is scored


def test_shapes_are_copied_and_read_only():
    shape = np.array([3.0, 4.0])
    held = mode(shape=shape)
    shape[0] = 100.0
    assert held.shape.tolist() == [3.0, 4.0]
    for array in (held.shape, held.unit_shape):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"label": ""}, "mode label must be text and not empty, got ''"),
        ({"label": 1}, "mode label must be text and not empty, got 1"),
        ({"frequency": 0.0}, "mode '1': frequency_hz must be positive and finite, got 0.0"),
        ({"frequency": -1.5}, "mode '1': frequency_hz must be .* got -1.5"),
        ({"frequency": NAN}, "mode '1': frequency_hz must be .* got nan"),
        ({"frequency": "1"}, "mode '1': frequency_hz must be a number, got '1'"),
        ({"frequency_cov": 0.0}, "mode '1': frequency_cov must be positive .* got 0.0"),
        ({"frequency_cov": math.inf}, "mode '1': frequency_cov must be positive .* got inf"),
        ({"frequency_cov": True}, "mode '1': frequency_cov must be a number, got True"),
        ({"shape_sd": -0.1}, "mode '1': shape_sd must be positive .* got -0.1"),
        ({"damping": 1.0}, "mode '1': damping must be a fraction .* got 1.0"),
        ({"damping": -0.01}, "mode '1': damping must be a fraction .* got -0.01"),
        ({"damping": NAN}, "mode '1': damping must be a fraction .* got nan"),
        ({"shape": [0.0, 0.0]}, "mode '1': shape is zero at every sensor"),
        ({"shape": [0.0, NAN]}, "mode '1': shape is zero at every sensor"),
        ({"shape": [3e-200j, 0.0]}, "mode '1': shape must be in a usual scale, got 3e-200"),
        ({"shape": [3e200, 4e200]}, r"mode '1': shape must be in a usual scale, got 4e\+200"),
        ({"shape": [math.inf, 1.0]}, "mode '1': shape must be finite, got .*inf"),
        ({"shape": [[1.0, 2.0]]}, "mode '1': shape must be a list of numbers"),
        ({"shape": ["x", "y"]}, "mode '1': shape must be a list of numbers, got .*'x'"),
        ({"shape": [1.0, None]}, "mode '1': shape must be a list of numbers, got .*None"),
        ({"shape": [[1.0], [1.0, 2.0]]}, "mode '1': shape must be a list of numbers"),
    ],
)
def test_impossible_modes_are_refused(kwargs, message):
    assert_refused(message, mode, **kwargs)


def test_modes_are_sorted_by_frequency():
    held = data(mode("high", 3.0, [1, 0, 0]), mode("low", 1.0, [0, 1, 0]), mode("none", 2.0))
    assert held.labels == ("low", "none", "high")
    np.testing.assert_array_equal(held.frequencies_hz, [1.0, 2.0, 3.0])
    expected = [[0.0, NAN, 1.0], [1.0, NAN, 0.0], [0.0, NAN, 0.0]]
    np.testing.assert_array_equal(held.unit_shapes, expected)
    assert held.mode("none").frequency_hz == 2.0
    assert_refused("no identified mode '4'; choose from 'low', 'none', 'hi", held.mode, "4")


def test_without_shapes_keeps_the_frequencies():
    held = data(mode("1", 1.0, [1, 2, 3], frequency_cov=0.01, shape_sd=0.02), mode("2", 2.0))
    bare = held.without_shapes()
    assert bare.sensors == ()
    assert [m.shape for m in bare.modes] == [None, None]
    assert bare.mode("1").frequency_cov == 0.01
    assert bare.mode("1").shape_sd is None
    assert bare.band_hz == held.band_hz
    assert held.mode("1").shape.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("modes", "kwargs", "message"),
    [
        ([], {}, "modal data: no identified mode"),
        ([mode("1"), mode("1", 2.0)], {}, "modal data: two modes have the label '1'"),
        ([mode()], {"sensors": ("a", "b", "a")}, "modal data: two sensors are named 'a'"),
        ([mode("x", 7.0)], {}, "mode 'x': frequency_hz 7.0 lies outside the band 0.0 to 6.0 Hz"),
        ([mode("x", 0.5)], {"band": (1, 6)}, "mode 'x': frequency_hz 0.5 lies outside the band"),
        ([mode("x", 1.0, [1, 2])], {}, "mode 'x': shape has 2 components for 3 sensors"),
        ([mode()], {"band": (6.0, 0.0)}, "band_hz must be 0 <= lowest < highest, got 6.0, 0.0"),
        ([mode()], {"band": (1.0, 1.0)}, "band_hz must be 0 <= lowest < highest"),
        ([mode()], {"band": (-1.0, 6.0)}, "band_hz must be 0 <= lowest < highest, got -1.0"),
        ([mode()], {"band": (0.0, math.inf)}, "band_hz must be 0 <= lowest < highest, .* inf"),
        ([mode()], {"band": (0.0, NAN)}, "band_hz must be 0 <= lowest < highest, .* nan"),
        ([mode()], {"band": 6.0}, "band_hz must be two frequencies in Hz, got 6.0"),
        ([mode()], {"band": (0, 1, 2)}, "band_hz must be two frequencies in Hz"),
        ([mode()], {"band": ("low", "high")}, "band_hz must be two frequencies in Hz"),
    ],
)
def test_impossible_data_are_refused(modes, kwargs, message):
    assert_refused(message, data, *modes, **kwargs)


def test_modes_on_the_ends_of_the_band_are_accepted():
    assert data(mode("1", 1.0), mode("2", 6.0), band=(1.0, 6.0)).labels == ("1", "2")


FIRST = mode("1", 1.0, [0.1, 0.2, 0.3])
SECOND = mode("2", 2.5, [0.3, NAN, -0.2])
DATA = data(FIRST, SECOND)
WITH_ZERO = data(mode("1", 1.0, [1.0, 0.0, 2.0]))


@pytest.mark.parametrize(
    ("same", "other"),
    [
        (data(SECOND, FIRST), DATA),
        (replace(DATA, source="another laboratory"), DATA),
        (data(replace(FIRST, damping=0.02), SECOND), DATA),
        (data(replace(FIRST, frequency_cov=0.01, shape_sd=0.1), SECOND), DATA),
        (data(mode("1", 1.0, [10.0, 20.0, 30.0]), SECOND), DATA),
        (data(mode("1", 1.0, np.array([0.1, 0.2, 0.3]) * (1.0 + 2.0j)), SECOND), DATA),
        (data(mode("1", 1.0, [-0.1, -0.2, -0.3]), SECOND), DATA),
        (data(mode("1", 1.0, [NAN, 3.0, NAN])), data(mode("1", 1.0))),
        *((data(mode("1", 1.0, [1.0, x, 2.0])), WITH_ZERO) for x in (-0.0, 1e-13, -1e-13)),
    ],
    ids=["order", "source", "damping", "error", "scale", "phase", "sign", "one", "-0", "+", "-"],
)
def test_digest_is_the_same_for_the_same_density(same, other):
    assert same.digest == other.digest


@pytest.mark.parametrize(
    "other",
    [
        data(FIRST),
        data(mode("1", 1.0001, [0.1, 0.2, 0.3]), SECOND),
        data(mode("1", 1.0, [0.1, 0.2, 0.3001]), SECOND),
        data(mode("1", 1.0, [0.1, 0.2, NAN]), SECOND),
        data(mode("1", 1.0), SECOND),
        replace(DATA, band_hz=(0.0, 7.0)),
        replace(DATA, sensors=("a", "b", "d")),
        DATA.without_shapes(),
    ],
    ids=["modes", "frequency", "shape", "sensor", "no shape", "band", "name", "without shapes"],
)
def test_digest_differs_for_other_data(other):
    assert other.digest != DATA.digest


@pytest.mark.parametrize(
    ("modes", "remark"),
    [
        ([mode("x", 1.0)], "mode 'x': no shape; only its frequency is used"),
        ([mode("x", 1.0, [NAN, 1.0, NAN])], "mode 'x': shape at one sensor only"),
        ([mode("x", 1.0, [NAN, 1.0, 2.0])], "mode 'x': shape not measured at a"),
        ([mode("x", 1.0, [1.0, 1j, 0.5])], "mode 'x': phases scatter by 42 degrees"),
        ([mode("x", 1.0, [1, 1, 1], frequency_cov=1.5)], "mode 'x': frequency_cov is 1.5"),
        ([mode("x", 1.0, [1, 1, 1], damping=0.5)], "mode 'x': damping is 0.5, a fraction: 50 %"),
        ([mode("x", 1.0, [1, 1, 1]), mode("y", 1.0, [1, 0, 0])], "'x' and 'y': the same freq"),
        ([mode("x", 2.6, [1, 1, 1]), mode("y", 3.0, [-1, -1, -0.8])],
         "modes 'x' and 'y': 15 % apart with similar shapes (MAC 0.99)"),
    ],
)  # fmt: skip
def test_warnings(modes, remark):
    warnings = data(*modes).warnings()
    assert len(warnings) == 1
    assert remark in warnings[0]


def test_the_numerical_study_shows_a_split_mode(case_c):
    # MAC of the two shapes: (0.674 0.794 + 0.240 0.376 + 0.698 0.478)^2 = 0.92.
    (warnings,) = case_c.warnings()
    assert "modes '2a' and '2b': 15 % apart" in warnings
    assert "MAC 0.92" in warnings


@pytest.mark.parametrize(
    "modes",
    [
        [mode("x", 1.0, [1, 1, 1]), mode("y", 3.0, [1, 1, 1])],
        [mode("x", 2.6, [1, 1, 1]), mode("y", 3.0, [1, -1, 1])],
        [mode("x", 1.0, [1.0 + 0.05j, 1.0, 1.0], frequency_cov=0.01)],
    ],
)
def test_ordinary_data_have_no_warnings(modes):
    assert data(*modes).warnings() == []


def test_shapes_that_vanish_where_both_are_measured_are_not_compared():
    warnings = data(mode("x", 1.0, [0, 0, 1]), mode("y", 1.1, [1, 1, NAN])).warnings()
    assert warnings == ["mode 'y': shape not measured at c"]


def test_modes_from_arrays_take_one_number_for_all_or_one_for_each():
    shapes = np.array([[0.6, 0.8], [0.8, -0.6]])
    given = partial(bs.ModalData.from_arrays, (1.0, 2.0), shapes, (0.0, 3.0), ("a", "b"))
    assert [mode.frequency_cov for mode in given(frequency_cov=0.01).modes] == [0.01, 0.01]
    assert [mode.damping for mode in given(damping=(0.02, np.nan)).modes] == [0.02, None]
    with pytest.raises(ValueError, match=r"damping must be one number or 2, .* got shape \(3,\)"):
        given(damping=(0.02, 0.03, 0.04))


def test_the_full_digest_holds_what_a_run_depends_on():
    one = data(mode("1", 1.0, [1.0, 2.0, 3.0]))
    assert bs.ModalData(one.modes, one.band_hz, one.sensors, "elsewhere").full_digest == (
        one.full_digest
    )
    for change in ({"frequency_cov": 0.01}, {"shape_sd": 0.02}, {"label": "2"}):
        other = data(replace(one.modes[0], **change))
        assert other.digest == one.digest
        assert other.full_digest != one.full_digest
