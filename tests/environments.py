"""Environments with what extras of the project bring, and nothing else that is installed here."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from importlib.metadata import Distribution, distribution
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def made(folder: Path, extras: Iterable[str] = ()) -> Path:
    """A folder for PYTHONPATH with just what `pip install '.[EXTRAS]'` brings, as links.

    `python -S` sees nothing else. Installing more of it goes on in the same folder.
    """
    folder.mkdir(exist_ok=True)
    wanted = [*PROJECT["dependencies"]]
    for extra in extras:
        wanted += PROJECT["optional-dependencies"][extra]
    for one in _closure(wanted):
        for top in {Path(str(file)).parts[0] for file in one.files or ()}:
            if top not in ("..", "__pycache__") and not (folder / top).exists():
                (folder / top).symlink_to(Path(str(one.locate_file(top))))
    return folder


def _closure(requirements: Iterable[str]) -> list[Distribution]:
    """What is required, and what that requires, as it is installed here."""
    found: dict[str, Distribution] = {}
    waiting = [Requirement(one) for one in requirements]
    while waiting:
        wanted = waiting.pop()
        if wanted.name in found or (wanted.marker and not wanted.marker.evaluate({"extra": ""})):
            continue
        found[wanted.name] = distribution(wanted.name)
        waiting += [Requirement(one) for one in found[wanted.name].requires or ()]
    return list(found.values())
