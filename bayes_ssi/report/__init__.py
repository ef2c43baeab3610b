"""A stored result as one self-contained HTML page."""

from bayes_ssi.report.write import write_report

__all__ = ["write_report"]
