"""Records of identifications for tests of what comes after them."""

from bayes_ssi.measurements.modes.identification_summary import (
    EstimatedMode,
    EstimatedPeak,
    IdentificationSummary,
    MeasuredRecord,
)


def identified(source, **others):
    """A sound identification of one mode, at 1 Hz, from ten minutes at two sensors."""
    given = {
        "record": MeasuredRecord(source, ("x", "y"), 600.0, 50.0, "acceleration", "m/s2"),
        "band_hz": (0.0, 4.0),
        "method": "Bayesian FFT",
        "loads": "independent loads",
        "is_explained": True,
        "whiteness": 1.02,
        "allowed_whiteness": 1.25,
        "cycles_of_decay": 6.0,
        "modes": (EstimatedMode(1.0, 0.002, 0.02, 0.003, 0.004),),
        "peaks": (EstimatedPeak((0,), 0.0001, 0.05),),
        "remarks": (),
        "failed_checks": (),
    }
    return IdentificationSummary(**{**given, **others})
