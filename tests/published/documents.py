"""What becomes of published configurations and scenes."""

from __future__ import annotations

import traceback
from pathlib import Path

import yaml
from msgspec import Struct

import koord
from koord.api.fitting import configuration_of_scene
from koord.runtime.configuration.scenes import read_scene
from koord.runtime.motion.world import Point
from koord.syntax.source import Source
from tests.published.expected import BAD_DOCUMENTS, codes_of
from tests.published.programs import Finding, Outcome, codes

ENDINGS = (".yml", ".yaml")

#: A file is no configuration, but is known for what it is; it is no scene.
_ELSE, _NO_SCENE = "K951", "K953"


class Document(Struct, frozen=True):
    """A file, what became of it, and what of it can be used."""

    finding: Finding
    names: tuple[str, ...] = ()  #: robots of a configuration or a scene, by their devices
    kinds: tuple[str, ...] = ()  #: their vehicles
    is_configuration: bool = False
    places: tuple[Point, ...] = ()  #: where its robots begin, if it says so
    first_pid: int = 0  #: from which its pids count

    @property
    def path(self) -> Path:
        return self.finding.path


def judged(path: Path) -> Document:
    """What becomes of a file."""
    try:
        return _judged(path)
    except Exception:
        return Document(Finding(path, Outcome.BROKEN, trouble=traceback.format_exc()))


def _judged(path: Path) -> Document:
    report = koord.check_configuration(path)
    told, wanted = codes(report.errors), codes_of(path, BAD_DOCUMENTS)
    if wanted:
        is_right = not set(wanted).isdisjoint(told)
        trouble = "" if is_right else f"it should be rejected for {' or '.join(wanted)}"
        outcome = Outcome.BAD if is_right else Outcome.REJECTED
        return Document(Finding(path, outcome, told, trouble))
    if report.configuration is not None and report.ok:
        robots = report.configuration.robots
        outcome = Outcome.WARNED if report.diagnostics else Outcome.ACCEPTED
        return Document(
            Finding(path, outcome, codes(report.diagnostics)),
            tuple(robot.vehicle.name for robot in robots),
            tuple(robot.vehicle.type_name for robot in robots),
            is_configuration=True,
            places=tuple(one.position for one in robots if one.position is not None),
            first_pid=_first_pid(path),
        )
    if _ELSE not in told:
        return Document(Finding(path, Outcome.REJECTED, told))
    try:
        scene = read_scene(Source(str(path), path.read_text(encoding="utf-8")))
    except koord.KoordError as error:
        found = codes(error.diagnostics)
        outcome = Outcome.OTHER if found == (_NO_SCENE,) else Outcome.REJECTED
        return Document(Finding(path, outcome, found))
    return Document(
        Finding(path, Outcome.SCENE, _alone(path)),
        tuple(robot.name for robot in scene.robots),
        tuple(robot.type_name for robot in scene.robots),
        places=tuple(robot.position for robot in scene.robots),
    )


def _first_pid(path: Path) -> int:
    agents = yaml.safe_load(path.read_text(encoding="utf-8")).get("agents") or [{}]
    return min(int(agent.get("pid", 0)) for agent in agents)


def _alone(path: Path) -> tuple[str, ...]:
    """The codes for which a scene needs a configuration; none if it is a run by itself."""
    try:
        configuration_of_scene(path)
    except koord.KoordError as error:
        return codes(error.diagnostics)
    return ()
