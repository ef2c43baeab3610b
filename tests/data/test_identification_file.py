"""How modes were identified: kept with their CSV file, read back, and merged."""

import json
from dataclasses import replace

import pytest

import bayes_ssi as bs
from bayes_ssi.data.identification_record import (
    EstimatedMode,
    EstimatedPeak,
    IdentificationRecord,
    MeasuredRecord,
)

RECORD = IdentificationRecord(
    record=MeasuredRecord("a.csv", ("x", "y"), 600.0, 50.0, "acceleration", "m/s2"),
    band_hz=(0.0, 4.0),
    method="NExT-ERA",
    loads="ground motion in one direction",
    is_explained=False,
    whiteness=3.2,
    allowed_whiteness=1.3,
    cycles_of_decay=0.7,
    modes=(EstimatedMode(1.0, 0.002, None, None, None, 2.5),),
    peaks=(EstimatedPeak((0,), 0.25, 0.04),),
    rejected=((2.5, "the spectra gain nothing by a mode there"),),
    remarks=("sensor 'x': clipped",),
    failed_checks=("the methods differ",),
    figures=("figures/shapes.png",),
)


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


def test_merged_modes_keep_every_identification():
    second = replace(RECORD, record=replace(RECORD.record, source="b.csv"))
    merged = bs.merge_modal_data({"a": data(), "b": data(second, 1.001)})
    assert merged.data.identifications == (RECORD, second)


def test_without_its_line_nothing_is_known_of_the_identification(csv):
    csv.write_text(csv.read_text().replace("# identification,modes.identification.json\n", ""))
    assert bs.read_modal_data(csv).identifications == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda path: path.unlink(), "no file modes.identification.json, which its line"),
        (lambda path: path.write_text("{"), "modes.identification.json: no record of an"),
        (
            lambda path: path.write_text(json.dumps({"identifications": [{}]})),
            r"modes.identification.json: .* identifications\[0\].record: missing",
        ),
    ],
)
def test_a_damaged_file_is_named(csv, change, message):
    change(csv.with_suffix(".identification.json"))
    with pytest.raises(ValueError, match=message):
        bs.read_modal_data(csv)
