"""Ground motion and its files: what is read, warned of, and refused in one clear line."""

import math

import numpy as np
import pytest
from conftest import assert_refused

import bayes_ssi as bs

G = 9.80665
SAMPLES = [-0.1, 0.25e-2, 0.3, -0.4, 0.5, -0.6]
AT2 = """PEER NGA STRONG MOTION DATABASE RECORD
Somewhere, 1/1/1999, Station, 360
ACCELERATION TIME SERIES IN UNITS OF {unit}
{counts}
 -.1000000E+00  .2500000E-02  .3000000E+00 -.4000000E+00  .5000000E+00
 -.6000000E+00
"""


@pytest.fixture
def load(tmp_path):
    def load(name, text, **options):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return bs.read_ground_motion(path, **options)

    return load


@pytest.mark.parametrize(
    "counts", ["NPTS=   6, DT=   .0050 SEC,", "   6   0.0050   NPTS, DT", "NPTS= 6, DT= 5.E-3"]
)
def test_at2(load, counts):
    """Also where signs touch."""
    text = AT2.format(unit="G", counts=counts)
    for name, each in (("quake.AT2", text), ("quake.at2", text.replace(" -", "-"))):
        motion = load(name, each)
        np.testing.assert_allclose(motion.acceleration, G * np.array(SAMPLES), rtol=1e-12)
        assert (motion.dt, motion.name) == (0.005, "quake")


@pytest.mark.parametrize(
    ("unit", "in_si"),
    [
        ("G", G), ("G's. FILTER POINTS: 0.1", G), ("CM/S/S", 0.01), ("cm/s^2", 0.01),
        ("CM/SEC/SEC", 0.01), ("CM/SEC**2", 0.01), ("GAL", 0.01), ("M/S**2", 1.0), ("m·s⁻²", 1.0),
        ("MM/SEC/SEC", 0.001), ("IN/SEC2", 0.0254), ("ft/s2", 0.3048),
    ],
)  # fmt: skip
def test_units_as_at2_files_spell_them(load, unit, in_si):
    motion = load("quake.AT2", AT2.format(unit=unit, counts="NPTS= 6, DT= .005 SEC"))
    np.testing.assert_allclose(motion.acceleration, in_si * np.array(SAMPLES), rtol=1e-12)


@pytest.mark.parametrize("stated", ["G", "CM/S", "COUNTS"])
def test_a_given_unit_takes_the_place_of_the_files(load, stated):
    text = AT2.format(unit=stated, counts="NPTS= 6, DT= .005 SEC")
    motion = load("quake.AT2", text, unit="cm/s2")
    np.testing.assert_allclose(motion.acceleration, 0.01 * np.array(SAMPLES), rtol=1e-12)


