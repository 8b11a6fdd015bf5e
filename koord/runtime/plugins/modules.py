"""Modules of programs that a lab's own things serve: a battery, a gripper, a camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Protocol

from msgspec import Struct

from koord.runtime.drivers.setpoints import Sensed
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.world import World
from koord.runtime.plugins.calls import Guarded, PlugInError
from koord.runtime.robot import Robot
from koord.runtime.shapes import (
    Array,
    Enumeration,
    Record,
    Scalar,
    ScalarKind,
    Shape,
    ShapeError,
    from_plain,
    to_plain,
)
from koord.runtime.shapes import Sequence as ListOf

#: How long a call may take.
_LIMIT_S = 0.2


class ModuleSite(Struct, frozen=True):
    """What a module is told of the robot that has it."""

    pid: int
    world: World
    body: Body
    seed: int
    is_simulated: bool  #: the vehicle is; nothing real is to be touched
    options: Any  #: its own


class OwnModule(Protocol):
    """What serves the ports of a module of a program, on one robot."""

    def read(self, sensed: Sensed, now_s: float) -> Mapping[str, Any]:
        """The latest readings of its sensors, by name; positions are three numbers.

        ``sensed`` is where the robot is. It does not wait for anything.
        """
        ...

    def act(self, port: str, value: Any, now_s: float) -> None:
        """Take the new value of an actuator, without waiting for anything."""

    def close(self) -> None:
        """Let go of it: the robot stops here."""


class OwnModuleType(Protocol):
    """What makes the modules of one name: a class, or a function with these facts."""

    OPTIONS: ClassVar[type[Struct]]
    SENSORS: ClassVar[tuple[str, ...]]  #: by their names in programs
    ACTUATORS: ClassVar[tuple[str, ...]]

    def __call__(self, site: ModuleSite) -> OwnModule: ...


class Served(Struct):
    """A module of a program, and what serves it."""

    name: str  #: in the program
    what: str  #: what it is called, for people
    own: OwnModule
    sensors: tuple[str, ...]
    actuators: tuple[str, ...]
    calls: Guarded


class ServedModules:
    """The modules of one robot that are served. ``troubles`` are those that fail, by name."""

    def __init__(self, served: Mapping[str, tuple[str, OwnModuleType, OwnModule]]) -> None:
        self.troubles: dict[str, PlugInError] = {}
        self._served = [
            Served(
                name,
                (what := f"the module {called}, which serves {name},"),
                own,
                tuple(f"{name}_{port}" for port in made.SENSORS),
                tuple(f"{name}_{port}" for port in made.ACTUATORS),
                Guarded(what, _LIMIT_S),
            )
            for name, (called, made, own) in served.items()
        ]
        self._sent: dict[str, Any] = {}

    def __contains__(self, port: str) -> bool:
        return any(port in one.sensors or port in one.actuators for one in self._served)

    def read(
        self, program: type[Robot], robots: int, sensed: Sensed, now_s: float
    ) -> dict[str, Any]:
        """The readings of all sensors of a program that are served."""
        found: dict[str, Any] = {}
        for one in self._served:
            names = [name for name in one.sensors if name in program.SENSORS]
            if names:
                with_trouble = self._tried(one, lambda one=one: one.own.read(sensed, now_s))
                found.update(self._values(one, names, program, robots, with_trouble))
        return found

    def act(self, robot: Robot, now_s: float) -> None:
        """Pass on what actuators say that they did not say before."""
        held = vars(robot)
        for one in self._served:
            for name in one.actuators:
                value = held.get(name)
                if value is None or name not in robot.PORTS or self._sent.get(name) == value:
                    continue
                self._sent[name] = value
                port, plain = name.removeprefix(f"{one.name}_"), to_plain(robot.PORTS[name], value)
                self._tried(
                    one, lambda one=one, port=port, plain=plain: one.own.act(port, plain, now_s)
                )

    def close(self) -> None:
        """Let go of all."""
        for one in self._served:
            self._tried(one, one.own.close)

    def _tried(self, one: Served, call: Any) -> Any:
        """Call a module; what it does wrong is kept until it does better."""
        try:
            answer = one.calls.call(call)
        except PlugInError as error:
            self.troubles[one.name] = error
            return None
        self.troubles.pop(one.name, None)
        return answer

    def _values(
        self, one: Served, names: list[str], program: type[Robot], robots: int, answer: Any
    ) -> Iterator[tuple[str, Any]]:
        """Yield what a module reads as values of a program; nothing for what is none."""
        if one.name in self.troubles:
            return
        for name in names:
            port = name.removeprefix(f"{one.name}_")
            try:
                if not isinstance(answer, Mapping):
                    raise ShapeError(f"answered {answer!r:.60}")
                if port not in answer:
                    raise ShapeError(f"said nothing of {port}")
                yield (
                    name,
                    from_plain(
                        program.PORTS[name], _plain(program.PORTS[name], answer[port]), robots
                    ),
                )
            except ShapeError as error:
                story = str(error)
                if not story.startswith(("answered", "said")):
                    story = f"said {answer[port]!r:.60} of {port}: {error}"
                cure = f"read() answers a mapping with {', '.join(one.sensors)}".replace(
                    f"{one.name}_", ""
                )
                self.troubles[one.name] = PlugInError(one.what, story, cure)
                return


def _plain(shape: Shape, value: Any) -> Any:
    """A value as lists and numbers; members of enumerations may be named."""
    match shape, value:
        case Scalar(kind=ScalarKind.FLOAT), int() if not isinstance(value, bool):
            return float(value)
        case Enumeration(members=members), str() if value in members:
            return members.index(value)
        case Record(fields=fields), tuple() | list() if len(value) == len(fields):
            return [_plain(one, part) for one, part in zip(fields, value, strict=True)]
        case ((ListOf(element=element) | Array(element=element)), tuple() | list()):
            return [_plain(element, part) for part in value]
        case _:
            return value
