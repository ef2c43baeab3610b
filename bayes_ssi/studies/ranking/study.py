"""A study: model classes that answer one question, the file that defines it, and its ranking."""

import importlib.util
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from importlib.machinery import ModuleSpec
from itertools import chain, takewhile
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import checked, repeated, require, require_known
from bayes_ssi.foundations.codec import to_record
from bayes_ssi.foundations.displayed import Displayed, InWords, counted
from bayes_ssi.foundations.error_places import own_lines
from bayes_ssi.foundations.packages import versions
from bayes_ssi.foundations.summaries import Summary
from bayes_ssi.foundations.text_files import require_name
from bayes_ssi.inference.model_class.class_record import ClassRecord, class_record
from bayes_ssi.inference.model_class.configuration import choose_configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.packing import STUDY_MODULE
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.studies.ranking.comparison import Comparison, checked_weights, require_same_data


@dataclass(frozen=True, eq=False, repr=False)
class Study(Displayed):
    """Model classes for one set of identified modes.

    Attributes:
        name: title for tables and reports.
        model_classes: the candidates.
        prior_weights: name of a class → its prior weight; equal where not given.
        description: what the study asks.
        mass_unit: unit of its structures' masses, such as "kg", which results print with masses.
        stands_for: class whose pairing is inferred in place of a given one → the classes of the
            original study that it represents.

    Raises:
        ValueError: the name cannot be printed, there is no model class, two have one name, or the
            prior weights are not one positive number per class.
        TypeError: one of them is not a ModelClass.

    >>> frame = bs.ShearBuilding((1.0, 1.0), 2 * (bs.Parameter("k", bs.LogNormal(40.0, 0.3)),))
    >>> modes = bs.ModalData((bs.IdentifiedMode("1", 0.622),), band_hz=(0.0, 1.0))
    >>> one, none = (bs.ModelClass(str(p), frame, modes, pairing=p) for p in ({"1": 1}, {}))
    >>> [each.name for each in bs.Study("Is it a mode?", [one, none]).model_classes]
    ["{'1': 1}", '{}']
    """

    name: str
    model_classes: Sequence[ModelClass]
    prior_weights: Mapping[str, float] | None = field(default=None, kw_only=True)
    description: str = field(default="", kw_only=True)
    mass_unit: str = field(default="", kw_only=True)
    stands_for: Mapping[str, tuple[str, ...]] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        require_name(self.name, "Study: name")
        object.__setattr__(self, "model_classes", tuple(self.model_classes))
        where = f"study {self.name!r}"
        if not self.model_classes:
            raise ValueError(f"{where}: no model class")
        for candidate in self.model_classes:
            if not isinstance(candidate, ModelClass):
                raise TypeError(f"{where}: {candidate!r} is not a ModelClass")
        if twice := repeated(self.names):
            raise ValueError(f"{where}: two model classes are named {twice[0]!r}")
        require(self.prior_weights, Mapping[str, float] | None, f"{where}: prior_weights")
        require(self.mass_unit, str, f"{where}: mass_unit")
        try:
            checked_weights(self.names, self.prior_weights)
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the model classes, in the study's order."""
        return tuple(candidate.name for candidate in self.model_classes)

    @checked
    def only(self, names: Sequence[str]) -> "Study":
        """The study with only the named classes, in the study's order.

        Raises:
            ValueError: a name is not that of a class.
        """
        require_known(f"study {self.name!r}: no model class", names, self.names)
        classes = [c for c in self.model_classes if c.name in names]
        weights = None if self.prior_weights is None else {n: self.prior_weights[n] for n in names}
        stands_for = {n: own for n, own in self.stands_for.items() if n in names}
        return replace(self, model_classes=classes, prior_weights=weights, stands_for=stands_for)

    def with_any_pairing(self) -> "Study":
        """The study with every pairing inferred; classes that differ in nothing else are merged.

        A merged class has the names of all, the sum of their prior weights, and what the
        descriptions of all begin with, which is the structure; else it has all descriptions.
        """
        groups: dict[tuple[str, ...], list[ModelClass]] = {}
        for candidate in self.model_classes:
            structures = [c.structure for c in candidate.configurations]
            described = (*structures, candidate.error, candidate.identification)
            with np.printoptions(threshold=sys.maxsize):  # arrays in full
                key = (*map(repr, described), candidate.data_digest)
            groups.setdefault(key, []).append(candidate)
        merged, weights, stands_for = [], {}, {}
        for own in groups.values():
            name = " or ".join(each.name for each in own)
            words = _merged(list(dict.fromkeys(c.description for c in own if c.description)))
            merged.append(replace(own[0].with_any_pairing(name), description=words))
            originals = (self.stands_for.get(each.name, (each.name,)) for each in own)
            stands_for[name] = tuple(chain.from_iterable(originals))
            if self.prior_weights is not None:
                weights[name] = sum(self.prior_weights[each.name] for each in own)
        return replace(
            self, model_classes=merged, prior_weights=weights or None, stands_for=stands_for
        )

    def require_same_data(self) -> None:
        """Raise a ValueError unless all classes explain the same data, in every configuration."""
        require_same_data(f"study {self.name!r}", self.model_classes, _where_different)

    def _line(self) -> str:
        return f"{self.name!r}: {counted(len(self.model_classes), 'model class')}"

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {"model class": c.name, "parameters": len(c.parameters), "description": c.description}
            for c in self.model_classes
        ]


