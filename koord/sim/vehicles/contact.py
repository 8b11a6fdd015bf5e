"""Vehicles in contact in the plane, with each other and with walls: the level ``full``. By pymunk.

A kinematic model says which velocity a vehicle strives for; engine and tyres bring it there with
limited force, pymunk solves the contacts. Velocities are read and forces written for all vehicles
at once (pymunk's batch interface), because one call per vehicle and step would cost ten times as
much. As long as nobody can touch anything pymunk is not asked: bodies move as it moves them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import assert_never

import numpy as np

from koord.runtime.motion.angles import Numbers, greater, lesser, root, sine_cosine, unwound
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.field import GROUND_ROBOT_M
from koord.runtime.motion.libraries import missing
from koord.runtime.motion.planning import Hindrance, Touched
from koord.runtime.motion.world import Box, Disc, Flat, Obstacle, Polygon, World
from koord.sim.vehicles.room import Room
from koord.sim.vehicles.wheels import Hull, Rolling

try:
    import pymunk
    from pymunk import batch
    from pymunk.autogeometry import convex_decomposition
except ImportError as error:
    raise missing("pymunk", "sim") from error

_READ = (
    batch.BodyFields.POSITION
    | batch.BodyFields.ANGLE
    | batch.BodyFields.VELOCITY
    | batch.BodyFields.ANGULAR_VELOCITY
)
_WRITE = batch.BodyFields.FORCE | batch.BodyFields.TORQUE

#: Numbers of a body that are read: position, angle, velocity and rate.
_NUMBERS = 6

#: What tyres hold sideways, as an acceleration: dry rubber on a hall's floor, μ ≈ 0.9.
GRIP_MPS2 = 8.8

_WALL_M = 0.05


class Floor:
    """A plane with obstacles, walls and vehicles in contact.

    Time passes for all vehicles when all have their commands.
    """

    def __init__(self, world: World) -> None:
        self.space = pymunk.Space()
        self.space.iterations = 10
        self.space.collision_slop = 0.001
        self._parts: list[tuple[Colliding, slice]] = []
        self._told = 0
        self._numbers: dict[int, int] = {}
        self._known: dict[pymunk.Shape, Touched] = {}
        self._state, self._forces = batch.Buffer(), batch.Buffer()
        self._force: Floats = np.zeros((1, 3))
        #: States of bodies, shape ``(n, 6)``, and each group's part of them.
        self.bodies: Floats = np.zeros((0, _NUMBERS))
        self._views: list[tuple[Colliding, Floats]] = []
        self._is_behind = False  #: pymunk has not been told where bodies are
        self.radius_m = 0.0  #: of a circle about each body
        self.room = Room(self._add_world(world))

    def join(self, vehicles: Colliding, bodies: list[int]) -> None:
        """Add vehicles, by the numbers of their bodies; not after time has begun to pass."""
        first = len(self._numbers)
        self._numbers |= {body: first + k for k, body in enumerate(bodies)}
        self._parts.append((vehicles, slice(first, len(self._numbers))))
        # pymunk lists the body of the world as well, behind the vehicles: no force acts on it.
        self._force = np.zeros((len(self._numbers) + 1, 3))
        self.radius_m = max(self.radius_m, vehicles.hull.radius_m)
        self.bodies = self._read()[:-1].copy()
        self._views = [(members, self.bodies[rows]) for members, rows in self._parts]

    def advance(self, dt_s: float, steps: int) -> None:
        """Give commands to some vehicles; with the last ones the steps are made."""
        self._told += 1
        if self._told < len(self._parts):
            return
        self._told = 0
        if self.room.suffices(self.bodies, self.radius_m, dt_s * steps, GRIP_MPS2):
            for vehicles, state in self._views:
                vehicles.roam(state, dt_s, steps)
            self._is_behind = True
            return
        if self._is_behind:
            self._write()
        for _ in range(steps):
            state = self._read()
            for vehicles, rows in self._parts:
                vehicles.push(state[rows], self._force[rows], dt_s)
            self._forces.set_float_buf(self._force)
            batch.set_space_bodies(self.space, _WRITE, self._forces)
            self.space.step(dt_s)
        self.bodies[:] = self._read()[:-1]
        for vehicles, state in self._views:
            vehicles.show(state)

    def is_of(self, vehicles: Colliding) -> bool:
        """Return whether all bodies are those of some vehicles."""
        return [members for members, _ in self._parts] == [vehicles]

    def state_of(self, vehicles: Colliding) -> Floats:
        """The states of some vehicles' bodies, shape ``(n, 6)``."""
        return next(state for members, state in self._views if members is vehicles)

    def roamed(self, left_m: float) -> None:
        """Note steps that nothing touched, and how far vehicles may still move without a look."""
        self.room.left_m, self._is_behind = left_m, True

    def touched(self, body: pymunk.Body) -> tuple[Touched, ...]:
        """The contacts of a vehicle."""
        found: dict[Touched, None] = {}

        def note(arbiter: pymunk.Arbiter) -> None:
            for shape in arbiter.shapes:
                if shape.body is not body:
                    found[self._known[shape]] = None

        body.each_arbiter(note)
        return tuple(found)

    def know(self, shape: pymunk.Shape, as_what: Touched) -> None:
        """Register the owner of a shape."""
        self._known[shape] = as_what

    def _read(self) -> Floats:
        self._state.clear()
        batch.get_space_bodies(self.space, _READ, self._state)
        return np.frombuffer(self._state.float_buf(), dtype=np.float64).reshape(-1, _NUMBERS)

    def _write(self) -> None:
        """Tell pymunk where bodies are, and how they move."""
        told: Floats = np.zeros((len(self.bodies) + 1, _NUMBERS))  # the world's stays at rest
        told[:-1] = self.bodies
        self._forces.set_float_buf(told)
        batch.set_space_bodies(self.space, _READ, self._forces)
        self._is_behind = False

    def _add_world(self, world: World) -> Floats:
        """Add what stands still, and return boxes around each part of it, shape ``(k, 4)``."""
        (x0, y0, _), (x1, y1, _) = world.low, world.high
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        ground = self.space.static_body
        shapes: list[pymunk.Shape] = [
            pymunk.Segment(ground, a, b, _WALL_M)
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        ]
        for shape in shapes:
            self.know(shape, Touched(Hindrance.EDGE))
        for number, obstacle in enumerate(world.obstacles):
            if obstacle.low_z < world.ground + GROUND_ROBOT_M and obstacle.high_z > world.ground:
                solids = _solid(obstacle, ground)
                for solid in solids:
                    self.know(solid, Touched(Hindrance.OBSTACLE, number))
                shapes += solids
        for shape in shapes:
            shape.friction, shape.elasticity = 0.4, 0.1
        self.space.add(*shapes)
        boxes = [shape.cache_bb() for shape in shapes]
        return np.array([(box.left, box.bottom, box.right, box.top) for box in boxes])


