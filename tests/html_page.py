"""A page of a report, taken apart."""

from html.parser import HTMLParser

import bayes_ssi as bs
from bayes_ssi.report.write import write_report
from bayes_ssi.results.stored_result import save_result
from bayes_ssi.studies.ranking.study import Ranking

VOID = {"meta", "img", "br", "input", "link", "hr"}


class Page(HTMLParser):
    """Refuses tags that do not match; collects identities, addresses, texts and rows of tables."""

    def __init__(self, text):
        super().__init__()
        self.source = text
        self.open, self.ids, self.addresses, self.texts, self.rows = [], [], [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.ids += [given["id"]] if "id" in given else []
        self.addresses += [given[k] for k in ("src", "href", "xlink:href") if k in given]
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"</{tag}> closes another"

    def handle_data(self, data):
        if not self.open or self.open[-1] not in ("style", "script"):
            self.texts.append(data)
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data

    @property
    def text(self):
        return " ".join(" ".join(self.texts).split())


def page_of(ranking, directory, **options):
    """The report of a ranking, which is saved in a directory."""
    save_result(ranking, directory, **options)
    return Page(write_report(directory).read_text("utf-8"))


def of_two_storeys(make_posterior, data, log_evidences, pairings, k="k", **changes):
    """A ranking without sampling of classes of one building: name → pairing."""
    factor = bs.Parameter(k, bs.LogNormal(40.0, 0.3))
    building, error = bs.ShearBuilding((1.0, 1.0), (factor, factor)), bs.ErrorModel(0.02, 0.05)
    classes = [
        bs.ModelClass(name, building, data, error, pairing=own) for name, own in pairings.items()
    ]
    posteriors = tuple(
        make_posterior(each.name, log_evidence, names=each.parameter_names, pairing=each.pairing,
                       data_digest=data.digest, **changes)
        for each, log_evidence in zip(classes, log_evidences, strict=True)
    )  # fmt: skip
    study = bs.Study("A & B", classes, description="<i>which</i>?")
    return Ranking(study, posteriors, bs.compare(posteriors), 0, bs.SamplingSettings())
