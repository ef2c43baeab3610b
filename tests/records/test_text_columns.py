"""Columns are read as loggers and spreadsheets write them: never a clock as a sensor, never a gap
as motion, never a unit left aside."""

import re
from zipfile import ZipFile

import numpy as np
import pytest
from conftest import assert_refused

import bayes_ssi as bs
from bayes_ssi.measurements.records.record_files import is_record

RATE, NAMES = 20.0, ("K1", "K2", "K3")
SAMPLES = np.random.default_rng(1).standard_normal((3, 60)).round(5)
TIMES = [f"{k / RATE:.2f}" for k in range(60)]


def rows(first=TIMES, separator=",", samples=SAMPLES, last=""):
    cells = [[f"{x:.5f}" for x in row] for row in samples.T]
    first = first or [None] * len(cells)
    return [
        separator.join([*([time] if time is not None else []), *row]) + last
        for time, row in zip(first, cells, strict=True)
    ]


def german(lines):
    return [line.replace(".", ",") for line in lines]


def dates(form, first="2024-05-12T10:00:00"):
    from datetime import datetime, timedelta

    stamps = (datetime.fromisoformat(first) + timedelta(seconds=k / RATE) for k in range(60))
    return [stamp.strftime(form) for stamp in stamps]


MS = [str(50 * k) for k in range(60)]
FORMATS = {
    "units row": ["Time,K1,K2,K3", "s,mg,mg,mg", *rows()],
    "units in names": ["t (s),K1 [mg],K2 [mg],K3 [mg]", *rows()],
    "trailing": ["Time (s),K1,K2,K3", *rows(last=",")],
    "empty rows at the end": ["Time (s),K1,K2,K3", *rows(), ",,,", ",,,"],
    "empty rows of tabs": ["Time (s)\tK1\tK2\tK3", *rows(separator="\t"), "\t\t\t"],
    "trailing names": ["Time (s);K1;K2;K3;", *german(rows(separator=";", last=";"))],
    "german dates": [
        "Datum;K1;K2;K3",
        *(t + row for t, row in zip(dates("%d.%m.%Y %H:%M:%S,%f"),
                                    german(rows([""] * 60, ";")), strict=True)),
    ],
    "us dates": ["Timestamp,K1,K2,K3", *rows(dates("%m/%d/%Y %I:%M:%S.%f %p"))],
    "over midnight": ["Date,K1,K2,K3", *rows(dates("%d/%m/%Y %H:%M:%S.%f", "2024-05-11T23:59:59"))],
    "date and time": ["Date,Time,K1,K2,K3", *rows(dates("%d.%m.%y,%H:%M:%S.%f"))],
    "time of day": ["Uhrzeit\tK1\tK2\tK3",
                    *rows(dates("%H:%M:%S.%f", "2024-05-11T23:59:59"), "\t")],
    "iso with spaces": ["time K1 K2 K3", *rows(dates("%Y-%m-%d %H:%M:%S.%f"), " ")],
    "iso": ["time K1 K2 K3", *rows(dates("%Y-%m-%dT%H:%M:%S.%f"), " ")],
    "summer time ends": ["time K1 K2 K3", *rows(
        [f"2024-10-27T02:59:{59 + k / 20:.2f}+02:00" for k in range(20)]
        + [f"2024-10-27T02:00:{k / 20:05.2f}+01:00" for k in range(40)], " ")],
    "ms": ["Time [ms],K1,K2,K3", *rows(MS)],
    "us": ["t_us,K1,K2,K3", *rows([f"{m}000" for m in MS])],
    "epoch": ["timestamp_ms,K1,K2,K3", *rows([str(1715500000000 + 50 * k) for k in range(60)])],
    "epoch without unit": [
        "unixtime,K1,K2,K3", *rows([str(1715500000000000000 + 50000000 * k) for k in range(60)])
    ],
    "count and time": ["Sample,t,K1,K2,K3", *(f"{k},{row}" for k, row in enumerate(rows(), 1))],
    "table of R": [
        '"t" "K1" "K2" "K3"', *(f'"{k}" {row}' for k, row in enumerate(rows(separator=" "), 1)),
    ],
    "labview": [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab", "***End_of_Header***\t",
        "\t", "Channels\t3\t\t\t", "Samples\t60\t60\t60", "Delta_X\t0.05\t0.05\t0.05",
        "X_Value\tK1\tK2\tK3\tComment", *rows(separator="\t"),
    ],
    "text above": ["Test of tower", "Operator: x", "", "Sampling rate: 20 Hz", "", "K1\tK2\tK3",
                   *rows(None, "\t")],
    "excel": ["sep=;", "t;K1;K2;K3", *german(rows(separator=";"))],
    "decimal commas between spaces": ["t K1 K2 K3", *german(rows(separator=" "))],
    "quoted decimal commas": [
        "t,K1,K2,K3", *('"' + '","'.join(german(row.split(","))) + '"' for row in rows())
    ],
}  # fmt: skip


