"""Vehicles as jointed bodies among all that is solid: the level ``mujoco``.

MuJoCo moves them: wheels that roll and slip, an engine behind a differential, rotors that lag,
contact of everybody with everybody and with the world. What they are told is what vehicles of the
other levels are told. All vehicles of a run share one world, an :class:`Arena`. This is the one
file that imports MuJoCo.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any, Protocol

from koord.runtime.motion.libraries import missing
from koord.runtime.motion.planning import Hindrance, Touched
from koord.runtime.motion.world import World
from koord.sim.vehicles import mjcf

try:
    import mujoco
except ImportError as error:
    raise missing("mujoco-core", "mujoco") from error

# Else it writes a file where it happens to be.
mujoco.set_mju_user_warning(warnings.warn)


class Physical(Protocol):
    """Vehicles of one device in an arena."""

    flies: bool

    @property
    def names(self) -> list[str]:
        """What their bodies are called."""
        ...

    def described(self) -> Iterable[mjcf.Described]:
        """Each of them, as the text that the model is made of."""
        ...

    def settle(self, model: Any, data: Any) -> None:
        """The model is made: find out where in it the vehicles are."""
        ...

    def act(self, data: Any, dt_s: float) -> None:
        """Drive motors and rotors for the next step."""
        ...

    def look(self, data: Any) -> None:
        """Find out where the vehicles are."""
        ...


class Arena:
    """A world with vehicles of any kinds in it; time passes when all of them have been told."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._parts: list[Physical] = []
        self._counts: dict[str, int] = {}
        self._told: set[int] = set()
        self._made: tuple[Any, Any] | None = None

    def join(self, part: Physical, kind: str, count: int) -> list[str]:
        """More vehicles; there are none when time begins to pass. Returns names for them."""
        assert self._made is None
        self._parts.append(part)
        first = self._counts.get(kind, 0)
        self._counts[kind] = first + count
        return [f"{kind}{first + k}" for k in range(count)]

    def advance(self, part: Physical, dt_s: float, steps: int) -> None:
        """Vehicles know what to do in the next steps; with the last that know it they are made."""
        self._told.add(id(part))
        if len(self._told) < len(self._parts):
            return
        self._told.clear()
        model, data = self._running()
        within = round(dt_s / mjcf.SUBSTEP_S)
        for _ in range(steps):
            for one in self._parts:
                one.act(data, dt_s)
            mujoco.mj_step(model, data, within)
            for one in self._parts:
                one.look(data)

    def touched(self, name: str) -> tuple[Touched, ...]:
        """What the vehicle of that name touches, but for the floor."""
        model, data = self._running()
        known = {
            one: Touched(Hindrance.ROBOT, k, part)
            for part in self._parts
            for k, one in enumerate(part.names)
        }
        found: dict[Touched, None] = {}
        for pair in data.contact.geom[: data.ncon]:
            bodies = [model.body(model.body_rootid[model.geom_bodyid[geom]]).name for geom in pair]
            if name not in bodies:
                continue
            geom = pair[1 - bodies.index(name)]
            other = bodies[1 - bodies.index(name)]
            what = known.get(other) or _of_world(model.geom(geom).name)
            if what is not None:
                found[what] = None
        return tuple(found)

    def _running(self) -> tuple[Any, Any]:
        if self._made is None:
            # What drives stands before what flies in the model, whoever has joined first.
            parts = sorted(self._parts, key=lambda part: part.flies)
            described = [one for part in parts for one in part.described()]
            model = mujoco.MjModel.from_xml_string(mjcf.model(self.world, described))
            data = mujoco.MjData(model)
            for part in self._parts:
                part.settle(model, data)
            self._made = model, data
        return self._made


def _of_world(name: str) -> Touched | None:
    """Something that stands in the world, by its name; None for the floor."""
    match name.split():
        case [mjcf.EDGE, _]:
            return Touched(Hindrance.EDGE)
        case [mjcf.OBSTACLE, number, *_]:
            return Touched(Hindrance.OBSTACLE, int(number))
    return None
