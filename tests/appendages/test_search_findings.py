"""What a search finds, sampled coarsely."""

import numpy as np
import pytest
from searches import COARSE, INFILL_12, exact_modes

import bayes_ssi as bs
from bayes_ssi.studies.appendages.candidates import SearchSettings
from bayes_ssi.studies.questions import search


def test_the_hidden_infill_is_found_where_it_is_with_its_mass_and_frequency(found_in_case_c):
    record = found_in_case_c.record
    assert found_in_case_c.ranking.comparison.best.name == "infill 1-2"
    assert record.place("infill 1-2").probability > 0.99
    assert record.probability_of_any > 0.99
    (infill,) = record.hypothesis("infill 1-2").features
    low, middle, high = infill.amounts["mass"]
    assert low < 0.075 < high
    assert middle == pytest.approx(0.075, abs=0.01)
    # How much of its mass leaves the floors is not known, which widens the interval.
    low, middle, high = infill.amounts["frequency_hz"]
    assert low < 2.8019 < high
    assert middle == pytest.approx(2.8019, abs=(high - low) / 3.29)  # a standard deviation
    (modes,) = found_in_case_c.ranking.posterior("infill 1-2").configurations
    assert list(modes.pairing.values()) == [1, 2, 3, 4]


@pytest.mark.usefixtures("quick_screening")
def test_no_appendage_is_detected_on_a_bare_frame(frame, fixed_error):
    data = exact_modes(frame, frame.degrees_of_freedom, (0.0, 6.0))
    np.testing.assert_allclose(data.frequencies_hz, [1.0, 2.80193774, 4.04891734], atol=1e-8)
    baseline = bs.ModelClass("bare", frame, data, fixed_error, pairing={})
    one = SearchSettings(number_weights=(1.0, 1.0))
    result = search(baseline, one, settings=COARSE)
    assert result.ranking.comparison.best.name == "no appendage"
    assert result.record.probability_of_any < 0.2


@pytest.mark.usefixtures("quick_screening", "no_motions")
def test_workers_do_not_change_a_bit(tiny_study, monkeypatch, copied_workers):
    """Of two hypotheses that are screened, and the one that is sampled."""
    monkeypatch.setattr("bayes_ssi.studies.appendages.baselines.places_of", lambda _: (INFILL_12,))
    one = SearchSettings(number_weights=(1.0, 1.0), most_sampled=1)
    here, there = (
        search(tiny_study.model_classes[0], one, 3, COARSE, bs.Run(workers))
        for workers in (None, copied_workers)
    )
    assert here.record == there.record
    assert len(here.record.hypotheses) == 2
    for own, other in zip(here.ranking.posteriors, there.ranking.posteriors, strict=True):
        assert own.evidence == other.evidence
        assert own.draws.tobytes() == other.draws.tobytes()
        assert own.configurations == other.configurations
