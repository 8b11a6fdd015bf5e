"""Where worlds of Gazebo and the models that they include are looked for."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from koord.runtime.configuration.gazebo import Find
from koord.syntax.source import Source, normalise, visible

#: Environment variables with folders of models, as Gazebo looks in them.
VARIABLES = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "GAZEBO_MODEL_PATH")

#: Where Gazebo looks for worlds besides.
_WORLDS = "GAZEBO_RESOURCE_PATH"

#: Files of models by their usual names.
_MODELS = ("model.sdf", "model-1_4.sdf", "model-1_3.sdf")

#: Larger files are no worlds.
_LARGEST = 64 * 1024 * 1024


def finder(world: str, environment: Mapping[str, str] = os.environ) -> Find:
    """What finds the models that the world in a file includes."""
    folder = Path(world).parent
    known = [folder, folder / "models", folder.parent / "models"]
    known += [Path(one) for name in VARIABLES for one in _folders(environment, name)]

    def find(uri: str) -> Source | None:
        scheme, _, rest = uri.rpartition("://")
        if scheme not in ("", "model", "file") or not rest:
            return None
        return _first(found for folder in known for found in _at(folder / rest))

    return find


def world_beside(
    scene: str, name: str, environment: Mapping[str, str] = os.environ
) -> Source | None:
    """The world that a scene names, beside it or where Gazebo looks; None if it is not there."""
    folder = Path(scene).parent
    known = [folder, folder / "worlds", folder.parent / "worlds"]
    for one in _folders(environment, _WORLDS):
        known += [Path(one), Path(one) / "worlds"]
    return _first(folder / name for folder in known)


def _folders(environment: Mapping[str, str], name: str) -> list[str]:
    return [one for one in environment.get(name, "").split(os.pathsep) if one]


def _at(path: Path) -> Iterator[Path]:
    """The files that a model may be in: one itself, or a folder with one."""
    yield path
    yield from (path / name for name in _MODELS)


def _first(paths: Iterable[Path]) -> Source | None:
    """The first of some files that can be read."""
    for path in paths:
        try:
            if path.is_file() and path.stat().st_size <= _LARGEST:
                return Source(visible(str(path)), normalise(path.read_text("utf-8-sig")))
        except (OSError, ValueError):
            continue
    return None
