"""The response of a structure to a force or a ground motion, by modal superposition."""

from bayes_ssi.response.ground_motion import GroundMotion
from bayes_ssi.response.modal_response import (
    peak_responses,
    time_histories,
    transfer_functions,
)
from bayes_ssi.response.output import Output

__all__ = ["GroundMotion", "Output", "peak_responses", "time_histories", "transfer_functions"]
