"""Files of identified modes: CSV, round trips, messages that say where; those of other tools."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
from conftest import assert_refused

import bayes_ssi as bs
from bayes_ssi.measurements.records.record_files import is_record

HEAD = "# band_hz, 0, 6\nlabel, frequency_hz, a, b\n"
COMMAS = """# source, ambient vibration test of 12 May
# band_hz, 0, 6.5
label, frequency_hz, frequency_cov, damping, floor 1, floor 2

1,     0.983,        0.001,         0.012,   0.331,   0.593
2a,    2.604,        ,              ,        -6.74e-1,
"""
SEMICOLONS = """# source; ambient vibration test of 12 May
# band_hz; 0; 6,5
label; frequency_hz; frequency_cov; damping; floor 1; floor 2
1; 0,983; 0,001; 0,012; 0,331; 0,593
2a; 2,604; ; ; -6,74e-1;
"""


@pytest.fixture
def read(tmp_path):
    """Reads the modes from a text written to ``modes.csv``."""

    def read_text(text, encoding="utf-8", **kwargs):
        path = tmp_path / "modes.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return bs.read_modal_data(path, **kwargs)

    return read_text


@pytest.fixture
def round_trip(tmp_path):
    """Saves data and loads them again."""

    def save_and_load(data):
        bs.write_modal_data(data, tmp_path / "saved.csv")
        return bs.read_modal_data(tmp_path / "saved.csv")

    return save_and_load


def assert_same(data, other):
    assert data.labels == other.labels
    assert data.sensors == other.sensors
    assert data.band_hz == other.band_hz
    assert data.source == other.source
    assert data.digest == other.digest
    for mode, same in zip(data.modes, other.modes, strict=True):
        for name in ("frequency_hz", "frequency_cov", "shape_sd", "damping", "damping_sd"):
            assert getattr(mode, name) == getattr(same, name)
        if mode.shape is None:
            assert same.shape is None
        else:
            np.testing.assert_array_equal(mode.shape, same.shape)


@pytest.mark.parametrize(
    "text",
    [
        COMMAS,
        SEMICOLONS,
        SEMICOLONS.replace("; ", "\t").replace(";", "\t"),
        SEMICOLONS.replace("; ", "\t").replace(";", "\t").replace(",", "."),
        "\ufeff" + COMMAS,
        COMMAS.replace("\n", "\r\n"),
        "sep=,\n" + COMMAS,
        "\ufeffsep=;\r\n" + SEMICOLONS.replace("\n", "\r\n"),
        COMMAS.replace(", 0, 6.5", ": 0, 6.5").replace("source,", "source:"),
        COMMAS.replace("band_hz, 0", "Band_hz = 0"),
        "# a remark, 5\n\n" + COMMAS,
        COMMAS.replace("2,\n", "2, , ,\n").replace("0.593", "0.593,,"),
        COMMAS.replace("floor 1", '"floor 1"').replace("2a", '"2a"'),
    ],
)
def test_every_form_gives_the_same_data(read, text):
    data = read(text)
    assert data.source == "ambient vibration test of 12 May"
    assert data.band_hz == (0.0, 6.5)
    assert data.sensors == ("floor 1", "floor 2")
    assert data.labels == ("1", "2a")
    first, second = data.modes
    assert (first.frequency_hz, first.frequency_cov, first.damping) == (0.983, 0.001, 0.012)
    assert (second.frequency_hz, second.frequency_cov, second.damping) == (2.604, None, None)
    assert first.shape.tolist() == [0.331, 0.593]
    np.testing.assert_array_equal(second.shape, [-0.674, math.nan])


@pytest.mark.parametrize(
    ("cell", "value"),
    [("0.3+0.1j", 0.3 + 0.1j), ("-3e-1 - 0.1i", -0.3 - 0.1j), ("2i", 2j), ("0.5", 0.5)],
)
def test_complex_components(read, cell, value):
    assert read(HEAD + f"1, 1.0, {cell}, 1j\n").modes[0].shape.tolist() == [value, 1j]


def test_complex_components_with_decimal_commas(read):
    (mode,) = read("# band_hz; 0; 6\nlabel; frequency_hz; a; b\n1; 1,5; 0,3+0,1i; \n").modes
    assert mode.frequency_hz == 1.5
    assert mode.shape[0] == 0.3 + 0.1j
    assert np.isnan(mode.shape[1])


def test_a_row_of_empty_cells_and_a_file_without_sensors_have_no_shape(read):
    data = read(HEAD + "1, 1.0, , \n2, 2.0\n")
    assert [mode.shape for mode in data.modes] == [None, None]
    assert data.sensors == ("a", "b")
    data = read("# band_hz, 0, 6\nlabel, frequency_hz, shape_sd\n1, 1.0, 0.02\n")
    assert data.sensors == ()
    assert data.modes[0].shape_sd == 0.02


TABLES = {
    "radians and percent": "Mode, Frequency (rad/s), Damping (%), a, b\n"
    "1, 9.42477796, 1.2, 0.5, 1\n",
    "semicolons": "Mode No.;Frequency [Hz];Damping [%];a;b\n1;1,5;1,2;0,5;1,0\n",
    "no labels": "Frequency [Hz];Damping [%];a;b\n1,5;1,2;0,5;1,0\n",
    "an index": ", f (Hz), zeta [%], a, b\n1, 1.5, 1.2, 0.5, 1\n",
    "period": "label, Period (s), damping, a, b\n1, 0.66666666667, 0.012, 0.5, 1\n",
    "transposed": ", Mode 1\nf (Hz), 1.5\nDamping (%), 1.2\na, 0.5\nb, 1.0\n",
    "real and imaginary": "label, frequency_hz, damping, a re, a im, b re, b im\n"
    "1, 1.5, 0.012, 0.5, 0, 1, 0\n",
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_as_people_keep_them(read, name):
    (mode,) = read("# band_hz, 0, 6\n" + TABLES[name]).modes
    assert mode.label == ("Mode 1" if name == "transposed" else "1")
    assert mode.frequency_hz == pytest.approx(1.5, rel=1e-9)
    assert mode.damping == pytest.approx(0.012)
    np.testing.assert_allclose(mode.shape, [0.5, 1.0])


@pytest.mark.parametrize(
    ("names", "cells"),
    [
        ("a mag, a phase (deg), b", "2, 60, 1"),
        ("a (amplitude), a (phase), b", "2, 60, 1"),
        ("a mag, a phase [rad], b", f"2, {math.pi / 3}, 1"),
        ("a, b", "2∠60°, 1∠0"),
        ("a, b", f"2 ∠ {math.pi / 3} rad, 1"),
        ("a re, a im, b", f"1, {3**0.5}, 1"),
        ("a mag, a phase, b abs, b phase", "2, 420, 1, 0.0"),  # one of the phases is in degrees
    ],
)
def test_components_of_magnitude_and_phase(read, names, cells):
    data = read(f"# band_hz, 0, 6\nlabel, frequency_hz, {names}\n1, 1.0, {cells}\n")
    shape = dict(zip(data.sensors, data.modes[0].shape, strict=True))
    assert shape["a"] == pytest.approx(1 + 3**0.5 * 1j, rel=1e-12)
    assert shape["b"] == 1.0


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8-sig"])
def test_encodings(read, encoding):
    text = HEAD.replace(", a,", ", Träger,") + "1, 1, 1, 1\n"
    assert read(text.encode(encoding)).sensors == ("Träger", "b")


def test_a_workbook(tmp_path):
    book = pytest.importorskip("openpyxl", reason="pip install bayes_ssi[xlsx]").Workbook()
    for row in (["# band_hz", 0, 6], ["Mode", "Frequency [Hz]", "roof"], [1, 1.5, 0.5]):
        book.active.append(row)
    book.save(tmp_path / "modes.xlsx")
    data = bs.read_modal_data(tmp_path / "modes.xlsx")
    assert (data.band_hz, data.labels, data.sensors) == ((0.0, 6.0), ("1",), ("roof",))
    assert data.frequencies_hz.tolist() == [1.5]


def test_files_of_modes_and_records_are_told_apart(tmp_path):
    path = tmp_path / "a.csv"
    for text in (*TABLES.values(), HEAD, "Frequency,a\n", '"Mode" "Frequency [Hz]"\n1 1.5\n'):
        for encoding in ("utf-8", "utf-16"):
            path.write_text(text, encoding)
            assert not is_record(path)
    for text in ("t (s),a\n0,1\n", "Sampling frequency (Hz): 20\nNo,a\n1,2\n", "Mode,a\n1,2\n"):
        path.write_text(text)
        assert is_record(path)


NO_NUMBER = "is not a number"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + "1, 1.O, 1, 2\n", f"line 3: frequency_hz: '1.O' {NO_NUMBER}"),
        (HEAD + "\n1, 1.0, 1, 2\n2, x, 1, 2\n", f"line 5: frequency_hz: 'x' {NO_NUMBER}"),
        (HEAD + "1, 1_0, 1, 2\n", f"line 3: frequency_hz: '1_0' {NO_NUMBER}"),
        (HEAD + "1, , 1, 2\n", "line 3: frequency_hz: the cell is empty"),
        (HEAD + "1, 1.0, 1, two\n", f"line 3: sensor 'b': 'two' {NO_NUMBER}"),
        (HEAD + "1, 1.0, 1 2, 3\n", f"line 3: sensor 'a': '1 2' {NO_NUMBER}"),
        (HEAD + "1, 1.0, nan, 3\n", "line 3: sensor 'a': 'nan' is not finite; leave"),
        (HEAD + "1, 1.0, 1e999, 3\n", "line 3: sensor 'a': '1e999' is not finite"),
        (HEAD + "1, -1.0, 1, 2\n", "line 3: mode '1': frequency_hz must be .* got -1.0"),
        (HEAD + ", 1.0, 1, 2\n", "line 3: mode label must be text and not empty, got ''"),
        (HEAD + "1, 1,0, 1, 2\n", "line 3: 5 cells for 4 columns"),
        ("sep=,\n" + HEAD + "1, x, 1, 1\n", f"line 4: frequency_hz: 'x' {NO_NUMBER}"),
        (HEAD + "#1, 1.0, 1, 2\n2, 2.0, 1, 1\n", "line 3: a row beginning with '#' below"),
        (HEAD + "# band_hz, 0, 9\n1,1", "line 3: a second line of band_hz; the first is line 1"),
        ("# band_hz, 0, 9\n" + HEAD + "1,1,1,1", r"line 2: a second line of band_hz; .* line 1"),
        ("# source: a\n# Source: b\n" + HEAD + "1,1,1,1", "line 2: a second line of source"),
        ("# band_hz, 0\n" + HEAD[16:] + "1,1,1,1", r"line 1: band_hz needs two .* \['0'\]"),
        ("# band_hz, 0, six\nlabel, frequency_hz\n1, 1\n", f"line 1: band_hz: 'six' {NO_NUMBER}"),
        ("\n\nlabel, frequency\n1, 1\n", "line 3: column 'frequency': state its unit, 'frequ"),
        ("label, hertz\n1, 1\n", "line 1: no column 'frequency_hz' among 'label', 'hertz'"),
        ("rank, frequency_hz\n1, 1\n2, 2\n", "line 1: column 'rank' counts the modes; name it"),
        ("# band_hz, 0, 6\nlabel, period_s\n1, 0\n", "line 3: period_s: must be positive, got 0"),
        (HEAD + "1, 1.0, 1∠0.5, 3\n", "line 3: sensor 'a': '1∠0.5': state the unit of"),
        ("label, frequency_hz, a re, a im\n1, 1, 1, 0.3, 5\n", "line 2: 5 cells for 4 columns"),
        ("label, frequency_hz, a mag, a phase\n1, 1, 1, 0.3\n",
         r"line 1: column 'a phase': state its unit, 'a phase \(deg\)' or '\(rad\)'"),
        ("label, frequency_hz, , a\n1, 1\n", "line 1: column 3 has no name; name it, or"),
        (",Mode,Frequency (Hz)\n0,1,1.5\n", "line 1: column 1 has no name; .* if it counts"),
        ('"Mode" "Frequency [Hz]"\n1 1.5\n', "line 1: .* separated by commas, semicolons or tabs"),
        ("label, frequency_hz, a, a\n1, 1\n", "line 1: two columns are named 'a'"),
        (HEAD.replace("a, b", "frequency_cov") + "1, 1, 2 %\n", "line 3: frequency_cov: '2 %' is"),
        (HEAD.replace("a, b", "damping") + "1, 1, 1.2\n",
         "line 3: damping: 1.2 is no fraction .* name the column 'dam"),
        ("", "the file is empty"),
        (" \n\n", "the file is empty"),
        ("# band_hz, 0, 6\n", "the file holds no table of modes"),
        (HEAD, "no mode below the column names"),
        (HEAD + "1, 1, 1, 1\n1, 2, 1, 1\n", "modal data: two modes have the label '1'"),
        ("label, frequency_hz\n1, 1.0\n", "no band; add a line such as '# band_hz, 0, 6'"),
        ("# band_hz, 6, 0\n" + HEAD[16:] + "1, 1, 1, 1\n", "band_hz must be 0 <= lowest < highest"),
        (HEAD.encode() + b"a\0b, 1.0, 1, 1\n", r"not a text file; save it as CSV \(UTF-8\)"),
        ("<!DOCTYPE html>\n" + HEAD, r"a web page or XML, not a table; save it as CSV \(UTF-8\)"),
        (HEAD + "1, 1.0, 1, 1\n" * 200_000, "200,002 lines; a file of modes has one for each of"),
    ],
)  # fmt: skip
def test_messages_name_file_line_column_and_value(read, text, message):
    assert_refused(f"modes.csv{',' if message.startswith('line') else ':'} {message}", read, text)


def test_what_is_not_a_regular_file_is_refused_at_once(tmp_path):
    """A pipe that nobody writes to, and a device without end."""
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        for read in (bs.read_modal_data, bs.read_ground_motion):
            assert_refused(f"^{path}: not a regular file, but a pipe or a", read, path)
    with pytest.raises(IsADirectoryError):
        bs.read_modal_data(tmp_path)


@pytest.mark.parametrize(
    "modes",
    [
        [bs.IdentifiedMode("1", 1.0 / 3.0, [1 / 3, -2 / 7], 0.001, 0.02, 0.012)],
        [bs.IdentifiedMode("1", 1.0, [math.nan, 2.0], damping=0.0), bs.IdentifiedMode("2", 2.0)],
        [bs.IdentifiedMode("1", 1.0, [0.3 + 0.1j, 1 / 3 - 0.5j])],
        [bs.IdentifiedMode("1", 1.0, [-0.3j, complex(math.nan)])],
        [bs.IdentifiedMode("1", 1.0, [1e-300, 2e90 * 1j])],
        [bs.IdentifiedMode("a, b", 1.0), bs.IdentifiedMode('"x"', 2.0)],
        [bs.IdentifiedMode("1#", 1.0), bs.IdentifiedMode("2", 2.0)],
    ],
)
def test_round_trip(round_trip, modes):
    data = bs.ModalData(tuple(modes), (0.1, 7.0), ("floor 1", "roof, north"), "Test, of 12 May")
    assert_same(round_trip(data), data)


@pytest.mark.parametrize("sensor", ["floor 1; x", "#5", "roof, north", "id"])
@pytest.mark.parametrize("source", ["", "a: b", 'a "quoted" word', "µ-strain; tabs", "two\nlines"])
def test_round_trip_of_awkward_texts(round_trip, sensor, source):
    mode = bs.IdentifiedMode("1", 1.0, [1.0, 2.0])
    data = bs.ModalData((mode,), (0.0, 6.0), (sensor, "floor 2"), source)
    assert_same(round_trip(data), data)


@pytest.mark.parametrize("sensor", ["label", "frequency_hz", "frequency_cov", "damping"])
def test_a_sensor_named_like_a_column_is_refused(sensor):
    mode = bs.IdentifiedMode("1", 1.0, [1.0, 0.5])
    assert_refused(f"sensor.*'{sensor}'", bs.ModalData, (mode,), (0.0, 6.0), (sensor, "floor 2"))


def test_nothing_is_overwritten(tmp_path, case_c):
    path = tmp_path / "saved.csv"
    path.write_text("kept")
    with pytest.raises(FileExistsError):
        bs.write_modal_data(case_c, path)
    assert path.read_text() == "kept"


def test_a_label_that_would_read_as_a_remark_is_refused():
    assert_refused(r"mode label may not begin with '#'.*'#1'", bs.IdentifiedMode, "#1", 1.0)


def test_the_band_may_be_given_and_keys_may_stand_below_the_column_names(read):
    assert read(HEAD + "1, 1.0\n", band_hz=(0.5, 3)).band_hz == (0.5, 3.0)
    data = read("label, frequency_hz\n# band_hz, 0, 6\n1, 1.0\n# source: a test\n")
    assert (data.band_hz, data.source) == ((0.0, 6.0), "a test")


NODES = [11, 12, 13]
SHAPES = np.array([[0.3, 0.6, 0.74], [-0.78, -0.29, 0.55]])


def normal_mode(number, frequency_hz, shape):
    return {
        "type": 55, "id1": "NONE", "id2": "NONE", "id3": "NONE", "id4": "NONE", "id5": "NONE",
        "model_type": 1, "analysis_type": 2, "data_ch": 2, "spec_data_type": 8, "data_type": 2,
        "n_data_per_node": 3, "load_case": 1, "mode_n": number, "freq": frequency_hz,
        "modal_m": 1.0, "modal_damp_vis": 0.01, "modal_damp_his": 0.0, "node_nums": NODES,
        "r1": np.array(shape), "r2": np.zeros(3), "r3": np.zeros(3),
    }  # fmt: skip


def write(path, sets):
    pyuff = pytest.importorskip("pyuff", reason="pip install bayes_ssi[uff]")
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    return path


def test_normal_modes_of_a_universal_file(tmp_path):
    sets = [normal_mode(2, 2.76, SHAPES[1]), normal_mode(1, 0.96, SHAPES[0])]
    data = bs.read_modal_data(write(tmp_path / "modes.uff", sets), band_hz=(0, 6))
    assert data.sensors == ("11 x", "12 x", "13 x")
    np.testing.assert_allclose(data.frequencies_hz, [0.96, 2.76], rtol=1e-5)
    expected = SHAPES / np.linalg.norm(SHAPES, axis=1, keepdims=True)
    np.testing.assert_allclose(data.unit_shapes, expected.T, atol=1e-5)
    assert data.modes[0].damping == pytest.approx(0.01, rel=1e-4)
    assert not np.iscomplexobj(data.modes[0].shape)


def test_complex_modes(tmp_path):
    # ω = 6 rad/s, damping 2 %: λ = -0.12 ± 5.9988 i; a shape turned by 30 degrees.
    eigenvalue = 6.0 * (-0.02 + 1j * np.sqrt(1 - 0.02**2))
    turned = SHAPES[0] * np.exp(1j * np.pi / 6)
    complex_mode = {
        **normal_mode(1, 0.0, turned.real), "analysis_type": 3, "data_type": 5, "eig": eigenvalue,
        "modal_a": 1 + 0j, "modal_b": 1 + 0j, "r1": turned, "r2": np.zeros(3), "r3": np.zeros(3),
    }  # fmt: skip
    path = write(tmp_path / "modes.uff", [complex_mode])
    (mode,) = bs.read_modal_data(path, band_hz=(0, 6)).modes
    assert mode.frequency_hz == pytest.approx(6.0 / (2 * np.pi), rel=1e-5)
    assert mode.damping == pytest.approx(0.02, rel=1e-4)
    expected = SHAPES[0] / np.linalg.norm(SHAPES[0])
    np.testing.assert_allclose(mode.unit_shape * np.sign(mode.unit_shape[0]), expected, atol=1e-5)


def test_a_node_that_a_mode_lacks_was_not_measured(tmp_path):
    short = normal_mode(2, 2.76, SHAPES[1][:2]) | {"node_nums": NODES[:2]}
    short |= {"r2": np.zeros(2), "r3": np.zeros(2)}
    path = write(tmp_path / "modes.uff", [normal_mode(1, 0.96, SHAPES[0]), short])
    data = bs.read_modal_data(path, band_hz=(0, 6))
    assert np.isnan(data.unit_shapes).tolist() == [[False, False], [False, False], [False, True]]


def test_errors_of_a_universal_file_are_explained(tmp_path):
    path = write(tmp_path / "modes.uff", [normal_mode(1, 0.96, SHAPES[0])])
    with pytest.raises(FileNotFoundError):
        bs.read_modal_data(tmp_path / "none.uff", band_hz=(0, 6))
    damaged = tmp_path / "damaged.uff"
    damaged.write_text(path.read_text()[:700])
    assert_refused(r"damaged\.uff", bs.read_modal_data, damaged, band_hz=(0, 6))