class Colliding:
    """Vehicles of one device with bodies in contact, on a floor shared with others."""

    def __init__(self, model: Rolling, hull: Hull, floor: Floor) -> None:
        self.model, self.hull, self._floor = model, hull, floor
        self._command: Floats = np.zeros((len(model.heading), 2))
        self._inertia = hull.inertia_kgm2
        self._bodies = [self._add(floor, k) for k in range(len(model.heading))]
        floor.join(self, [body.id for body in self._bodies])

    @property
    def position(self) -> Floats:
        return self.model.position

    @property
    def heading(self) -> Floats:
        return self.model.heading

    @property
    def speed(self) -> Floats:
        return self.model.speed

    def advance(self, command: Floats, dt_s: float, steps: int) -> None:
        """Advance some steps under commands, shape ``(n, 2)``."""
        self._command = command
        self._floor.advance(dt_s, steps)

    def touched(self, number: int) -> tuple[Touched, ...]:
        """The contacts of a vehicle."""
        return self._floor.touched(self._bodies[number])

    def push(self, state: Floats, force: Floats, dt_s: float) -> None:
        """Write the forces of engine and tyres for the next step into an array ``(n, 3)``.

        ``state`` has positions, angles, velocities and rates of the bodies: ``(n, 6)``.
        """
        # What a collision has taken away is gone: the engine starts from the speed there is.
        self.model.take(self._ahead(state), state[:, 5])
        self.model.actuate(self._command, dt_s)
        self._pull(state, force, dt_s)

    def roam(self, state: Floats, dt_s: float, steps: int) -> None:
        """Make steps in which nothing is touched, and show where they end; writes to ``state``."""
        force: Floats = np.empty((len(state), 3))
        for _ in range(steps):
            self.push(state, force, dt_s)
            state[:] = np.column_stack(moved(self.hull, dt_s, list(state.T), list(force.T)))
        self.show(state)

    def show(self, state: Floats) -> None:
        """Set the positions of the vehicles from the bodies' states."""
        model = self.model
        x, y, model.heading = axle(self.hull, list(state.T))
        model.position[:, 0], model.position[:, 1] = x, y
        model.take(ahead(list(state.T)), state[:, 5])

    def _ahead(self, state: Floats) -> Floats:
        found: Floats = ahead(list(state.T))
        return found

    def _pull(self, state: Floats, force: Floats, dt_s: float) -> None:
        """Write the forces that bring bodies to the velocities of the model."""
        speed, turn = self.model.speed, self.model.turning()
        force[:] = np.column_stack(tyres(self.hull, dt_s, list(state.T), speed, turn))

    def _add(self, floor: Floor, number: int) -> pymunk.Body:
        hull = self.hull
        body = pymunk.Body(hull.mass_kg, self._inertia)
        x, y, _ = self.position[number].tolist()
        body.angle = heading = float(self.heading[number])
        ahead = hull.middle_m
        body.position = (x + ahead * math.cos(heading), y + ahead * math.sin(heading))
        shape: pymunk.Shape = (
            pymunk.Circle(body, hull.length_m / 2)
            if hull.is_disc
            else pymunk.Poly.create_box(body, (hull.length_m, hull.width_m))
        )
        shape.friction, shape.elasticity = 0.4, 0.1
        floor.space.add(body, shape)
        floor.know(shape, Touched(Hindrance.ROBOT, number, self))
        return body


