"""Records are checked, and read from every format with what files state about them."""

import tracemalloc
from functools import partial

import numpy as np
import pytest
from conftest import FLOORS, assert_refused

import bayes_ssi as bs
from bayes_ssi.measurements.records.spectra import transforms_of

RATE = 50.0
TIMES = np.arange(400) / RATE
SAMPLES = np.array([np.sin(9 * TIMES), np.cos(7 * TIMES) + 0.3, 0.1 * TIMES])


def record(**changed):
    given = {
        "samples": SAMPLES, "rate_hz": RATE, "sensors": FLOORS, "quantity": "acceleration",
        "unit": "m/s2",
    }  # fmt: skip
    return bs.Record(**(given | changed))


def test_a_record_says_what_it_holds():
    one = record(unit="M/S^2")
    assert (one.unit, one.n_samples, one.duration_s, one.nyquist_hz) == ("m/s2", 400, 8.0, 25.0)
    chosen = one.selected(["floor 3", "floor 1"])
    np.testing.assert_array_equal(chosen.samples, SAMPLES[[2, 0]])
    assert chosen.sensors == ("floor 3", "floor 1")
    with pytest.raises(ValueError, match="read-only"):
        one.samples[0, 0] = 1.0
    with pytest.raises(ValueError, match="no sensor 'floor 1, floor 2'; choose from 'floor 1', "):
        one.selected("floor 1, floor 2")


def test_an_array_that_nobody_can_change_is_not_copied():
    frozen = SAMPLES.copy()
    frozen.setflags(write=False)
    assert np.shares_memory(record(samples=frozen).samples, frozen)
    assert not np.shares_memory(record().samples, SAMPLES)


def changed(value, *numbers):
    samples = SAMPLES.copy()
    samples[1, np.array(numbers) - 1] = value
    return samples


def test_instants_that_are_not_numbers_are_gaps():
    one = record(samples=changed(np.nan, 1, 10, 11, 400))
    # Without the first and the last, and from 9 to 12 on a straight line.
    assert (one.n_samples, one.gaps) == (398, ((8, 10),))
    np.testing.assert_allclose(
        one.samples[1, 7:11], np.interp([9, 10, 11, 12], [9, 12], SAMPLES[1, [8, 11]])
    )
    assert one.selected(["floor 3"]).gaps == one.gaps
    assert one.warnings()[0].startswith("missing: 2 samples from 0.16 to 0.2 s; the pieces")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"samples": SAMPLES.T}, r"400 rows of 3; is the array the wrong way round\?"),
        ({"samples": SAMPLES[:0], "sensors": ()}, "no sensors"),
        ({"samples": changed(np.inf, 7)}, "sensor 'floor 2': sample 7 is not finite: inf"),
        (
            {"samples": changed(np.nan, *range(1, 202))},
            "50% of the instants are missing at some sensor, at 'floor 2' 50%; leave that sensor",
        ),
        ({"samples": SAMPLES * 1j}, "samples must be rows of real numbers"),
        ({"samples": SAMPLES[0]}, r"must be \(n_sensors, n_samples\), got \(400,\)"),
        ({"sensors": FLOORS[:2]}, "2 names for 3 sensors"),
        ({"sensors": ("a", "b", "a")}, "two sensors are named 'a'"),
        ({"sensors": ("a", "b", "damping")}, "may not be named 'damping'"),
        ({"rate_hz": np.float64(0.0)}, "rate_hz must be a positive, finite number, got 0.0"),
        ({"quantity": "force"}, "quantity must be one of 'acceleration', .* got 'force'"),
        ({"quantity": "velocity"}, "unit of velocity must be one of 'm/s', .* got 'm/s2'"),
    ],
)
def test_a_wrong_record_is_refused(changed, message):
    assert_refused(message, record, **changed)


def test_a_band_must_be_in_the_record():
    assert record().checked_band((0.5, 25)) == (0.5, 25.0)
    assert_refused("30 Hz is beyond 25 Hz, half the rate", record().checked_band, (0.5, 30))
    with pytest.raises(ValueError, match=r"0\.05 Hz is below 0\.125 Hz, the lowest frequency in"):
        record().checked_band((0.05, 2))


def test_what_is_identified_from_needs_no_copy_of_a_long_record():
    """The lines of a band are found sensor by sensor."""
    samples = np.random.default_rng(0).standard_normal((20, 50_000))
    long = record(samples=samples, sensors=tuple(f"sensor {i}" for i in range(20)))
    short = record(samples=samples[:, :10_000], sensors=long.sensors)
    transforms_of(short, (0.5, 1.0))  # scipy is imported
    tracemalloc.start()
    transforms_of(long, (0.5, 1.0))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 0.5 * samples.nbytes


STATED = {"rate_hz": RATE, "quantity": "acceleration", "unit": "g"}


def csv(path, *, time=False):
    stated, names, columns = dict(STATED), FLOORS, SAMPLES.T
    if time:
        del stated["rate_hz"]
        names, columns = ("time (s)", *FLOORS), np.column_stack([TIMES, SAMPLES.T])
    head = "\n".join([*(f"# {key}, {value}" for key, value in stated.items()), ",".join(names)])
    np.savetxt(path, columns, fmt="%.12g", delimiter=",", header=head, comments="")
    return path


