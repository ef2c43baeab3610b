"""Result directories: written at once or not at all, and read back without sampling."""

from bayes_ssi.results.load import StoredResult, load_result
from bayes_ssi.results.save import save_result

__all__ = ["StoredResult", "load_result", "save_result"]
