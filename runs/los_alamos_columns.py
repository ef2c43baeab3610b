"""The frame of Los Alamos with thinner columns, as if nothing were known of them: what changed?

    bayes-ssi changes runs/los_alamos_columns.py --from "state 1" --to "state 7" --losses-only

Measured states of model_classes/los_alamos_frame.py, of which only the columns differ, on the model
of the intact frame with a factor for each storey.
"""

import runpy
from pathlib import Path

import bayes_ssi as bs

FRAME = Path(__file__).parent.parent / "model_classes" / "los_alamos_frame.py"
known = runpy.run_path(str(FRAME))
intact = known["frame"]("1", known["each"])
states = [state for state, (_, block, _) in known["STATES"].items() if block is None]
tests = [
    bs.Configuration(f"state {state}", intact, known["modes"](state), pairing=known["PAIRING"])
    for state in states
]
frame = bs.ModelClass("frame", configurations=tests, error=bs.ErrorModel())
study = bs.Study("Columns of the frame of Los Alamos", [frame])