def npz(path):
    np.savez(path, acceleration=SAMPLES.T, sensors=FLOORS, **STATED)
    return path


def mat(path):
    from scipy.io import savemat

    savemat(path, {"a": SAMPLES, "sensors": np.array(FLOORS, dtype=object), **STATED})
    return path


def hdf5(path):
    with pytest.importorskip("h5py").File(path, "w") as file:
        dataset = file.create_dataset("setup 1/samples", data=SAMPLES)
        dataset.attrs.update(STATED)
        dataset.attrs["sensors"] = FLOORS
    return path


@pytest.mark.parametrize(
    ("write", "name"),
    [(csv, "a.csv"), (partial(csv, time=True), "a.txt"), (npz, "a.npz"), (mat, "a.mat"),
     (hdf5, "a.h5")],
)  # fmt: skip
def test_files_that_state_all(tmp_path, write, name):
    one = bs.read_record(write(tmp_path / name))
    np.testing.assert_allclose(one.samples, SAMPLES, rtol=1e-10, atol=1e-12)
    assert (one.sensors, one.quantity, one.unit) == (FLOORS, "acceleration", "g")
    assert one.rate_hz == pytest.approx(RATE, rel=1e-9)


def test_plain_numbers_need_what_they_do_not_state(tmp_path):
    path = tmp_path / "a.txt"
    np.savetxt(path, SAMPLES.T)
    given = {"rate_hz": RATE, "quantity": "velocity", "unit": "mm/s", "sensors": FLOORS}
    np.testing.assert_array_equal(bs.read_record(path, **given).samples, SAMPLES)
    for missing, message in {
        "rate_hz": "rate_hz, the samples per second, is not given",
        "unit": "the unit of the samples is not given; give one of 'm/s'",
        "sensors": "the names of the 3 sensors are not given",
    }.items():
        with pytest.raises(ValueError, match=f"a.txt: {message}"):
            bs.read_record(path, **{k: v for k, v in given.items() if k != missing})
    del given["quantity"]
    assert bs.read_record(path, **given).quantity == "velocity"  # as its unit says
    assert_refused(r"\(--rate\); .*\(--quantity\); .*unit.*; .*\(--sensor\)", bs.read_record, path)


def of_columns(path, times, *, named=True, separator=","):
    """A record read from a file of three sensors, with times as they are printed."""
    samples = np.random.default_rng(0).standard_normal((len(times), 3))
    rows = [
        separator.join([time, *(f"{x:.3f}" for x in row)])
        for time, row in zip(times, samples, strict=True)
    ]
    names = [separator.join("tabc")] if named else []
    path.write_text("\n".join(["# quantity, acceleration", "# unit, g", *names, *rows]) + "\n")
    return bs.read_record(path, sensors=FLOORS)


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize(
    ("rate", "decimals", "lost"),
    [
        *((100, 2, []), (100, 3, []), (128, 3, []), (60, 3, []), (80, 2, []), (128, 2, [])),
        (99.9, 3, []),
        (100, 2, [150]),
        (100, 3, [150, 151, 152]),
        (128, 3, [700, 900]),
        (100, 2, range(20, 2990, 21)),  # 4.7 % of the rows, every 21st of them
    ],
)
def test_times_may_be_rounded_as_they_are_printed(tmp_path, rate, decimals, lost, named):
    """And rows that were lost are gaps."""
    times = [f"{k / rate:.{decimals}f}" for k in range(3000) if k not in lost]
    one = of_columns(tmp_path / "a.csv", times, named=named)
    assert np.flatnonzero(~one.is_measured).tolist() == [*lost]
    # The first and last time are right by half of their last digit.
    allowed = 1e-4 if lost else 10.0**-decimals / one.duration_s
    assert one.rate_hz == pytest.approx(rate, rel=allowed)


@pytest.mark.parametrize("separator", [",", "\t", " "])
@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("form", ["{}T{}", "{} {}", "{}T{}Z", "{} {}+02:00", '"{} {}"'])
def test_iso_time_stamps(tmp_path, form, named, separator):
    # Over midnight.
    stamps = np.datetime64("2024-05-12T23:59:59.500") + np.timedelta64(10, "ms") * np.arange(200)
    times = [form.format(*str(stamp).split("T")) for stamp in stamps]
    for each, gaps in ((times, ()), (times[:50] + times[53:], ((50, 53),))):
        one = of_columns(tmp_path / "a.csv", each, named=named, separator=separator)
        assert one.rate_hz == pytest.approx(100.0, rel=1e-9)
        assert one.gaps == gaps


