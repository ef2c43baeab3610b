"""Objects as records that JSON can hold, and back again by the type hints of their fields.

Dataclasses and named tuples become mappings of their fields, other tuples and arrays lists, and
infinities and NaN text. A class with subclasses to choose from, such as a prior, names in
``record_tag`` the key under which a record holds the name of the subclass.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from bayes_ssi.foundations.argument_types import require_known

T = TypeVar("T")

EXPECTED = {str: "text", bool: "true or false", int: "a whole number", float: "a number"}
NOT_FINITE = ("inf", "-inf", "nan")
_hints = cache(get_type_hints)


def to_record(value: Any, without: Collection[str] = ()) -> Any:
    """As JSON can hold the value; for a dataclass, without the fields in ``without``."""
    if is_dataclass(value) or (isinstance(value, tuple) and hasattr(value, "_fields")):
        kind: Any = type(value)
        tag = getattr(value, "record_tag", None)
        head = {tag: kind.__name__} if tag else {}
        names = [name for name in _fields_of(kind) if name not in without]
        return head | {name: to_record(getattr(value, name)) for name in names}
    if isinstance(value, Mapping):
        return {str(key): to_record(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_record(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return to_record(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    raise TypeError(f"a record cannot hold {value!r}")


def from_record(kind: type[T], record: Any, path: str = "", **given: Any) -> T:
    """The object from its record by :func:`to_record`; keys that are not fields are ignored.

    A field with a default may be missing: older files lack what was added since.
    """
    return cast(T, _read_fields(kind, record, path, given) if given else _read(kind, record, path))


def _read(hint: Any, record: Any, path: str) -> Any:
    kind, arguments = get_origin(hint) or hint, get_args(hint)
    # From numpy 2.5 on an array's type is an alias that holds its value.
    kind = get_origin(alias) or alias if (alias := getattr(kind, "__value__", None)) else kind
    if kind is Any:
        return record
    if kind in (Union, UnionType):
        return _read_union(arguments, record, path)
    if kind in EXPECTED:
        return _read_scalar(kind, record, path)
    if kind is np.ndarray:
        return np.array(_read_numbers(record, path), dtype=float)
    if kind is tuple:
        return _read_tuple(arguments, record, path)
    if issubclass(kind, Mapping):
        _require(isinstance(record, dict), "a record", record, path)
        key_kind, item_hint = arguments
        return {
            _read_key(key_kind, key, path): _read(item_hint, item, _join(path, key))
            for key, item in record.items()
        }
    if hasattr(kind, "record_tag"):
        kind = _subclass(kind, record, path)
    return _read_fields(kind, record, path, {})


def _read_union(choices: tuple[Any, ...], record: Any, path: str) -> Any:
    if record is None and NoneType in choices:
        return None
    problem = ValueError()
    for choice in choices:
        if choice is not NoneType:
            try:
                return _read(choice, record, path)
            except ValueError as error:
                problem = error
    raise problem


def _read_scalar(kind: type, record: Any, path: str) -> Any:
    if kind is float:
        number = isinstance(record, (int, float)) and not isinstance(record, bool)
        _require(number or record in NOT_FINITE, EXPECTED[kind], record, path)
        return float(record)
    # bool is a subclass of int, but true is not a whole number.
    _require(type(record) is kind, EXPECTED[kind], record, path)
    return record


def _read_numbers(record: Any, path: str) -> Any:
    """A number, or a list of lists of numbers."""
    if not isinstance(record, list):
        return _read_scalar(float, record, path)
    return [_read_numbers(item, f"{path}[{i}]") for i, item in enumerate(record)]


def _read_tuple(hints: tuple[Any, ...], record: Any, path: str) -> tuple[Any, ...]:
    _require(isinstance(record, list), "a list", record, path)
    if hints[-1] is Ellipsis:
        hints = hints[:1] * len(record)
    _require(len(record) == len(hints), f"a list of {len(hints)}", record, path)
    items = enumerate(zip(hints, record, strict=True))
    return tuple(_read(hint, item, f"{path}[{i}]") for i, (hint, item) in items)


def _read_key(kind: type, key: str, path: str) -> Any:
    try:
        return kind(key)
    except ValueError:
        raise ValueError(f"{_join(path, key)}: expected a key that is {EXPECTED[kind]}") from None


def _subclass(base: type, record: Any, path: str) -> type:
    """The subclass that a record names; the base itself where it has none."""
    _require(isinstance(record, dict), "a record", record, path)
    tag = base.record_tag  # type: ignore[attr-defined]
    known = {kind.__name__: kind for kind in _subclasses(base)} or {base.__name__: base}
    require_known(f"{path or 'record'}: no {tag}", [record.get(tag)], known)
    return known[record[tag]]


def _subclasses(base: type[Any]) -> Iterator[type[Any]]:
    for kind in base.__subclasses__():
        yield kind
        yield from _subclasses(kind)


def _read_fields(kind: type, record: Any, path: str, given: Mapping[str, Any]) -> Any:
    _require(isinstance(record, dict), "a record", record, path)
    hints, values = _hints(kind), dict(given)
    for name, has_default in _fields_of(kind).items():
        if name in record and name not in values:
            values[name] = _read(hints[name], record[name], _join(path, name))
        if name not in values and not has_default:
            raise ValueError(f"{_join(path, name)}: missing")
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}" if path else str(error)) from error


@cache
def _fields_of(kind: Any) -> dict[str, bool]:
    """Name of each field → whether it has a default."""
    if is_dataclass(kind):
        return {each.name: each.default is not MISSING for each in fields(kind)}
    return {name: name in kind._field_defaults for name in kind._fields}


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _require(condition: bool, expected: str, record: Any, path: str) -> None:
    if not condition:
        got = repr(record)
        got = got if len(got) <= 80 else f"{got[:77]}..."
        raise ValueError(f"{path or 'record'}: expected {expected}, got {got}")
