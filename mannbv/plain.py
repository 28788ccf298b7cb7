"""Frozen records to and from plain JSON values, by their annotations: what files hold, and never a NaN.

A dataclass is an object, a named tuple a list, a tuple a list, and a number that does not exist is null.
"""

import dataclasses
import functools
import types
import typing
from typing import TypeVar

from mannbv import archive

_Record = TypeVar("_Record", bound="Plain")
_NUMBERS = {float: (int, float), int: int, str: str, bool: bool}
_WORDS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}


class Plain:
    """A record that a file can hold; fields that a file of an earlier version lacks take their defaults."""

    def to_json(self) -> dict:
        """The record as plain JSON values."""
        return _dump(self)

    @classmethod
    def from_json(cls: type[_Record], value, what: str = "") -> _Record:
        """The record of plain JSON values. Raises ValueError, with `what` they are, for the first that is wrong."""
        return _load(cls, value, what or cls.__name__)


def _dump(value):
    if dataclasses.is_dataclass(value):
        return {field.name: _dump(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, tuple):
        return [_dump(part) for part in value]
    return archive.plain(value)


_hints = functools.cache(typing.get_type_hints)


def _load(kind, value, what: str):
    if dataclasses.is_dataclass(kind):
        return _record(kind, value, what)
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin is types.UnionType:
        return None if value is None else _load(parts[0], value, what)
    if origin is tuple:
        return tuple(_load(parts[0], part, f"{what} {k}") for k, part in enumerate(_list(value, what)))
    if hasattr(kind, "_fields"):  # a named tuple
        if len(_list(value, what)) != len(kind._fields):
            raise ValueError(f"{what} must be a list of {', '.join(kind._fields)}")
        named = zip(kind._fields, value, strict=True)
        return kind(*(_load(_hints(kind)[name], part, f"{what}, {name}") for name, part in named))
    if not isinstance(value, _NUMBERS[kind]) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"{what} must be {_WORDS[kind]}, not {value!r:.40}")
    return kind(value)


def _record(kind, value, what: str):
    if not isinstance(value, dict):
        raise ValueError(f"{what} must be an object, not {value!r:.40}")
    fields = {field.name: field for field in dataclasses.fields(kind)}
    for name in value:
        if name not in fields:
            raise ValueError(f"{what} has a field '{name}' that this version does not know")
    for name, field in fields.items():
        if name not in value and field.default is dataclasses.MISSING:
            raise ValueError(f"{what} has no '{name}'")
    return kind(**{name: _load(_hints(kind)[name], part, f"{what}, {name}") for name, part in value.items()})


def _list(value, what: str) -> list:
    if not isinstance(value, (list, tuple)):
        raise ValueError(f"{what} must be a list, not {value!r:.40}")
    return value