@pytest.mark.parametrize(
    ("unit", "counts", "options", "message"),
    [
        ("G", "NPTS= 7, DT= .005 SEC", {}, "the header says NPTS = 7, but 6 values follow"),
        ("G", "NPTS= 6", {}, "dt, the time between samples, is not given"),
        ("G", "NPTS= 6, DT= 0.0 SEC", {}, "dt must be positive"),
        ("G", "NPTS= , DT= .005 SEC", {}, "holds no number of points"),
        ("G. UNITS: M/S/S", "NPTS= 6, DT= .005 SEC", {}, "two of unit are given: 'g' and 'm/s2'"),
        ("G", "6 points", {}, "no header line states NPTS and DT"),
        ("CM/S", "NPTS= 6, DT= .005 SEC", {}, "one of 'g', 'm/s2', .*, got 'CM/S'"),
        ("G", "NPTS= 6, DT= .005 SEC", {"dt": 0.01}, "two rates are given: 100 and 200 Hz"),
        ("G", "NPTS= 6, DT= .005 SEC\n0.1 spam", {}, "line 5: expected accelerations, .*'spam'"),
    ],
)  # fmt: skip
def test_at2_that_is_wrong(load, unit, counts, options, message):
    text = AT2.format(unit=unit, counts=counts)
    assert_refused(rf"quake.AT2: .*{message}", load, "quake.AT2", text, **options)


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("1\n2\n4\n", {"unit": "cm/s2", "dt": 0.02}),
        ("# unit, cm/s2\n# dt_s, 0.02\n1\n2\n4\n", {}),
        ("# unit, cm/s²\ntime_s,acceleration\n0.00,1\n0.02,2\n0.04,4\n", {}),
        ("t (s);a (cm/s²)\n0,00;1,0\n0,02;2,0\n0,04;4,0\n", {"unit": "cm/s2"}),
        ("# unit, m/s2\n1\n2\n4\n", {"unit": "cm/s2", "dt": 0.02}),
        ("time\ta [cm/s^2]\n5.00\t1\n5.02\t2\n5.04\t4\n", {"unit": "cm/s2", "dt": 0.02}),
    ],
)
def test_plain_text_and_csv(load, text, options):
    motion = load("quake.csv", text, **options)
    np.testing.assert_allclose(motion.acceleration, [0.01, 0.02, 0.04], rtol=1e-12)
    assert motion.dt == pytest.approx(0.02, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("1\n", {"unit": "g", "dt": 0.1}, "two samples or more, got 1"),
        ("1\n2\n", {"unit": "g"}, "dt, the time between samples, is not given"),
        ("1\n2\n", {"dt": 0.1}, "the unit of the acceleration is not given; give one of 'g'"),
        ("# unit, ft\n1\n2\n", {"dt": 0.1}, "got 'ft'"),
        ("# quantity, velocity\n1\n2\n", {"dt": 0.1}, "holds a velocity, not an acceleration"),
        ("# dt_s, 0.1\n1\n2\n", {"unit": "g", "dt": 0.2}, "two rates are given: 5 and 10 Hz"),
        ("time a\n0.0 1\n0.1 2\n0.2 3\n0.5 4\n", {"unit": "g"}, "sample 4 is missing"),
        ("1\nnan\n2\n", {"unit": "g", "dt": 0.1}, "sample 2 is missing"),
        ("0 1 2\n0.1 2 3\n0.2 3 4\n0.3 3 4\n", {"unit": "g"}, r"2 channels \(without names\)"),
        ("t (s),x,y\n0,1,2\n1,2,3\n2,3,4\n3,4,5\n", {"unit": "g"}, r"2 channels \('x', 'y'\)"),
        ("# dt_s, 0.1\n1\n2\n", {"unit": "g", "dt": np.nan}, r"dt must be positive .*, got nan"),
        ("1\n2\n", {"unit": "g", "dt": -0.1}, r"dt must be positive and finite \(s\), got -0.1"),
    ],
)
def test_files_that_are_wrong(load, text, options, message):
    assert_refused(rf"quake.txt: .*{message}", load, "quake.txt", text, **options)


def test_a_channel_of_a_record_in_another_format(tmp_path):
    np.savez(tmp_path / "quake.npz", a=0.1 * np.arange(4.0), dt_s=0.02, unit="g")
    motion = bs.read_ground_motion(tmp_path / "quake.npz")
    np.testing.assert_allclose(motion.acceleration, G * 0.1 * np.arange(4.0), rtol=1e-12)
    assert motion.dt == pytest.approx(0.02, rel=1e-12)


@pytest.mark.parametrize(
    ("samples", "dt", "message"),
    [
        ([], 0.01, "two samples or more, got 0"),
        ([1.0], 0.01, "two samples or more, got 1"),
        ([[1.0, 2.0]], 0.01, r"two samples or more, got \(1, 2\)"),
        ([1.0, math.inf, math.nan], 0.01, "sample 2 is not finite: inf"),
        (["a", "b"], 0.01, "must be a list of numbers"),
        ([1.0, 2.0], 0.0, "dt must be positive and finite"),
        ([1.0, 2.0], math.nan, "dt must be positive and finite"),
        ([1.0, 2.0], None, "dt must be positive and finite"),
    ],
)
def test_invalid_records(samples, dt, message):
    assert_refused(message, bs.GroundMotion, samples, dt)


def test_a_peak_beyond_any_earthquake_and_modes_above_half_the_sampling_rate_are_reported():
    (text,) = bs.GroundMotion([0.0, 1961.33], 0.01, "roof").warnings(np.array([1.0]))
    assert text.startswith("record roof: its peak, 200 g, is beyond")
    assert bs.GroundMotion([0.0, 39.2], 0.01).warnings(np.array([1.0])) == []
    motion = bs.GroundMotion([0.0, 1.0], 0.05, "slow")
    (text,) = motion.warnings(np.array([1.0, 9.9, 10.1, 30.0]))
    assert "carry frequencies up to 10 Hz; mode 3 of the structure, at 10.1 Hz" in text
    assert motion.warnings(np.array([1.0, 9.9])) == []