def written(folder, *lines, encoding="utf-8"):
    """The path of a file of these lines."""
    path = folder / "a.csv"
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_is_read_as_it_is_meant(tmp_path, name):
    path = written(tmp_path, *FORMATS[name])
    one = bs.read_record(path, unit=None if "mg" in "".join(FORMATS[name][:2]) else "mg")
    assert one.sensors == NAMES
    assert one.rate_hz == pytest.approx(RATE, rel=1e-6)
    assert (one.quantity, one.unit) == ("acceleration", "mg")
    np.testing.assert_allclose(one.samples, SAMPLES, rtol=1e-15)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_encodings(tmp_path, encoding):
    path = written(tmp_path, "t;Höhe;K2;K3", *rows(separator=";"), encoding=encoding)
    assert bs.read_record(path, unit="g").sensors == ("Höhe", "K2", "K3")


@pytest.mark.parametrize("first", [("Sample", 1), ("", 0), ("Ticks", 5)])
def test_a_count_is_no_sensor_and_needs_the_rate(tmp_path, first):
    name, begin = first
    counts = [str(begin + k) for k in range(60) if k not in (30, 31)]
    kept = np.delete(SAMPLES, [30, 31], axis=1)
    path = written(tmp_path, f"{name},K1,K2,K3", *rows(counts, samples=kept))
    with pytest.raises(ValueError, match=r"rate_hz, .* is not given; give it in Hz \(--rate\)"):
        bs.read_record(path, unit="g")
    one = bs.read_record(path, unit="g", rate_hz=20.0)
    assert (one.sensors, one.n_samples, one.gaps) == (NAMES, 60, ((30, 32),))
    np.testing.assert_array_equal(np.delete(one.samples, [30, 31], axis=1), kept)


@pytest.mark.parametrize("first", [dates("%Y-%m-%d %H:%M:%S.%f"), range(1715500000, 1715500003)])
def test_times_since_an_epoch_may_stand_beside_those_since_the_beginning(tmp_path, first):
    """Which begin at the first step, not at none."""
    step = 1.0 if isinstance(first, range) else 1.0 / RATE
    rows_of_times = [f"{a},{step * k:.2f},{k * k}" for k, a in enumerate(first, 1)]
    record = bs.read_record(written(tmp_path, "Time (s),Elapsed (s),K1 (g)", *rows_of_times))
    assert record.rate_hz == pytest.approx(1.0 / step)


def test_a_rate_tells_the_unit_of_times(tmp_path):
    path = written(tmp_path, "time,K1,K2,K3", *rows(MS))
    with pytest.raises(ValueError, match=r"'time' advances by 50: .* as in 'time \(ms\)', or give"):
        bs.read_record(path, unit="g")
    assert bs.read_record(path, unit="g", rate_hz=20.0).rate_hz == pytest.approx(20.0)
    assert_refused("'time' advances by 50", bs.read_record, path, unit="g", rate_hz=25.0)