# Of arrays, or of lanes of machine code, the same to the last bit; a state is position, angle,
# velocity and rate of a body: six columns.


def ahead(state: Sequence[Numbers]) -> Numbers:
    """The component of velocities along the vehicles: the speed of their axles."""
    sine, cosine = sine_cosine(state[2])
    return cosine * state[3] + sine * state[4]


def tyres(
    hull: Hull, dt_s: Numbers, state: Sequence[Numbers], speed: Numbers, turn: Numbers
) -> tuple[Numbers, Numbers, Numbers]:
    """The forces and the torque that bring bodies to a speed of the axle, and a rate."""
    # The velocity that the wheels allow the middle of the body, where it points next.
    sine, cosine = sine_cosine(state[2] + turn * dt_s)
    aside = turn * hull.middle_m
    gain_x = speed * cosine - aside * sine - state[3]
    gain_y = speed * sine + aside * cosine - state[4]
    size = root(gain_x * gain_x + gain_y * gain_y)
    held = lesser(GRIP_MPS2 * dt_s / greater(size, 1e-12), 1.0)
    pull = held * (hull.mass_kg / dt_s)
    return pull * gain_x, pull * gain_y, held * (turn - state[5]) * (hull.inertia_kgm2 / dt_s)


def moved(
    hull: Hull, dt_s: Numbers, state: Sequence[Numbers], force: Sequence[Numbers]
) -> list[Numbers]:
    """States after a step that nothing touches, as pymunk makes it: they move, then are pushed."""
    places = [place + rate * dt_s for place, rate in zip(state[:3], state[3:], strict=True)]
    shares = 1.0 / hull.mass_kg, 1.0 / hull.mass_kg, 1.0 / hull.inertia_kgm2
    # There is no gravity in the plane; but a zero that is added makes one zero of both.
    gains = [(0.0 + share * push) * dt_s for share, push in zip(shares[:2], force[:2], strict=True)]
    gains.append(force[2] * shares[2] * dt_s)
    return [*places, *(rate + gain for rate, gain in zip(state[3:], gains, strict=True))]


def axle(hull: Hull, state: Sequence[Numbers]) -> tuple[Numbers, Numbers, Numbers]:
    """Where the axles are, and their headings."""
    sine, cosine = sine_cosine(state[2])
    x, y = state[0] - hull.middle_m * cosine, state[1] - hull.middle_m * sine
    return x, y, unwound(state[2])


def _solid(obstacle: Obstacle, ground: pymunk.Body) -> list[pymunk.Shape]:
    match obstacle:
        case Disc(centre=centre, radius_m=radius):
            return [pymunk.Circle(ground, radius, centre)]
        case Box(corners=corners):
            return [pymunk.Poly(ground, corners)]
        case Polygon(corners=corners):
            return [pymunk.Poly(ground, part) for part in convex_parts(corners)]
        case _:
            assert_never(obstacle)


def convex_parts(corners: tuple[Flat, ...]) -> list[list[Flat]]:
    """Convex polygons that cover a simple one, whichever way round it is, and nothing else."""
    ring = [*corners, corners[0]]
    if _turns_right(corners):
        ring.reverse()
    return [[(x, y) for x, y in part] for part in convex_decomposition(ring, 0.0)]


def _turns_right(corners: tuple[Flat, ...]) -> bool:
    after = (*corners[1:], corners[0])
    area = math.fsum(a[0] * b[1] - b[0] * a[1] for a, b in zip(corners, after, strict=True))
    return area < 0
