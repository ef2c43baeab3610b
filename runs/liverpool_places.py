"""On which floors of model_classes/liverpool_frame.py does the blade hang, as its modes see it?

Ranks the study's class "x and y" with the blade's two pendulums on every pair of floors, every mode
paired in its order: more than a search, which infers the pairing, can know. Then once more with
errors of the model that both tests share.
"""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import bayes_ssi as bs

STUDY = Path(__file__).parent.parent / "model_classes" / "liverpool_frame.py"
SETTINGS = bs.SamplingSettings(log_evidence_error=0.05)
SHARED = 0.9


def main() -> None:
    defined = runpy.run_path(str(STUDY))
    for between_tests in (0.0, SHARED):
        classes = []
        for in_x, in_y in ((i, j) for i in (1, 2, 3) for j in (1, 2, 3)):
            loaded = defined["loaded"]
            for blade, place in (("blade_x", f"floor {in_x} x"), ("blade_y", f"floor {in_y} y")):
                loaded = loaded.with_element(replace(defined[blade], on=place))
            made = defined["model_class"](f"x on {in_x}, y on {in_y}", loaded, (), "")
            classes.append(replace(made, error=replace(made.error, between_tests=between_tests)))
        print(f"correlation of the model's errors in both tests {between_tests}", flush=True)
        study = bs.Study("places of the blade", classes)
        for row in bs.rank(study, settings=SETTINGS).comparison.classes:
            print(f"  {row.name}: {row.log_evidence:.2f} ± {row.error:.2f}", flush=True)


if __name__ == "__main__":
    main()