def test_gaps_of_blanks_and_of_times_are_said(tmp_path):
    lines = ["t,K1,K2,K3", *rows()]
    for k in range(20, 24):
        cells = lines[1 + k].split(",")
        lines[1 + k] = ",".join([*cells[:2], "" if k < 22 else "NaN", cells[3]])
    one = bs.read_record(written(tmp_path, *lines[:41], *lines[51:]), unit="g")
    assert one.gaps == ((20, 24), (40, 50))
    assert one.warnings()[0] == (
        "missing: 4 samples from 1 to 1.2 s, 10 samples from 2 to 2.5 s; the pieces are used "
        "together"
    )
    # On a straight line from 19 to 24, and the rest as it was.
    expected = SAMPLES[1, 19] + (SAMPLES[1, 24] - SAMPLES[1, 19]) * np.arange(1, 5) / 5
    np.testing.assert_allclose(one.samples[1, 20:24], expected)
    np.testing.assert_array_equal(one.samples[:, one.is_measured], SAMPLES[:, one.is_measured])
    piece = one.longest_piece()
    assert (piece.gaps, piece.n_samples) == ((), 20)
    np.testing.assert_array_equal(piece.samples, SAMPLES[:, :20])


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["t,K1,K2,K3", *rows(TIMES[:30] + TIMES[20:50])], "'t': instants must advance by equal"),
        (
            ["t;a;b", "0,1;1,5;2", "0,2;2;2.5", "0,3;2;3"],
            "line 3, column 3: '2.5' is not a number with ',' for decimals",
        ),
        (["t;a", "0,1;1,5", "0,2;x", "0,3;2"], "line 3, column 2: 'x' is not a number with"),
        (["t,a", '"0,1","1,5"', '"0,2","1,5', *['"0,3","1,5"'] * 3], "do quotation marks match"),
        (["K1 (g),T (°C)", "1,2", "2,2", "3,1"], "column 'T .°C.' in '°C' beside others in 'g'"),
        (
            ["# dt_s, 1", "K1 (g),K2 (mg)", "1,2", "2,2", "3,1"],
            "two of unit are given: 'g' and 'mg'",
        ),
        (["Time (fortnights),K1", "1,2", "2,2"], "'fortnights' is no unit of time; choose from s"),
        (["t,K1", "0.1,2", "0.2", "0.3,1"], "line 3: 1 cell, where the rows above have 2"),
        (["t,K1,K2", "0.1,2,", "0.2,3,", "0.3,1,"], "column 'K2' is empty; remove it"),
        (["t1 (s),a,t2 (s),b", "0,2,0.3,1", "0.1,3,0.4,2", "0.2,1,0.5,2"], "begin at 0, 0.3 s"),
        (["t,a,b", "0.1,2,1", ",,", "0.2,3,1"], "column 't': an instant is missing in a row"),
        (["<html><body>", "1,2"], "a web page or XML, not a table"),
        (["0,1,2", "0.1,1,2", "9.1,1,2", "9.2,1,3"], "89 instants are missing beside 4; divide"),
        (["Titel: 12", "none"], "no rows of numbers"),
        (["12/31/2024 x"] * 3, "no rows of numbers"),
        (["t,a", "31/31/2024 10:00:00,1", "31/31/2024 10:00:01,2"], "are not understood; write"),
        (["t,a", "31.12.2024 10:00:00,1", "31.12.2024 10:00:00,2"], "the step is 0, most are 0"),
    ],
)
def test_what_cannot_be_read_is_one_line_with_the_cure(tmp_path, lines, words):
    assert_refused(words, bs.read_record, written(tmp_path, *lines), sensors=None)


def test_a_workbook(tmp_path):
    book = pytest.importorskip("openpyxl", reason="pip install bayes_ssi[xlsx]").Workbook()
    book.active.append(["Notes"])
    sheet = book.create_sheet("data")
    from datetime import datetime, timedelta

    sheet.append(["Date", "K1 (mg)", "K2 (mg)", "K3 (mg)"])
    for k, row in enumerate(SAMPLES.T.tolist()):
        sheet.append([datetime(2024, 5, 12) + timedelta(seconds=k / RATE), *row])
    sheet["C31"] = None
    book.save(tmp_path / "full.xlsx")
    # Other programs leave out styles that have names.
    with ZipFile(tmp_path / "full.xlsx") as full, ZipFile(tmp_path / "a.xlsx", "w") as bare:
        for name in full.namelist():
            bare.writestr(name, re.sub(rb"<cellStyles.*</cellStyles>", b"", full.read(name)))
    one = bs.read_record(tmp_path / "a.xlsx", keys=["data"])
    assert (one.sensors, one.unit, one.gaps) == (NAMES, "mg", ((29, 30),))
    assert one.rate_hz == pytest.approx(RATE)
    with pytest.raises(ValueError, match="no sheet 'other'; choose from 'Sheet', 'data'"):
        bs.read_record(tmp_path / "a.xlsx", keys=["other"])
    with pytest.raises(ValueError, match=r"name the sheet \(--key\): one of 'Sheet', 'data'"):
        bs.read_record(tmp_path / "a.xlsx")


def test_a_sensor_that_rises_steadily_is_one(tmp_path):
    samples = np.vstack([SAMPLES[:2], np.arange(60) / 8.0])
    one = bs.read_record(written(tmp_path, "t,K1,K2,K3", *rows(samples=samples)), unit="g")
    np.testing.assert_array_equal(one.samples, samples)


def test_texts_of_bytes(tmp_path):
    path = tmp_path / "a.npz"
    unit, names = np.bytes_("mg"), np.array(NAMES, "S2")
    np.savez(path, a=SAMPLES, rate_hz=RATE, unit=unit, sensors=names)
    one = bs.read_record(path)
    assert (one.sensors, one.unit, one.rate_hz) == (NAMES, "mg", RATE)


