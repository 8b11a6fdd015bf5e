"""Physics with MuJoCo: vehicles as jointed bodies, in contact with everything: ``mujoco``.

MuJoCo moves them: wheels that roll and slip, an engine behind a differential, rotors that lag,
contact of everybody with everybody and with the world. What they are told is what vehicles of the
other levels are told. All vehicles of a run share one world, an :class:`Arena`. This is the one
file that imports MuJoCo.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from typing import Any, Protocol, assert_never

import numpy as np

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.flying import GRAVITY
from koord.runtime.motion.geometry import headings_of
from koord.runtime.motion.libraries import missing
from koord.runtime.motion.planning import Hindrance, Touched
from koord.runtime.motion.world import Box, Disc, Flat, Obstacle, Polygon, World
from koord.sim.vehicles import mjcf
from koord.sim.vehicles.contact import convex_parts
from koord.sim.vehicles.wheels import Rolling

try:
    import mujoco
except ImportError as error:
    raise missing("mujoco-core", "mujoco") from error

# Else it writes a file where it happens to be.
mujoco.set_mju_user_warning(warnings.warn)


#: MuJoCo's own steps: tyres and contacts are stiff.
SUBSTEP_S = 0.002

_WALL_M = 0.1

#: What solid things of the world are called, with a number behind: walls, and obstacles.
EDGE, OBSTACLE = "edge", "obstacle"


class Physical(Protocol):
    """Vehicles of one device in an arena."""

    flies: bool

    @property
    def names(self) -> list[str]:
        """The names of the vehicles' bodies."""
        ...

    def described(self) -> Iterable[mjcf.Described]:
        """The MJCF of each vehicle."""
        ...

    def settle(self, model: Any, data: Any) -> None:
        """Look up the vehicles in the compiled model."""
        ...

    def act(self, data: Any, dt_s: float) -> None:
        """Set the motors and rotors for the next step of control."""
        ...

    def push(self) -> None:
        """Set forces that turn with a vehicle for MuJoCo's next step of its own."""
        ...

    def look(self, data: Any) -> None:
        """Read the states of the vehicles, as far as anybody needs them before the next steps."""
        ...


