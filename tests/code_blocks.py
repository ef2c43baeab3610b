"""The code blocks of a Markdown page, and running them in order."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

from click.testing import CliRunner

from bayes_ssi.cli import main

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
CHAPTERS = sorted((ROOT / "bayes_ssi" / "guide").glob("*.md"))
PAGES = [README, *CHAPTERS]
# Installing and testing is what the continuous integration does.
ELSEWHERE = ("python3 -m venv", "python3 -m pip", "pip install", "pytest")


@dataclass(frozen=True)
class Block:
    """One fenced block; ``console`` blocks show a session of which only the commands are code."""

    language: str
    text: str

    @property
    def commands(self):
        """The shell's commands, each as a list of words."""
        if self.language not in ("sh", "console"):
            return []
        lines = [line.partition(" # ")[0] for line in self.text.replace("\\\n", " ").splitlines()]
        if self.language == "console":
            lines = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
        return [shlex.split(line) for line in lines if line and not line.startswith(ELSEWHERE)]


def blocks(page):
    fences = re.findall(r"^```([^\n`]*)\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.M)
    return [Block(language.strip(), text) for language, text in fences]


def commands(page):
    return [command for block in blocks(page) for command in block.commands]


def run_page(page):
    """Run the Python and the shell commands of a page in order, in the working directory."""
    namespace = {"__name__": "a_page"}
    for block in blocks(page):
        if block.language == "python":
            exec(compile(block.text, page.name, "exec"), namespace)
        elif block.language == "sh":
            run_block(block)


def run_block(block):
    """Run a block's shell commands, and print what they print.

    They may end with failed checks (exit code 3): tests sample more coarsely than users.
    """
    for program, *arguments in block.commands:
        assert program == "bayes-ssi", f"{program} is not run here"
        done = CliRunner().invoke(main, arguments)
        assert done.exit_code in (0, 3), f"{arguments}: {done.output}"
        print(done.stdout)