def _merged(descriptions: Sequence[str]) -> str:
    """One description of classes that differ in their pairing only."""
    same = takewhile(lambda letters: len(set(letters)) == 1, zip(*descriptions, strict=False))
    common = "".join(letters[0] for letters in same)
    end = max(common.rfind(mark) for mark in ",;:")
    if len(descriptions) > 1 and end > 0:
        return f"{common[:end]}, any pairing"
    return " - or ".join(descriptions)


def _where_different(first: ModelClass, other: ModelClass) -> str:
    """Which configurations two classes do not share, or share under different data."""
    ours = {c.name: c.data.digest for c in first.configurations}
    theirs = {c.name: c.data.digest for c in other.configurations}
    if ours.keys() != theirs.keys():
        each = [", ".join(map(repr, names)) for names in (ours, theirs)]
        return f" (configurations {each[0]}; and {each[1]})"
    names = ", ".join(repr(name) for name in ours if name and ours[name] != theirs[name])
    return f" in configuration {names}" if names else ""


class RankedStudy(InWords):
    """A study's result, made or read from a directory, with the same attributes."""

    posteriors: tuple[Posterior, ...]
    comparison: Comparison
    tests: Mapping[str, ModalData]
    directory: Path | None

    @property
    def data(self) -> ModalData:
        """The identified modes of the only configuration; ValueError where there are several."""
        return choose_configuration(self.tests, None, str(self.directory or "result"))

    @property
    def ranked_posteriors(self) -> tuple[Posterior, ...]:
        """The posteriors in the order of the ranking, the best first."""
        return tuple(self.posterior(row.name) for row in self.comparison.classes)

    def posterior(self, name: str) -> Posterior:
        """The posterior of one class.

        Raises:
            ValueError: no class has that name.
        """
        by_name = {posterior.name: posterior for posterior in self.posteriors}
        require_known(f"{self.directory or 'result'}: no model class", [name], by_name)
        return by_name[name]

    def _rows(self) -> list[dict[str, Any]]:
        return self.comparison._rows()


IN_THE_FILE_OF_DRAWS = (
    "draws", "log_likelihoods", "frequencies_hz", "sensor_shapes", "datum_terms", "prior_draws",
)  # fmt: skip
NOT_IN_THE_RECORD = (*IN_THE_FILE_OF_DRAWS, "emulators", "importance_draws")


@dataclass(frozen=True)
class ResultRecord:
    """Everything in a result but its draws and its data."""

    created: str
    study: str
    description: str
    seed: int
    settings: SamplingSettings
    # Model class → prior weight; None where all are equal.
    prior_weights: Mapping[str, float] | None
    data_digest: str
    versions: Mapping[str, str]
    model_classes: tuple[ClassRecord, ...]
    stands_for: Mapping[str, tuple[str, ...]]
    posteriors: tuple[Mapping[str, Any], ...]
    draws: Mapping[str, str] = field(default_factory=dict)
    data: Mapping[str, str] = field(default_factory=dict)
    failed_checks_accepted: bool = False
    study_file: str = ""  # the file that defines the study; empty where there is none
    command: str = ""  # the command that reproduces it; empty where it was made from Python
    mass_unit: str = ""  # of the structures; empty where the study states none
    format: int = 25  # increased whenever the format of a result's files changes

    def model_class(self, name: str) -> ClassRecord:
        """The record of the model class ``name``; KeyError if there is none."""
        return {each.name: each for each in self.model_classes}[name]


@dataclass(frozen=True, eq=False, repr=False)
class Ranking(RankedStudy):
    """A study's result as it was made, from no ``search``, and not yet in a ``directory``."""

    study: Study
    posteriors: tuple[Posterior, ...]
    comparison: Comparison
    seed: int
    settings: SamplingSettings
    directory: None = field(default=None, init=False)
    search: None = field(default=None, init=False)

    @property
    def tests(self) -> Mapping[str, ModalData]:  # type: ignore[override]
        return {each.name: each.data for each in self.study.model_classes[0].configurations}

    @cached_property
    def record(self) -> ResultRecord:
        """What a result directory would hold of it, but for the draws and the data."""
        study = self.study
        return ResultRecord(
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            study=study.name,
            description=study.description,
            seed=self.seed,
            settings=self.settings,
            prior_weights=study.prior_weights,
            data_digest=self.comparison.data_digest,
            versions=versions(),
            model_classes=tuple(map(class_record, study.model_classes)),
            stands_for=study.stands_for,
            posteriors=tuple(
                to_record(posterior, without=NOT_IN_THE_RECORD)
                # For other programs.
                | {"summary": to_record(posterior.summary)}
                for posterior in self.posteriors
            ),
            mass_unit=study.mass_unit,
        )

    def _line(self) -> str:
        return f"of {self.study.name!r}: {self.comparison._line()}"


