"""Problems with known answers, and simulators, are beside the tests that use them, too."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "tests" / "benchmarks"))
