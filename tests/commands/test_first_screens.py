"""What commands print, word for word: one text for each; other tests are of what they do.

Those of ``rank`` and ``search`` are in the README and in the guide's chapters.
"""

from pathlib import Path

import pytest
from code_blocks import ROOT

SCREENS = Path(__file__).with_name("first_screens")
STUDY = ROOT / "model_classes" / "shear_building.py"
COMMANDS = {
    "new": ("new", "tower"),
    "check": ("check", STUDY.with_name("data") / "case_c.csv"),
    "calibrate": ("calibrate", STUDY, "--class", "3", "--starts", 4),
    "sensitivities": ("sensitivities", STUDY, "--class", "3"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_the_first_screen(run, monkeypatch, name):
    monkeypatch.delenv("COLUMNS", raising=False)
    done = run(*COMMANDS[name])
    assert (done.exit_code, done.stderr) == (0, "")
    printed = "".join(f"{line.rstrip()}\n" for line in done.stdout.splitlines())
    assert printed == (SCREENS / f"{name}.txt").read_text("utf-8")
