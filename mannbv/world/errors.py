"""What is said of a scene that cannot be used."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class SceneError(ValueError):
    """A scene that cannot be used; its one line names the file, the thing and the remedy."""


@contextmanager
def naming(thing: str | Path) -> Iterator[None]:
    """Puts the name of a thing before whatever SceneError is raised inside."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{thing}: {error}") from None