@pytest.mark.parametrize("turned", [False, True])
def test_a_first_column_of_an_array_that_advances_is_no_sensor(tmp_path, turned):
    from scipy.io import savemat

    path = tmp_path / "a.mat"
    table = np.vstack([np.arange(60) / RATE, SAMPLES])
    savemat(path, {"A": table if turned else table.T})
    one = bs.read_record(path, unit="g", sensors=NAMES)
    assert (one.sensors, one.rate_hz) == (NAMES, pytest.approx(RATE))
    np.testing.assert_array_equal(one.samples, SAMPLES)
    savemat(path, {"A": np.vstack([np.arange(60), SAMPLES]), "fs": RATE, "names": ["n", *NAMES]})
    one = bs.read_record(path, unit="g")
    assert (one.sensors, one.rate_hz) == (NAMES, RATE)
    savemat(path, {"A": np.vstack([table[:1], SAMPLES]), "names": ["t", *NAMES]})
    assert bs.read_record(path, unit="g").sensors == NAMES


def test_fields_of_matlab_structures(tmp_path):
    from scipy.io import savemat

    path = tmp_path / "a.mat"
    first = {"acc": SAMPLES.T, "fs": RATE, "names": np.array(NAMES, dtype=object)}
    second = {"acc": SAMPLES[:2, :50], "t": np.arange(50) / 10.0, "unit": "mg"}
    savemat(path, {"data": first, "other": second})
    assert_refused(r"'data\.acc', 'other\.acc' differ in length", bs.read_record, path, unit="g")
    one = bs.read_record(path, unit="g", keys=["data.acc"])
    assert (one.sensors, one.rate_hz, one.n_samples) == (NAMES, RATE, 60)
    one = bs.read_record(path, sensors=["a", "b"], keys=["other.acc"])
    assert (one.rate_hz, one.unit) == (pytest.approx(10.0), "mg")
    second["t"] = 739000 + np.arange(50) / 86400 / 10  # MATLAB's days
    savemat(path, {"other": second})
    with pytest.raises(ValueError, match="not in s; remove them and give the rate"):
        bs.read_record(path, sensors=["a", "b"])


def test_structures_in_matlab_files_that_are_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("data")
        group["acc"] = SAMPLES  # MATLAB's (60, 3)
        group["fs"] = [[RATE]]
        cells = []
        for i, name in enumerate(NAMES):
            cell = file.create_dataset(f"#refs#/{i}", data=np.array([[ord(c)] for c in name], "u2"))
            cells.append(cell.ref)
        group.create_dataset("names", data=np.array([cells], dtype=h5py.ref_dtype))
        unit = group.create_dataset("unit", data=np.array([[ord("m")], [ord("g")]], "u2"))
        unit.attrs["MATLAB_class"] = np.bytes_("char")
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)
    one = bs.read_record(path)
    assert (one.sensors, one.unit, one.rate_hz) == (NAMES, "mg", RATE)
    np.testing.assert_array_equal(one.samples, SAMPLES)


def test_an_archive_of_miniseed_is_known_by_its_first_bytes(tmp_path):
    path = tmp_path / "XX.ROOF..HNZ.D.2024.133"
    path.write_bytes(b"000001D ROOF   HNZXX\x07\xe8\x00\x85" + bytes(40))
    assert is_record(path)


@pytest.mark.parametrize("form", ["MSEED", "SAC"])
def test_seismic_files(tmp_path, form):
    obspy = pytest.importorskip("obspy", reason="pip install bayes_ssi[seismic]")
    traces = []
    for i, row in enumerate(SAMPLES.astype(np.float32)):
        header = {"station": "T", "channel": f"HN{i}", "sampling_rate": RATE}
        traces.append(obspy.Trace(row, header))
    path = tmp_path / f"a.{form.lower()}"
    if form == "SAC":
        traces[0].write(str(path), format=form)
    else:
        late = obspy.Trace(traces[0].data[40:], traces[0].stats)
        late.stats.starttime += 40 / RATE
        traces[0].data = traces[0].data[:30]
        obspy.Stream([*traces, late]).write(str(path), format=form)
        path = path.rename(tmp_path / "XX.T..HN0.D.2024.133")  # as archives name it
        assert is_record(path)
    one = bs.read_record(path, unit="g")
    assert (one.sensors[0], one.rate_hz) == (".T..HN0", RATE)
    assert one.gaps == (() if form == "SAC" else ((30, 40),))
    np.testing.assert_allclose(one.samples[-1, :30], SAMPLES[len(one.sensors) - 1, :30], rtol=1e-6)
