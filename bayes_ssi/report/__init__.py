"""A stored result as one page that people read: HTML that needs no other file."""

from bayes_ssi.report.write import write_report

__all__ = ["write_report"]
