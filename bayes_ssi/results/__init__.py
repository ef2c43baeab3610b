"""Results on disk: written once and whole, and read back without sampling again."""

from bayes_ssi.results.result_directory import StoredResult, load_result
from bayes_ssi.results.saving import save_result

__all__ = ["StoredResult", "load_result", "save_result"]
