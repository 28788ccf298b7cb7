"""Write requirements.lock: what pyproject.toml asks for and all that follows from it, pinned to what is installed here.

    python tools/lock.py

torch comes first and without its build tag (2.13.0, not 2.13.0+cpu), so that a CPU and a CUDA build both satisfy the
lock. No paths, no hosts: where packages come from is the reader's own pip configuration.
"""

import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parent.parent
HEADER = """\
# Written by tools/lock.py (make lock). torch stands first and pinned: a looser one may bring several GB of CUDA.
"""


def asked_for(root: Path = ROOT) -> list[Requirement]:
    """Every direct dependency in pyproject.toml, those of the extras included."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project.get("optional-dependencies", {}).values()
    return [Requirement(text) for group in (project["dependencies"], *extras) for text in group]


def closure(requirements: list[Requirement]) -> dict[str, str]:
    """The installed version of each requirement and of everything it needs on this platform, by canonical name."""
    pinned, seen, queue = {}, set(), list(requirements)
    while queue:
        requirement = queue.pop()
        name = canonicalize_name(requirement.name)
        if (name, frozenset(requirement.extras)) in seen:
            continue
        seen.add((name, frozenset(requirement.extras)))
        installed = metadata.distribution(name)
        pinned[name] = Version(installed.version).public
        for text in installed.requires or ():
            child = Requirement(text)
            wanted = ("", *requirement.extras)
            if child.marker is None or any(child.marker.evaluate({"extra": extra}) for extra in wanted):
                queue.append(child)
    return pinned


def lock_text(pinned: dict[str, str]) -> str:
    """The lock file: a line per package, torch first, the rest by name."""
    names = sorted(pinned, key=lambda name: (name != "torch", name))
    return HEADER + "".join(f"{name}=={pinned[name]}\n" for name in names)


if __name__ == "__main__":
    pinned = closure(asked_for())
    (ROOT / "requirements.lock").write_text(lock_text(pinned), encoding="utf-8")
    print(f"requirements.lock: {len(pinned)} packages")
