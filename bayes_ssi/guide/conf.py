"""How Sphinx builds the guide: ``python -m sphinx -W bayes_ssi/guide bayes_ssi/guide/html``."""

import sys
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike
from sphinx.application import Sphinx
from sphinx.util.typing import stringify_annotation

sys.path.insert(0, str(Path(__file__).parents[2]))

# The API page is read from the package as imported: only so are signatures of dataclasses and
# inherited docstrings right. An import that fails must fail the build, not leave the page empty.
import bayes_ssi  # noqa: F401
from bayes_ssi.foundations.arrays import FloatArray

project = "bayes_ssi"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_click"]
exclude_patterns = ["html"]

myst_heading_anchors = 3
smartquotes_action = "qe"  # quotes and ellipses; --json in a help text is no dash

add_module_names = False
autodoc_member_order = "bysource"
napoleon_attr_annotations = False
napoleon_use_ivar = True
python_maximum_signature_line_length = 80

html_theme = "furo"
html_title = "bayes_ssi"
html_static_path = ["_static"]
html_css_files = ["guide.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False


def with_names_of_types(*event: Any) -> tuple[str | None, str | None]:
    """A signature in which types of arrays have their names, not what these stand for."""
    signature, returned = event[-2:]
    for name, kind in (("FloatArray", FloatArray), ("ArrayLike", ArrayLike)):
        written = stringify_annotation(kind, "smart")
        signature = signature and signature.replace(written, name)
        returned = returned and returned.replace(written, name)
    return signature, returned


def setup(app: Sphinx) -> None:
    app.connect("autodoc-process-signature", with_names_of_types)
