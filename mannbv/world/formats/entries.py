"""JSON read strictly: every complaint names the file, the place in it, what was wanted and what was found."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn, TypeGuard

import numpy as np

from mannbv import archive
from mannbv.world import bodies
from mannbv.world.errors import SceneError

LARGEST = 1e6  # no number in a scene is larger: lengths are metres


def read(path: str | Path, form: str) -> "Entry":
    """The object in a JSON file whose "format" is `form`. Raises SceneError."""
    try:
        document = archive.from_json(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror or error}); check the path") from None
    except ValueError as error:
        raise SceneError(f"{path}: not valid JSON ({error}); is the file complete? See data/README.md") from None
    if not isinstance(document, dict) or document.get("format") != form:
        raise SceneError(f'{path}: "format" must be "{form}"; is this a plan? See data/README.md')
    return Entry(document, str(path))


@dataclass(frozen=True)
class Entry:
    """One JSON object and where it stands, so that every complaint names its place, and the remedy."""

    values: dict[str, object]
    file: str
    place: str = ""
    remedy: str = "see data/README.md"

    def at(self, key: str) -> str:
        """The place of an entry, as in walls[3].from."""
        return f"{self.place}.{key}".strip(".")

    def fail(self, key: str, wanted: str, value: object) -> NoReturn:
        shown = json.dumps(value)
        shown = shown if len(shown) < 60 else shown[:57] + "…"
        raise SceneError(f"{self.file}: {self.at(key)} must be {wanted}, got {shown}; {self.remedy}")

    def get(self, key: str, *default: object) -> object:
        """The value of a key; the default, where one is given, if it is absent."""
        if key not in self.values and not default:
            raise SceneError(f"{self.file}: {self.at(key)} is missing; {self.remedy}")
        return self.values.get(key, *default)

    def text(self, key: str) -> str:
        value = self.get(key)
        if not isinstance(value, str) or not value or not value.isprintable():
            self.fail(key, "a line of printable text", value)
        return value

    def number(self, key: str, *default: float, least: float = -LARGEST, above: float = -LARGEST) -> float:
        """A finite number of at least `least` and greater than `above`."""
        value = self.get(key, *default)
        if not _is_number(value) or value < least or value <= above:
            bounds = [f" of at least {least:g}"] * (least > -LARGEST) + [f" above {above:g}"] * (above > -LARGEST)
            self.fail(key, "a finite number" + "".join(bounds), value)
        return float(value)

    def array(self, key: str, shape: tuple[int, ...]) -> np.ndarray:
        """Finite numbers of the given shape, in which −1 stands for any length."""
        value = self.get(key)
        size = " × ".join("n" if n < 0 else str(n) for n in shape)
        if not _is_array(value, shape):
            self.fail(key, f"{size} finite numbers", value)
        return np.array(value, float).reshape(shape)

    def color(self, key: str) -> tuple[float, ...]:
        value = self.get(key)
        if not _is_array(value, (3,)) or not all(0 <= v <= 1 for v in value):
            self.fail(key, "3 numbers between 0 and 1 (red, green, blue)", value)
        return tuple(float(v) for v in value)

    def polygon(self, key: str) -> np.ndarray:
        """Corners (k, 2) [m]."""
        polygon = self.array(key, (-1, 2))
        if len(polygon) < 3 or abs(bodies.signed_area(polygon)) < 1e-6:
            self.fail(key, "3 or more corners around an area", polygon.tolist())
        return polygon

    def child(self, key: str, value: object) -> "Entry":
        """The object `value` that stands under `key`."""
        if not isinstance(value, dict):
            self.fail(key, "a JSON object", value)
        return replace(self, values=value, place=self.at(key))

    def children(self, key: str, *default: list) -> list["Entry"]:
        """The objects in a list."""
        values = self.get(key, *default)
        if not isinstance(values, list):
            self.fail(key, "a list", values)
        return [self.child(f"{key}[{k}]", value) for k, value in enumerate(values)]


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and -LARGEST < value < LARGEST


def _is_array(value: object, shape: tuple[int, ...]) -> TypeGuard[list]:
    if not shape:
        return _is_number(value)
    return isinstance(value, list) and shape[0] in (-1, len(value)) and all(_is_array(v, shape[1:]) for v in value)
