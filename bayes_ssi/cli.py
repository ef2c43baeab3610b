"""The command line ``bayes-ssi`` and its commands.

Exit codes: 0, success; 2, unusable input, explained in one line; 3, a result was computed and
saved but one of its checks failed, unless that is accepted; 130, interrupted; 1, the reader of the
output has closed it.
"""

import re

import click

from bayes_ssi.commands.blind_spots import blind_spots
from bayes_ssi.commands.calibrate import calibrate, sensitivities
from bayes_ssi.commands.changes import changes
from bayes_ssi.commands.check import check
from bayes_ssi.commands.export import export
from bayes_ssi.commands.guide import guide
from bayes_ssi.commands.hierarchy import hierarchy
from bayes_ssi.commands.identify import identify
from bayes_ssi.commands.import_model import import_model
from bayes_ssi.commands.merge import merge
from bayes_ssi.commands.new import new
from bayes_ssi.commands.plan import plan
from bayes_ssi.commands.predict import predict
from bayes_ssi.commands.rank import rank
from bayes_ssi.commands.report import report
from bayes_ssi.commands.search import search
from bayes_ssi.commands.terminal import QUIET_OPTION, OneLineErrors
from bayes_ssi.commands.what_if import what_if

# In the order of work.
COMMANDS = (
    new, import_model, identify, merge, check, calibrate, sensitivities, rank, search, changes,
    plan, blind_spots, what_if, hierarchy, predict, export, report, guide,
)  # fmt: skip

for command in COMMANDS:
    command.params.append(QUIET_OPTION)
    # The whole first sentence, which click would cut.
    command.short_help = " ".join(re.split(r"(?<=[.?])\s", command.help or "")[0].split())


@click.group(
    cls=OneLineErrors,
    commands=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="bayes_ssi")
def main() -> None:
    """Identified modes in, ranked model classes out."""
