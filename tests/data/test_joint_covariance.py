"""Joint covariances of identified modes, and their record of identification beside the CSV file."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import assert_refused
from identified_records import identified

import bayes_ssi as bs
from bayes_ssi.measurements.modes.identification_summary import EstimatedMode

SENSORS = ("x", "y", "z")


def covariance(m=2, n=3, seed=0):
    factor = 0.005 * np.random.default_rng(seed).standard_normal((m + m * n, m + m * n))
    return factor @ factor.T


def modes():
    first = bs.IdentifiedMode("1", 1.0, [0.6, 0.8, 0.0])
    return first, bs.IdentifiedMode("2", 2.5, [0.8, -0.6, np.nan])


def data(**changes):
    fields = {"modes": modes(), "band_hz": (0.0, 4.0), "sensors": SENSORS}
    return bs.ModalData(**(fields | {"covariance": covariance()} | changes))


def test_sizes_of_errors_come_from_the_covariance():
    matrix = covariance()
    joint = data()
    first = matrix[2:5, 2:5]
    along = np.array([0.6, 0.8, 0.0])
    trace = np.trace(first) - along @ first @ along
    assert joint.modes[0].frequency_cov == pytest.approx(np.sqrt(matrix[0, 0]))
    assert joint.modes[0].shape_sd == pytest.approx(np.sqrt(trace / 2.0))
    # Of two components, one direction is left; what was not measured has no error.
    across = np.array([0.6, 0.8])
    assert joint.modes[1].shape_sd == pytest.approx(np.sqrt(across @ matrix[5:7, 5:7] @ across))
    assert not joint.covariance[7].any()
    assert not joint.covariance.flags.writeable


def test_modes_are_sorted_with_their_covariance():
    order = [1, 0, 5, 6, 7, 2, 3, 4]
    turned = data(modes=modes()[::-1], covariance=covariance()[np.ix_(order, order)])
    assert turned.labels == ("1", "2")
    np.testing.assert_allclose(turned.covariance, data().covariance, atol=1e-20)


def test_frequencies_alone_keep_their_covariance_and_without_it_the_sizes_remain():
    np.testing.assert_array_equal(data().without_shapes().covariance, data().covariance[:2, :2])
    alone = data().without_covariance()
    assert alone.covariance is None
    assert [m.shape_sd for m in alone.modes] == [m.shape_sd for m in data().modes]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"covariance": np.eye(7)}, "must be (8, 8) for 2 modes at 3 sensors, got (7, 7)"),
        ({"covariance": np.full((8, 8), np.nan)}, "entries that are not finite"),
        ({"covariance": np.triu(covariance())}, "is not symmetric"),
        ({"covariance": -np.eye(8)}, "not positive semi-definite: an eigenvalue is -1"),
        ({"covariance": np.diag([0.0, *np.ones(7)])}, "mode '1' has no variance of its frequency"),
        ({"covariance": np.diag([1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0])},
         "mode '1' has no variance of its shape"),
        ({"modes": (replace(modes()[0], frequency_cov=0.5), modes()[1])},
         "mode '1': frequency_cov is 0.5, but the covariance gives 0.0"),
    ],
)  # fmt: skip
def test_impossible_covariances_are_refused(changes, message):
    assert_refused(re.escape(message), data, **changes)


@pytest.fixture
def csv(tmp_path):
    path = tmp_path / "modes.csv"
    bs.write_modal_data(data(), path)
    return path


def test_a_file_keeps_the_covariance_that_it_names(csv):
    assert "# identification,modes.identification.json" in csv.read_text()
    np.testing.assert_array_equal(bs.read_modal_data(csv).covariance, data().covariance)
    csv.write_text(csv.read_text().replace("# identification,modes.identification.json\n", ""))
    assert bs.read_modal_data(csv).covariance is None


def test_modes_may_be_renamed_and_left_out(csv):
    lines = csv.read_text().splitlines()
    kept = [line.replace("2,2.5", "bending,2.501") for line in lines if not line.startswith("1,")]
    csv.write_text("\n".join(kept))
    read = bs.read_modal_data(csv)
    assert read.labels == ("bending",)
    rows = [1, 5, 6, 7]
    np.testing.assert_allclose(read.covariance, data().covariance[np.ix_(rows, rows)], rtol=1e-12)


def _change(path, **changes):
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda csv, _: csv.write_text(csv.read_text().replace("2,2.5", "2,2.6")),
         "mode '2' differs in frequency or shape by more than its standard deviation"),
        (lambda csv, _: csv.write_text(csv.read_text().replace("0.6,0.8,", "-0.6,-0.8,")),
         "mode '1' differs in frequency or shape"),
        (lambda csv, _: csv.write_text(csv.read_text().replace("x,y,z", "y,x,z")),
         "the sensors, 'x', 'y', 'z', are not those of the CSV file; names and order must"),
        (lambda _, file: file.unlink(), "no file modes.identification.json"),
        (lambda _, file: file.write_text("{"), "no record of the identification"),
        (lambda _, file: file.write_text("{}"), "sensors: missing"),
        (lambda _, file: file.write_text("[]"), "expected a record"),
        (lambda _, file: _change(file, frequencies_hz=[1.0]), "1 modes at 3 sensors"),
        (lambda _, file: _change(file, frequencies_hz=["one", 2.5]), "expected a number"),
    ],
)  # fmt: skip
def test_a_covariance_of_other_modes_is_refused(csv, change, message):
    change(csv, csv.with_suffix(".identification.json"))
    assert_refused(message, bs.read_modal_data, csv)


def test_no_file_is_overwritten(csv):
    csv.unlink()
    with pytest.raises(FileExistsError, match=r"modes\.identification\.json exists"):
        bs.write_modal_data(data(), csv)
    assert not csv.exists()


RECORD = identified(
    "a.csv", method="NExT-ERA", cycles_of_decay=0.7,
    modes=(EstimatedMode(1.0, 0.002, None, None, None),), remarks=("sensor 'x': clipped",),
    doubts=("the methods differ",), figures=("figures/shapes.png",),
    not_identified=((3.2, "its shape is not determined"),),
)  # fmt: skip


def one_mode(record=RECORD, frequency=1.0):
    mode = bs.IdentifiedMode("1", frequency, [0.6, 0.8], frequency_cov=0.002, shape_sd=0.01)
    return bs.ModalData((mode,), (0.0, 4.0), ("x", "y"), identifications=(record,))


@pytest.fixture
def file_of_doubts(tmp_path):
    path = tmp_path / "modes.csv"
    figure = str(tmp_path / "figures" / "shapes.png")
    bs.write_modal_data(one_mode(replace(RECORD, figures=(figure,))), path)
    return path


def test_a_file_names_how_its_modes_were_identified_and_keeps_it(file_of_doubts, tmp_path):
    """Also where the directory has moved: paths of figures are relative to it."""
    assert "# identification,modes.identification.json" in file_of_doubts.read_text()
    moved = file_of_doubts.parent.rename(tmp_path.parent / f"{tmp_path.name}_moved")
    (read,) = bs.read_modal_data(moved / "modes.csv").identifications
    assert read == replace(RECORD, figures=(str(moved / "figures" / "shapes.png"),))


def test_failed_checks_are_heard_with_the_modes_that_are_not_identified(file_of_doubts):
    assert bs.read_modal_data(file_of_doubts).all_failed_checks == (
        "identified from a.csv: the methods differ",
        "identified from a.csv: the record shows a mode at 3.2 Hz that is not identified (its "
        "shape is not determined): a model class that has it counts as missing it, and its "
        "probability is too low",
    )
    assert bs.read_modal_data(file_of_doubts).warnings()[:2] == list(
        bs.read_modal_data(file_of_doubts).all_failed_checks
    )


def test_merged_modes_keep_every_identification():
    second = replace(RECORD, record=replace(RECORD.record, source="b.csv"))
    merged = bs.merge_modal_data({"a": one_mode(), "b": one_mode(second, 1.001)})
    assert merged.data.identifications == (RECORD, second)


def test_a_file_of_an_earlier_version_is_named(file_of_doubts):
    file_of_doubts.with_suffix(".identification.json").write_text(
        json.dumps({"identifications": [{}]})
    )
    with pytest.raises(ValueError, match=r"modes.identification.json: .* sensors: missing"):
        bs.read_modal_data(file_of_doubts)
    file_of_doubts.write_text("# covariance, modes.covariance.json\n" + file_of_doubts.read_text())
    with pytest.raises(ValueError, match="line 1: of an earlier version; identify again"):
        bs.read_modal_data(file_of_doubts)
