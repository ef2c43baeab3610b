"""Make the guide's pictures of plots, by its own code.

    python runs/guide_pictures.py

runs the code of every chapter of the guide that calls a plot, and saves what each call draws in
runs/pictures/plots.
"""

from __future__ import annotations

import ast
import os
import re
import tempfile
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("agg")

import matplotlib.pyplot as plt
from PIL import Image

GUIDE = Path(__file__).parents[1] / "bayes_ssi" / "guide"
PICTURES = Path(__file__).parent / "pictures" / "plots"
DPI = 80


def main() -> None:
    PICTURES.mkdir(exist_ok=True)
    for page in sorted(GUIDE.glob("*.md")):
        text = page.read_text("utf-8")
        if re.search(r"^plots\.plot_", text, re.M):
            with tempfile.TemporaryDirectory() as folder:
                os.chdir(folder)
                draw("\n".join(re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)))


def draw(code: str) -> None:
    """Run a chapter's code up to its last plot, and save what plots draw, each under its name."""
    variables: dict[str, Any] = {"__name__": "guide"}
    parts = [ast.unparse(statement) for statement in ast.parse(code).body]
    last = max(i for i, part in enumerate(parts) if part.startswith("plots.plot_"))
    for part in parts[: last + 1]:
        exec(compile(part, "guide", "exec"), variables)
        # That of shapes that move is of a page, taken by a browser.
        if match := re.match(r"plots\.plot_(?!moving)(\w+)\(", part):
            path = PICTURES / f"{match[1]}.png"
            plt.gcf().savefig(path, dpi=DPI, bbox_inches="tight")
            plt.close("all")
            # Few colours: half the size, and none seen.
            Image.open(path).convert("RGB").quantize(64).save(path, optimize=True)
            print(path.name)


if __name__ == "__main__":
    main()
