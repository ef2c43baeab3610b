"""The script of a report, run by Node.js on objects that stand for the elements of a page."""

import json
import shutil
import subprocess
from importlib.resources import files

import pytest

PAGE = """
const listen = { addEventListener(kind, act) { this[kind] = act; } };
const cell = ([text, value]) => ({ textContent: text, getAttribute: () => value });
const head = () => ({
  given: {}, firstChild: null,
  appendChild(button) { this.button = button; },
  getAttribute(name) { return this.given[name] ?? null; },
  setAttribute(name, value) { this.given[name] = value; },
  removeAttribute(name) { delete this.given[name]; },
});
const heads = [head(), head()];
const body = {
  rows: ROWS.map((row) => ({ cells: row.map(cell) })),
  appendChild(row) { this.rows = this.rows.filter((each) => each !== row).concat(row); },
};
const scroll = (width) => ({
  scrollWidth: width, clientWidth: 361, classList: { toggle(name, on) { this[name] = on; } },
});
const folds = [true, false].map((first) => ({ ...listen, hasAttribute: () => first, open: true }));
const wide = [361, 362, 571].map(scroll);
const found = {
  "table.sortable": [{ tHead: { rows: [{ cells: heads }] }, tBodies: [body] }],
  "details.fold": folds, "details": folds, ".scroll": wide,
};
const document = {
  ...listen, documentElement: { classList: { add() {} } },
  querySelectorAll: (selector) => found[selector] ?? [],
  createElement: () => ({ ...listen }), getElementById: () => ({ style: {} }),
};
const window = { ...listen };
const location = { hash: "" };
"""
REPORTED = """
const shown = () => body.rows.map((row) => row.cells[0].textContent);
const orders = [0, 0, 1, 1].map((column) => { heads[column].button.click(); return shown(); });
const open = () => folds.map((each) => each.open);
const states = [open()];
for (const kind of ["beforeprint", "afterprint"]) { handlers[kind](); states.push(open()); }
console.log(JSON.stringify([orders, heads.map((each) => each.given), states,
                            wide.map((each) => each.classList.cut)]));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js")
def test_tables_are_sorted_classes_fold_and_cut_tables_are_marked():
    rows = [
        (("class 2", None), ("0.5", "0.5")),
        (("class 10", None), ("< 0.0001", "1e-9")),
        (("class 1", None), ("-", "nan")),
        (("class 3", None), ("0.0400", "0.04")),
    ]
    script = (files("bayes_ssi") / "report/templates/script.js").read_text("utf-8")
    # One window listens to several events.
    handlers = "const handlers = {}; window.addEventListener = (k, act) => { handlers[k] = act; };"
    program = f"const ROWS = {json.dumps(rows)};{PAGE}{handlers}{script}{REPORTED}"
    done = subprocess.run(
        ["node", "-e", program], capture_output=True, text=True, timeout=60, check=True
    )
    orders, given, states, cut = json.loads(done.stdout)
    # Words by the numbers in them; numbers by their values, a missing one as if it were largest.
    by_name = [f"class {i}" for i in (1, 2, 3, 10)]
    by_value = [f"class {i}" for i in (10, 3, 2, 1)]
    assert orders == [by_name, by_name[::-1], by_value, by_value[::-1]]
    assert given == [{}, {"aria-sort": "descending"}]
    # The best class is open on the screen, and every class on paper.
    assert states == [[True, False], [True, True], [True, False]]
    # A pixel is rounding.
    assert cut == [False, False, True]