class Arena:
    """A world with vehicles of any kinds; time passes when all have their commands."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._parts: list[Physical] = []
        self._counts: dict[str, int] = {}
        self._told: set[int] = set()
        self._made: tuple[Any, Any] | None = None

    def join(self, part: Physical, kind: str, count: int) -> list[str]:
        """Add vehicles, not after time has begun to pass; return their names."""
        assert self._made is None
        self._parts.append(part)
        first = self._counts.get(kind, 0)
        self._counts[kind] = first + count
        return [f"{kind}{first + k}" for k in range(count)]

    def advance(self, part: Physical, dt_s: float, steps: int) -> None:
        """Give commands to some vehicles; with the last ones the steps are made."""
        self._told.add(id(part))
        if len(self._told) < len(self._parts):
            return
        self._told.clear()
        model, data = self._running()
        within = round(dt_s / SUBSTEP_S)
        flying = [one for one in self._parts if one.flies]
        # Python has its turn before each of MuJoCo's steps only if there is something to push.
        turns, at_once = (within, 1) if flying else (1, within)
        for _ in range(steps):
            for one in self._parts:
                one.act(data, dt_s)
            for _ in range(turns):
                for one in flying:
                    one.push()
                mujoco.mj_step(model, data, at_once)
            for one in flying:
                one.look(data)
        for one in self._parts:
            if not one.flies:
                one.look(data)

    def touched(self, name: str) -> tuple[Touched, ...]:
        """The contacts of a named vehicle, except the floor."""
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
            model = mujoco.MjModel.from_xml_string(model_of(self.world, described))
            data = mujoco.MjData(model)
            for part in self._parts:
                part.settle(model, data)
            self._made = model, data
        return self._made


class PhysicalWheels:
    """Vehicles of one device whose wheels MuJoCo turns. Arrays have a row for each."""

    flies = False

    def __init__(self, told: Rolling, arena: Arena) -> None:
        """Make vehicles; ``told`` are their models without contact, at the same places."""
        self.position: Floats = told.position.copy()
        self.heading: Floats = told.heading.copy()
        self.speed: Floats = np.zeros(len(told.heading))
        # What motors are told changes as fast as it does where nothing is in the way.
        self._told, self._arena = told, arena
        self._command: Floats = np.zeros((len(told.heading), 2))
        self.names = arena.join(self, told.NAME, len(told.heading))

    def advance(self, command: Floats, dt_s: float, steps: int) -> None:
        """Advance some steps under commands, shape ``(n, 2)``."""
        self._command = command
        self._arena.advance(self, dt_s, steps)

    def touched(self, number: int) -> tuple[Touched, ...]:
        """The contacts of a vehicle."""
        return self._arena.touched(self.names[number])

    def described(self) -> Iterator[mjcf.Described]:
        for name, at, heading_rad in zip(self.names, self.position, self.heading, strict=True):
            yield self._told.described(name, at.tolist(), float(heading_rad))

    def settle(self, model: Any, data: Any) -> None:
        self._qpos, self._qvel = mjcf.coordinates(model, self.names)
        self._motors = np.array(
            [
                [model.actuator(f"{name} {one}").id for one in self._told.MOTORS]
                for name in self.names
            ]
        )

    def act(self, data: Any, dt_s: float) -> None:
        self._told.actuate(self._command, dt_s)
        data.ctrl[self._motors] = self._told.controls()

    def push(self) -> None:
        pass

    def look(self, data: Any) -> None:
        q = data.qpos[self._qpos[:, None] + np.arange(7)]
        v = data.qvel[self._qvel[:, None] + np.arange(2)]
        self.heading = headings_of(q[:, 3:])
        self.position = q[:, :3].copy()
        self.speed = np.cos(self.heading) * v[:, 0] + np.sin(self.heading) * v[:, 1]


def _of_world(name: str) -> Touched | None:
    """The owner of a geometry of the world, by its name; None for the floor."""
    what, *number = name.split() or [""]
    if what == EDGE:
        return Touched(Hindrance.EDGE)
    return Touched(Hindrance.OBSTACLE, int(number[0])) if what == OBSTACLE else None


def model_of(world: World, vehicles: Iterable[mjcf.Described]) -> str:
    """Compile the MuJoCo model of a world with vehicles."""
    bodies: list[str] = []
    tendons: list[str] = []
    actuators: list[str] = []
    for vehicle in vehicles:
        bodies += vehicle.body
        tendons += vehicle.tendons
        actuators += vehicle.actuators
    meshes, solids = _world(world)
    return "\n".join(
        [
            '<mujoco model="koord">',
            f'<option timestep="{SUBSTEP_S}" gravity="0 0 {-GRAVITY}"'
            ' cone="elliptic" impratio="10">',
            # Who touches nobody moves as if it were alone, to the last bit: each island is solved
            # for by itself. Where a solver starts would be decided for all islands together.
            '<flag island="enable" warmstart="disable"/></option>',
            "<asset>",
            *meshes,
            "</asset>",
            "<worldbody>",
            *solids,
            *bodies,
            "</worldbody>",
            "<tendon>",
            *tendons,
            "</tendon>",
            "<actuator>",
            *actuators,
            "</actuator>",
            "</mujoco>",
        ]
    )


# --- the world ------------------------------------------------------------------------------------


def _world(world: World) -> tuple[list[str], list[str]]:
    """Meshes, and what stands in the world: the floor, walls around it, obstacles."""
    (x0, y0, ground), (x1, y1, roof) = world.low, world.high
    meshes: list[str] = []
    solids = [
        f'<geom type="plane" size="0 0 1" pos="0 0 {ground!r}" '
        f'friction="{mjcf.TYRE_GRIP}" {mjcf.FLOOR}/>'
    ]
    thick = _WALL_M
    walls = (
        ((x0 - thick, y0 - thick), (x0, y1 + thick)),
        ((x1, y0 - thick), (x1 + thick, y1 + thick)),
        ((x0, y0 - thick), (x1, y0)),
        ((x0, y1), (x1, y1 + thick)),
    )
    solids += [
        _block(f"{EDGE} {k}", low, high, ground, roof) for k, (low, high) in enumerate(walls)
    ]
    for k, obstacle in enumerate(world.obstacles):
        high = min(obstacle.high_z, roof)
        if obstacle.low_z >= high:
            continue
        more, parts = _solid(f"{OBSTACLE} {k}", obstacle, obstacle.low_z, high)
        meshes += more
        solids += parts
    return meshes, solids


def _solid(
    name: str, obstacle: Obstacle, low_z: float, high_z: float
) -> tuple[list[str], list[str]]:
    match obstacle:
        case Box(low=(x0, y0, _), high=(x1, y1, _)):
            return [], [_block(name, (x0, y0), (x1, y1), low_z, high_z)]
        case Disc(centre=(x, y), radius_m=radius):
            middle = mjcf.numbers(x, y, (low_z + high_z) / 2)
            size = mjcf.numbers(radius, (high_z - low_z) / 2)
            return [], [_geom(name, "cylinder", size, middle)]
        case Polygon(corners=corners):
            meshes, parts = [], []
            for k, part in enumerate(convex_parts(corners)):
                points = " ".join(mjcf.numbers(x, y, z) for z in (low_z, high_z) for x, y in part)
                # Without a position of its own a mesh stays where its vertices are.
                meshes.append(f'<mesh name="{name} {k}" vertex="{points}"/>')
                parts.append(
                    f'<geom name="{name} {k}" type="mesh" mesh="{name} {k}" '
                    f'friction="{mjcf.BODY_GRIP}" {mjcf.SOLID}/>'
                )
            return meshes, parts
        case _:
            assert_never(obstacle)


def _block(name: str, low: Flat, high: Flat, low_z: float, high_z: float) -> str:
    (x0, y0), (x1, y1) = low, high
    size = mjcf.numbers((x1 - x0) / 2, (y1 - y0) / 2, (high_z - low_z) / 2)
    return _geom(
        name, "box", size, mjcf.numbers((x0 + x1) / 2, (y0 + y1) / 2, (low_z + high_z) / 2)
    )


def _geom(name: str, kind: str, size: str, middle: str) -> str:
    return (
        f'<geom name="{name}" type="{kind}" size="{size}" pos="{middle}" '
        f'friction="{mjcf.BODY_GRIP}" {mjcf.SOLID}/>'
    )
