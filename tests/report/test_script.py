"""The script of a report, run by Node.js on objects that stand for the elements of a page."""

import json
import shutil
import subprocess
from importlib.resources import files

import pytest

PAGE = """
const listen = { addEventListener(kind, act) { this[kind] = act; } };
const scroll = (width) => ({
  scrollWidth: width, clientWidth: 361, classList: { toggle(name, on) { this[name] = on; } },
});
const folds = [true, false].map((first) => ({ ...listen, hasAttribute: () => first, open: true }));
const wide = [361, 362, 571].map(scroll);
const found = { "details.fold": folds, "details": folds, ".scroll": wide };
const document = {
  ...listen, documentElement: { classList: { add() {} } },
  querySelectorAll: (selector) => found[selector] ?? [],
};
const window = { ...listen };
const location = { hash: "" };
"""
REPORTED = """
const open = () => folds.map((each) => each.open);
const states = [open()];
for (const kind of ["beforeprint", "afterprint"]) { handlers[kind](); states.push(open()); }
console.log(JSON.stringify([states, wide.map((each) => each.classList.cut)]));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js")
def test_classes_fold_and_cut_tables_are_marked():
    script = (files("bayes_ssi") / "report/templates/script.js").read_text("utf-8")
    # One window listens to several events.
    handlers = "const handlers = {}; window.addEventListener = (k, act) => { handlers[k] = act; };"
    program = f"{PAGE}{handlers}{script}{REPORTED}"
    done = subprocess.run(
        ["node", "-e", program], capture_output=True, text=True, timeout=60, check=True
    )
    states, cut = json.loads(done.stdout)
    # The best class is open on the screen, and every class on paper.
    assert states == [[True, False], [True, True], [True, False]]
    # A pixel is rounding.
    assert cut == [False, False, True]
