"""Predictions from posterior draws, with the bands that these give; nothing is sampled."""

from bayes_ssi.predictions.bands import Band, Prediction
from bayes_ssi.predictions.predictions import Predictions, predict_average, predict_class
from bayes_ssi.predictions.stored_predictions import load_predictions

__all__ = [
    "Band",
    "Prediction",
    "Predictions",
    "load_predictions",
    "predict_average",
    "predict_class",
]
