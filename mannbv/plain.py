"""Frozen records to and from plain JSON values, by their annotations: what files hold, and never a NaN.

A dataclass or a mapping is an object, a tuple or a named tuple a list, and a number that does not exist is null.
"""

import dataclasses
import functools
import math
import types
import typing
from collections.abc import Mapping
from typing import TypeVar, cast

from mannbv import archive

_Record = TypeVar("_Record", bound="Plain")
_WORDS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
_LARGEST = {float: 1e300, int: 2**53}  # JSON holds whole numbers of any size


class Plain:
    """A record that a file can hold; fields that a file of an earlier version lacks take their defaults."""

    def to_json(self) -> dict:
        """The record as plain JSON values."""
        return cast(dict, _dump(self))

    @classmethod
    def from_json(cls: type[_Record], value: object, what: str = "") -> _Record:
        """The record of plain JSON values. Raises ValueError, with `what` they are, for the first that is wrong."""
        return _record(cls, value, what or cls.__name__)


def _dump(value):
    if dataclasses.is_dataclass(value):
        return {field.name: _dump(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {key: _dump(part) for key, part in value.items()}
    if isinstance(value, tuple):
        return [_dump(part) for part in value]
    return archive.plain(value)


_hints = functools.cache(typing.get_type_hints)


def _load(kind, value, what: str):
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if dataclasses.is_dataclass(kind):
        return _record(kind, value, what)
    if kind is object:  # whatever JSON holds
        return tuple(_load(object, part, what) for part in value) if isinstance(value, list) else value
    if origin is types.UnionType:
        return None if archive.plain(value) is None else _load(parts[0], value, what)
    if origin is Mapping:
        return {key: _load(parts[1], part, f"{what}, {key}") for key, part in _are(dict, value, what).items()}
    if origin is tuple and parts[-1] is Ellipsis:
        return tuple(_load(parts[0], part, f"{what} {k}") for k, part in enumerate(_are(list, value, what)))
    if origin is tuple or hasattr(kind, "_fields"):  # as many as there are kinds, perhaps with names
        named: dict = dict(enumerate(parts)) if origin else _hints(kind)
        if len(_are(list, value, what)) != len(named):
            raise ValueError(f"{what} must be a list of {len(parts) or ', '.join(named)}")
        values = (_load(part, each, f"{what} {name}") for (name, part), each in zip(named.items(), value, strict=True))
        return tuple(values) if origin else kind(*values)
    if kind is float and archive.plain(value) is None:
        return math.nan
    allowed = (int, float) if kind is float else kind
    if not isinstance(value, allowed) or (isinstance(value, bool) and kind is not bool) or not _within(kind, value):
        raise ValueError(f"{what} must be {_WORDS[kind]}, not {value!r:.40}")
    return kind(value)


def _within(kind, value) -> bool:
    return kind not in _LARGEST or abs(value) < _LARGEST[kind]


def _record(kind, value, what: str):
    fields = {field.name: field for field in dataclasses.fields(kind)}
    for name in _are(dict, value, what):
        if name not in fields:
            raise ValueError(f"{what} has a field '{name}' that this version does not know")
    for name, field in fields.items():
        if name not in value and field.default is dataclasses.MISSING:
            raise ValueError(f"{what} has no '{name}'")
    return kind(**{name: _load(_hints(kind)[name], part, f"{what}, {name}") for name, part in value.items()})


def _are(kind: type, value, what: str):
    if not isinstance(value, kind):
        raise ValueError(f"{what} must be {'a list' if kind is list else 'an object'}, not {value!r:.40}")
    return value
