"""How modes were identified: kept with their CSV file, read back, and merged."""

import json
from dataclasses import replace

import pytest
from identified_records import identified

import bayes_ssi as bs
from bayes_ssi.measurements.modes.identification_summary import EstimatedMode

RECORD = identified(
    "a.csv", method="NExT-ERA", cycles_of_decay=0.7,
    modes=(EstimatedMode(1.0, 0.002, None, None, None),), remarks=("sensor 'x': clipped",),
    doubts=("the methods differ",), figures=("figures/shapes.png",),
    not_identified=((3.2, "its shape is not determined"),),
)  # fmt: skip


def data(record=RECORD, frequency=1.0):
    mode = bs.IdentifiedMode("1", frequency, [0.6, 0.8], frequency_cov=0.002, shape_sd=0.01)
    return bs.ModalData((mode,), (0.0, 4.0), ("x", "y"), identifications=(record,))


@pytest.fixture
def csv(tmp_path):
    path = tmp_path / "modes.csv"
    figure = str(tmp_path / "figures" / "shapes.png")
    bs.write_modal_data(data(replace(RECORD, figures=(figure,))), path)
    return path


def test_a_file_names_how_its_modes_were_identified_and_keeps_it(csv, tmp_path):
    """Also where the directory has moved: paths of figures are relative to it."""
    assert "# identification,modes.identification.json" in csv.read_text()
    moved = csv.parent.rename(tmp_path.parent / f"{tmp_path.name}_moved")
    (read,) = bs.read_modal_data(moved / "modes.csv").identifications
    assert read == replace(RECORD, figures=(str(moved / "figures" / "shapes.png"),))


def test_failed_checks_are_heard_with_the_modes_that_are_not_identified(csv):
    assert bs.read_modal_data(csv).all_failed_checks == (
        "identified from a.csv: the methods differ",
        "identified from a.csv: the record shows a mode at 3.2 Hz that is not identified (its "
        "shape is not determined): a model class that has it counts as missing it, and its "
        "probability is too low",
    )
    assert bs.read_modal_data(csv).warnings()[:2] == list(bs.read_modal_data(csv).all_failed_checks)


def test_merged_modes_keep_every_identification():
    second = replace(RECORD, record=replace(RECORD.record, source="b.csv"))
    merged = bs.merge_modal_data({"a": data(), "b": data(second, 1.001)})
    assert merged.data.identifications == (RECORD, second)


def test_a_file_of_an_earlier_version_is_named(csv):
    csv.with_suffix(".identification.json").write_text(json.dumps({"identifications": [{}]}))
    with pytest.raises(ValueError, match=r"modes.identification.json: .* sensors: missing"):
        bs.read_modal_data(csv)
    csv.write_text("# covariance, modes.covariance.json\n" + csv.read_text())
    with pytest.raises(ValueError, match="line 1: of an earlier version; identify again"):
        bs.read_modal_data(csv)
