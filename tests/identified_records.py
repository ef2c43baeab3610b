"""Records of identifications for tests of what comes after them."""

from bayes_ssi.measurements.modes.identification_summary import (
    EstimatedMode,
    IdentificationSummary,
    MeasuredRecord,
    Peak,
)


def identified(source, **others):
    """A sound identification of one mode, at 1 Hz, from ten minutes at two sensors."""
    given = {
        "record": MeasuredRecord(source, ("x", "y"), 600.0, 50.0, "acceleration", "m/s2"),
        "band_hz": (0.0, 4.0), "method": "Bayesian FFT", "loads": "independent loads",
        "whiteness": 1.02, "allowed_whiteness": 1.25, "cycles_of_decay": 6.0,
        "modes": (EstimatedMode(1.0, 0.002, 0.02, 0.003, 0.004),),
        "peaks": (Peak((1.0,), (0,), 0.0001, None, 0.05, 1.25),), "not_identified": (),
        "remarks": (), "doubts": (),
    }  # fmt: skip
    return IdentificationSummary(**{**given, **others})
