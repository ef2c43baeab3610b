"""Rank the paper's four approaches by evidence and draw the result.

    python runs/rank_shear_building.py [DIRECTORY]

The result goes to a new DIRECTORY, by default runs/results/rank_shear_building.
"""

import sys
from pathlib import Path

from rich.console import Console

import bayes_ssi as bs
from bayes_ssi.plots.result_figures import save_figures
from bayes_ssi.report.tables import ranking_table
from bayes_ssi.results.answer import answer
from bayes_ssi.results.save import require_new, save_result
from bayes_ssi.studies.ranking.study_file import load_study

HERE = Path(__file__).parent
STUDY = HERE.parent / "model_classes" / "shear_building.py"


def main() -> None:
    default = HERE / "results" / "rank_shear_building"
    directory = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    require_new(directory)
    study = load_study(STUDY)
    ranking = bs.rank(study)
    result = save_result(ranking, directory, study_file=STUDY.name)
    save_figures(directory / "figures", result.tests, result.ranked_posteriors, result.comparison)
    console = Console(width=80)
    console.print(ranking_table(result.comparison, study.name))
    console.print(f"Saved in {directory}.")
    for paragraph in answer(result).paragraphs:
        console.print(f"\n{paragraph}", markup=False, highlight=False)


if __name__ == "__main__":
    main()
