"""Builds the guide's pages whenever the package is installed, also in development mode."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class GuideBuilder(BuildHookInterface):
    """Hatchling calls this before it makes a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build ``bayes_ssi/guide/html``, which the wheel then takes along."""
        del version, build_data
        from sphinx.cmd.build import build_main

        source = Path(self.root, "bayes_ssi", "guide")
        with TemporaryDirectory() as doctrees:
            options = ["--quiet", "--fresh-env", "--doctree-dir", doctrees]
            if build_main([*options, str(source), str(source / "html")]) != 0:
                raise RuntimeError(f"{source}: the guide could not be built")