# Packages that studies import, and the extras of this one that install them.
EXTRAS = {"openseespy": "opensees", "skfem": "fem"}


@checked
def load_study(path: str | Path) -> Study:
    """The one :class:`Study` that a Python file defines.

    Raises:
        ValueError: there is no such file, it is not Python, it raises an error, or it defines no
            study or several; the message gives the file, and the line where there is one.
    """
    path = Path(path)
    if not path.is_file():
        what = "a directory, not a study file" if path.is_dir() else "no such file"
        raise ValueError(f"{path}: {what}")
    spec = importlib.util.spec_from_file_location(f"{STUDY_MODULE}{path.stem}", path)
    if path.suffix != ".py" or spec is None:
        raise ValueError(f"{path}: a study is a Python file, its name ending in .py")
    try:
        names = _run(spec)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever a user's file may raise
        raise ValueError(f"{path}: {_explained(error, str(spec.origin))}") from error
    # A study may have several names.
    studies: dict[int, str] = {}
    for name, value in names.items():
        if isinstance(value, Study):
            studies.setdefault(id(value), name)
    if not studies:
        raise ValueError(
            f"{path}: defines no study; end it with a line such as "
            'study = bayes_ssi.Study("title", [model_class, ...])'
        )
    if len(studies) > 1:
        several = ", ".join(studies.values())
        raise ValueError(f"{path}: defines several studies, {several}; keep one in a file")
    (name,) = studies.values()
    return names[name]


def _run(spec: ModuleSpec) -> Mapping[str, Any]:
    module = importlib.util.module_from_spec(spec)
    # Dataclasses and pickles defined in a study look their module up by name.
    sys.modules[spec.name] = module
    # No cached bytecode: the file may have changed since, and nothing is written next to it.
    writes, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        assert spec.loader is not None
        spec.loader.exec_module(module)
    finally:
        sys.dont_write_bytecode = writes
    return vars(module)


def _explained(error: BaseException, study: str) -> str:
    """What a study's file raised, and on which line of it, in one line.

    An error raised in a module that the study calls has the file and line in it, too.
    """
    lines = own_lines(error)
    of_study = [line for file, line in lines if file == study]
    if not of_study:  # it never ran
        line = getattr(error, "lineno", None)
        where = f"line {line}: " if line else ""
        return f"{where}not Python: {_one_line(getattr(error, 'msg', error))}"
    where = f"line {of_study[-1]}: "
    file, line = lines[-1]
    if file != study:
        where += f"{Path(file).name}, line {line}: "
    package = (error.name or "").partition(".")[0] if isinstance(error, ImportError) else ""
    remedy = f'; pip install "bayes_ssi[{EXTRAS[package]}]"' if package in EXTRAS else ""
    return f"{where}{type(error).__name__}: {_one_line(error)}{remedy}"


def _one_line(message: object) -> str:
    return " ".join(str(message).split())


@dataclass(frozen=True)
class AveragedParameter(Summary):
    """A parameter averaged over the model classes that infer it, by their probabilities."""

    n_classes: int  # that infer it
    probability: float  # of these classes together
    # Of a search: under the most probable hypothesis without any feature that infers it.
    naive_mean: float | None = None
    naive_sd: float | None = None


def averaged_parameters(
    posteriors: Sequence[Posterior], comparison: Comparison
) -> tuple[AveragedParameter, ...]:
    """Every parameter that several classes infer, in the order in which they first appear.

    One whose classes all have probability zero is left out.
    """
    probabilities = {row.name: row.probability for row in comparison.classes}
    holders: dict[str, list[Posterior]] = {}
    for posterior in posteriors:
        for name in posterior.parameter_names:
            holders.setdefault(name, []).append(posterior)
    return tuple(
        averaged_parameter(name, own, [probabilities[posterior.name] for posterior in own])
        for name, own in holders.items()
        if len(own) > 1 and sum(probabilities[posterior.name] for posterior in own) > 0.0
    )


def averaged_parameter(
    name: str, posteriors: Sequence[Posterior], probabilities: Sequence[float], **further: float
) -> AveragedParameter:
    total = sum(probabilities)
    draws, weights = [], []
    for posterior, probability in zip(posteriors, probabilities, strict=True):
        own = posterior.values[:, posterior.parameter_names.index(name)]
        draws.append(own)
        weights.append(np.full(len(own), probability / total / len(own)))
    x, w = np.concatenate(draws), np.concatenate(weights)
    return AveragedParameter.weighted(
        name, x, w, n_classes=len(posteriors), probability=min(total, 1.0), **further
    )