def test_several_files_of_one_setup(tmp_path):
    paths = []
    for name, row in zip(FLOORS, SAMPLES, strict=True):
        paths.append(tmp_path / f"{name}.npz")
        np.savez(paths[-1], samples=row, sensors=name, **STATED)
    np.testing.assert_array_equal(bs.read_record(paths).samples, SAMPLES)
    np.savez(tmp_path / "short.npz", samples=SAMPLES[0, :300], sensors="roof", **STATED)
    with pytest.raises(ValueError, match=r"short\.npz: 300 samples, but 400 in .*floor 1\.npz"):
        bs.read_record([paths[0], tmp_path / "short.npz"])
    np.savez(tmp_path / "fast.npz", samples=SAMPLES[0], sensors="roof", **STATED | {"rate_hz": 99})
    with pytest.raises(ValueError, match="two rates are given: 50 and 99 Hz"):
        bs.read_record([paths[0], tmp_path / "fast.npz"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no samples"),
        ("a,b\n1,2\n3,x\n", "line 3, column 2: 'x' is not a number"),
        (
            "# a comment\na,b\n\n1,2\n# another\n3,4\n5,6,7\n",
            "line 7: 3 cells, where the rows above have 2",
        ),
        ("a,b\n1,2,3\n4,5,6\n", "2 column names for 3 columns"),
        ("# rate_hz, fast\na,b\n1,2\n3,4\n", "rate_hz must be a positive, finite number"),
        ("# rate_hz, 9\n# rate_hz: 10\na,b\n0,1\n1,0\n", "line 2: rate_hz is 9, and now 10"),
        ("# rate_hz, 9\nt,a,b\n0,1,2\n0.1,1,2\n0.2,1,3\n", "two rates are given: 9 and 10 Hz"),
    ],
)
def test_a_wrong_text_file_is_explained(tmp_path, text, message):
    path = tmp_path / "a.csv"
    path.write_text(text)
    assert_refused(f"a.csv: .*{message}", bs.read_record, path, quantity="acceleration", unit="g")


def test_a_wrong_file_of_arrays_is_explained(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, first=SAMPLES, second=SAMPLES[:, :9], **STATED)
    assert_refused("'first', 'second' differ in length", bs.read_record, path)
    with pytest.raises(ValueError, match="no array of samples 'third'; choose from 'first', 'sec"):
        bs.read_record(path, keys=["third"])
    assert bs.read_record(path, keys=["first"], sensors=FLOORS).sensors == FLOORS
    np.savez(path, samples=SAMPLES, **STATED | {"rate_hz": [1.0, 2.0]})
    assert_refused(r"rate_hz must be .*, got \[1.0, 2.0\]", bs.read_record, path)
    np.savez(path, samples=SAMPLES * 1j)
    assert_refused(r"no rows .*; it holds 'samples' \(complex128, \(3, 400\)", bs.read_record, path)
    for ending in ("npz", "mat", "h5"):
        damaged = tmp_path / f"damaged.{ending}"
        damaged.write_bytes(b"nothing of the kind " * 20)
        assert_refused(f"damaged.{ending}: cannot be read; damaged", bs.read_record, damaged)
    with pytest.raises(FileNotFoundError):
        bs.read_record(tmp_path / "none.csv")


@pytest.mark.parametrize("is_even", [1, 0])
def test_a_universal_file(tmp_path, is_even):
    pyuff = pytest.importorskip("pyuff", reason="pip install bayes_ssi[uff]")
    path = str(tmp_path / "a.uff")
    for node, row in enumerate(SAMPLES, 1):
        one = {
            "type": 58, "binary": 0, "func_type": 1, "rsp_node": node, "rsp_dir": -1, "ref_node": 0,
            "ref_dir": 0, "data": row, "x": TIMES, "id1": "", "rsp_ent_name": "NONE",
            "ref_ent_name": "NONE", "abscissa_spacing": is_even,
            "abscissa_spec_data_type": 17,
            "ordinate_spec_data_type": 12, "ordinate_axis_units_lab": "m/s2",
            "orddenom_spec_data_type": 0,
        }  # fmt: skip
        pyuff.UFF(path).write_sets([one], "add")
    one = bs.read_record(path)
    # Measured along -x.
    np.testing.assert_allclose(one.samples, -SAMPLES, rtol=1e-4, atol=1e-6)
    assert (one.sensors, one.quantity, one.unit) == (("1 x", "2 x", "3 x"), "acceleration", "m/s2")
    assert one.rate_hz == pytest.approx(RATE, rel=1e-5 if is_even else 1e-3)


def test_a_tdms_file(tmp_path):
    nptdms = pytest.importorskip("nptdms", reason="pip install bayes_ssi[tdms]")
    path = tmp_path / "a.tdms"
    stated = {"wf_increment": 1 / RATE, "unit_string": "g"}
    with nptdms.TdmsWriter(path) as writer:
        for name, row in zip(FLOORS, SAMPLES, strict=True):
            writer.write_segment([nptdms.ChannelObject("setup", name, row, properties=stated)])
    one = bs.read_record(path, quantity="acceleration")
    np.testing.assert_array_equal(one.samples, SAMPLES)
    assert (one.sensors, one.unit) == (FLOORS, "g")
    assert one.rate_hz == pytest.approx(RATE)
    with pytest.raises(ValueError, match="no group 'other'; choose from 'setup'"):
        bs.read_record(path, quantity="acceleration", keys=["other"])
