"""Studies loaded from a file, and the line of the file that each error names."""

import re
import sys

import numpy as np
import pytest

from bayes_ssi.inference.workers.workers import evaluate
from bayes_ssi.studies.ranking.study import load_study


def test_loading_a_file_writes_none(tiny_study_file):
    before = sys.dont_write_bytecode
    study = load_study(tiny_study_file)
    assert (study.name, study.names) == ("Two storeys", ("one k", "each k"))
    assert load_study(str(tiny_study_file)).names == study.names
    assert list(tiny_study_file.parent.iterdir()) == [tiny_study_file]
    assert sys.dont_write_bytecode == before


def test_a_study_may_define_dataclasses(tiny_study_file):
    text = tiny_study_file.read_text()
    head = "from __future__ import annotations\nfrom dataclasses import dataclass\n"
    body = "\n@dataclass\nclass Storey:\n    height: float\n"
    tiny_study_file.write_text(head + text + body)
    assert load_study(tiny_study_file).name == "Two storeys"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("s.py", None, "no such file"),
        ("s.txt", b"study = 1", r"a study is a Python file, its name ending in \.py"),
        ("s.py", b"", "defines no study; end it with a line such as study = "),
        ("s.py", b"x = 1\ndef (", r"line 2: not Python: "),
        ("s.py", b"x = '\xff'", "not Python"),
        ("s.py", b"x = 1\0", "null bytes"),
        ("s.py", b"x = 1\n\n1 / 0\n", "line 3: ZeroDivisionError: division by zero"),
        ("s.py", b"raise SystemExit('a\\nb')", "line 1: SystemExit: a b"),
        ("s.py", b"raise BaseException('odd')", "line 1: BaseException: odd"),
        ("s.py", b"import no_such_module", "line 1: ModuleNotFoundError: No module named"),
        ("s.py", b"raise ImportError('none', name='skfem.helpers')",
         r'ImportError: none; pip install "bayes_ssi\[fem\]"'),
    ],
)  # fmt: skip
def test_files_that_are_no_study_are_refused_in_one_line(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as caught:
        load_study(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_two_studies_in_one_file_are_refused_by_their_names(tiny_study_file):
    with tiny_study_file.open("a") as file:
        file.write("alias = study\n")
    assert load_study(tiny_study_file).name == "Two storeys"  # of two names
    with tiny_study_file.open("a") as file:
        file.write("another = study.only(['one k'])\n")
    with pytest.raises(ValueError, match="defines several studies, study, another; keep one"):
        load_study(tiny_study_file)


def test_errors_name_the_line_of_the_file(tiny_study_file):
    with tiny_study_file.open("a") as file:
        file.write("bs.LogNormal(median=1.0,\n            cov=-1.0)\n")
    n_lines = len(tiny_study_file.read_text().splitlines())
    message = rf"line ({n_lines - 1}|{n_lines}): ValueError: LogNormal: cov must be positive"
    with pytest.raises(ValueError, match=message):
        load_study(tiny_study_file)


HELPER = "def half(x):\n    return x / 0\n"


@pytest.mark.parametrize(
    ("helper", "study", "message"),
    [
        # Errors of constructors, also of a path that is relative.
        ("", "import bayes_ssi as bs\n\nbs.Sensor('', {})\n", "line 3: ValueError: Sensor: label"),
        (HELPER, "import helper_of_study\nx = 1\nhelper_of_study.half(x)\n",
         r"line 3: helper_of_study\.py, line 2: ZeroDivisionError: division by zero"),
        ("x = 1\nx = 1 / 0\n", "\nimport helper_of_study\n",
         r"line 2: helper_of_study\.py, line 2: ZeroDivisionError"),
        # What is not Python is the helper, and what is not UTF-8 is a file that the study reads.
        ("x = 1\nx = (\n", "\nimport helper_of_study\n",
         r"line 2: SyntaxError: .*\(helper_of_study\.py, line 2\)"),
        ("", "x = 1\nb'\\xff'.decode()\n", "line 2: UnicodeDecodeError: 'utf-8' codec"),
    ],
)  # fmt: skip
def test_errors_name_the_lines_of_the_study_and_of_what_it_calls(
    tmp_path, monkeypatch, helper, study, message
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "helper_of_study.py").write_text(helper)
    (tmp_path / "s.py").write_text(study)
    sys.modules.pop("helper_of_study", None)
    with pytest.raises(ValueError, match=rf"^s\.py: {message}"):
        load_study("s.py")


def test_errors_of_a_function_that_is_called_later_have_their_line(tmp_path):
    path = tmp_path / "s.py"
    path.write_text("""import bayes_ssi as bs
k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
def modes(k):
    return [1.0], 1 / 0
structure = bs.FunctionStructure(modes, {"k": k}, n_modes=1)
data = bs.ModalData((bs.IdentifiedMode("1", 1.0),), (0.0, 2.0))
study = bs.Study("s", [bs.ModelClass("c", structure, data, pairing={"1": 1})])
""")
    (candidate,) = load_study(path).model_classes
    place = r"at k = 1: ZeroDivisionError: division by zero \(s\.py, line 4\)$"
    with pytest.raises(ValueError, match=place):
        candidate.check_structure()
    failures = evaluate(candidate.log_likelihood_at, np.zeros((1, 3))).failures
    assert re.search(place, failures[0])
