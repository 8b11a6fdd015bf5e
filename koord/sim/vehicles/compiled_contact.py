"""Machine code of what engines and tyres do in contact: many vehicles side by side.

It is the text of :mod:`.contact`, :mod:`.bicycles` and :mod:`.rovers`, on lanes instead of
arrays; so forces are equal to the last bit, and which of the two drives is no matter of a run.
Tests hold them together. Bodies lie one after the other, as pymunk has them: lanes are gathered
from there. Those that are left over are once more the last vehicle.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache

import numpy as np

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, DifferentialDrive
from koord.runtime.motion.libraries import missing
from koord.sim.vehicles import bicycles, rovers
from koord.sim.vehicles.bicycles import Bicycles
from koord.sim.vehicles.compiled import address
from koord.sim.vehicles.contact import Colliding, Floor, ahead, axle, moved, tyres
from koord.sim.vehicles.rovers import Differentials
from koord.sim.vehicles.wheels import Hull, Rolling

try:
    from koord.machine.code import BYTES, F64, I32, I64, Code, Ir, new_module, word
    from koord.machine.kept import kept
    from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes, widest
except ImportError as error:
    raise missing("llvmlite", "fast") from error

#: Numbers of a body, of a command, of a force, and of what is shown.
_BODY, _COMMAND, _FORCE, _SHOWN = 6, 2, 3, 4

_width = cache(widest)


class CompiledColliding(Colliding):
    """Vehicles with bodies in contact, by machine code that is made once in a process."""

    def __init__(self, model: Rolling, hull: Hull, floor: Floor) -> None:
        super().__init__(model, hull, floor)
        self._dt: Floats = np.zeros(1)

    def show(self, state: Floats) -> None:
        self._see(self._shown(state), state)

    def _see(self, shown: Floats, state: Floats) -> None:
        """Let vehicles be where they are shown."""
        model = self.model
        model.position[:, :2] = shown[:, :2]
        model.heading = shown[:, 2].copy()
        model.take(shown[:, 3].copy(), state[:, 5])

    def _shown(self, state: Floats) -> Floats:
        """Positions, headings and speeds, shape ``(n, 4)``."""
        shown = np.empty((len(state), _SHOWN))
        _shower(self.hull, _width())(address(state), address(shown), len(state))
        return shown

    def _ahead(self, state: Floats) -> Floats:
        return self._shown(state)[:, 3].copy()

    def _pull(self, state: Floats, force: Floats, dt_s: float) -> None:
        self._dt[0] = dt_s
        told = np.stack([self.model.speed, self.model.turning()])
        arrays = (self._dt, state, told[0], told[1], force)
        _puller(self.hull, _width())(*map(address, arrays), len(state))


class CompiledWheels(CompiledColliding, ABC):
    """Vehicles whose engines are in the same machine code as their tyres."""

    def __init__(
        self, model: Rolling, hull: Hull, floor: Floor, body: Car | DifferentialDrive
    ) -> None:
        super().__init__(model, hull, floor)
        self.code = _roamer(body, hull, _width())  #: of steps that nothing touches
        self.floor = floor
        self._own: tuple[Floats, ...] = tuple(np.empty(len(model.heading)) for _ in range(2))

    @property
    @abstractmethod
    def steering(self) -> Floats:
        """What is kept of vehicles beside their bodies, shape ``(n,)``, to be written over."""

    def own_model(self) -> Rolling:
        """The model, with headings and speeds in arrays that stay, to be written over."""
        model = self.model
        for own, given in zip(self._own, (model.heading, model.speed), strict=True):
            if own is not given:
                own[:] = given
        model.heading, model.speed = self._own
        return model

    def roamed(self, command: Floats, left_m: float) -> None:
        """Note steps that nothing touched and that machine code has made.

        Vehicles were commanded so last, and may still move so far without a look.
        """
        self._command = command
        self.model.take(self.model.speed, self.floor.state_of(self)[:, 5])
        self.floor.roamed(left_m)

    def roam(self, state: Floats, dt_s: float, steps: int) -> None:
        self._dt[0] = dt_s
        command = np.ascontiguousarray(self._command)
        shown = np.empty((len(state), _SHOWN))
        arrays = (self._dt, state, command, self.steering, shown)
        self.code(*map(address, arrays), len(state), steps)
        self._see(shown, state)


class CompiledCars(CompiledWheels):
    """Cars, whose steering angles are kept."""

    def __init__(self, model: Bicycles, hull: Hull, floor: Floor) -> None:
        super().__init__(model, hull, floor, model.car)
        self._cars = model
        self._steering: Floats = model.steering.copy()

    @property
    def steering(self) -> Floats:
        cars = self._cars
        if cars.steering is not self._steering:
            self._steering[:] = cars.steering
            cars.steering = self._steering
        return self._steering

    def push(self, state: Floats, force: Floats, dt_s: float) -> None:
        cars = self._cars
        self._dt[0] = dt_s
        command = np.ascontiguousarray(self._command)
        # As in the reference, arrays of before stay what they were.
        cars.speed, cars.steering = cars.speed.copy(), cars.steering.copy()
        arrays = (self._dt, state, command, cars.speed, cars.steering, force)
        _pusher(cars.car, self.hull, _width())(*map(address, arrays), len(state))


class CompiledRovers(CompiledWheels):
    """Differential drives; how fast their wheels are is known of how their bodies move."""

    def __init__(self, model: Differentials, hull: Hull, floor: Floor) -> None:
        super().__init__(model, hull, floor, model.body)
        self._nothing: Floats = np.zeros(len(model.heading))

    @property
    def steering(self) -> Floats:
        return self._nothing


def compiled(model: Rolling, hull: Hull, floor: Floor) -> CompiledColliding:
    """Vehicles of a model, with as much of it in machine code as there is."""
    if isinstance(model, Bicycles):
        return CompiledCars(model, hull, floor)
    if isinstance(model, Differentials):
        return CompiledRovers(model, hull, floor)
    return CompiledColliding(model, hull, floor)


# What is for contact is compiled when it is used: mostly nobody touches anything.


@cache
def _pusher(car: Car, hull: Hull, width: int) -> Callable[..., int]:
    """Compile a step of engine and tyres, of ``width`` cars at a time.

    The function takes the addresses of the time of a step, of states, ``(n, 6)``, and commands,
    ``(n, 2)``, of speeds and steering angles, which it replaces, and of the forces, ``(n, 3)``;
    and n.
    """
    code = kept("contact", (car, hull, width), lambda: _pushing(car, hull, width))
    return code.function("push", 7)


def _pushing(car: Car, hull: Hull, width: int) -> Ir:
    module = new_module("contact")
    code = Code(module, "push", [BYTES] * 6 + [I64], I64)
    dt_at, state_at, command_at, speed_at, steering_at, force_at, count = code.arguments
    dt_s = Lanes(code, width).spread(code.get(dt_at, 0, F64))
    with _blocks(code, count, width) as block:
        state, command = block.get(state_at, _BODY), block.get(command_at, _COMMAND)
        (steering,) = block.get(steering_at, 1)
        speed, steering, forces = _pushed(car, hull, dt_s, state, command, steering)
        block.put(speed_at, [speed])
        block.put(steering_at, [steering])
        block.put(force_at, forces)
    code.b.ret(word(0))
    return module


@cache
def _roamer(body: Car | DifferentialDrive, hull: Hull, width: int) -> Callable[..., int]:
    """Compile steps that nothing touches, of ``width`` vehicles at a time.

    The function takes the addresses of the time of a step, of states, ``(n, 6)``, commands,
    ``(n, 2)``, and what else is kept of each (of cars their steering angles), and of what vehicles
    look like then, ``(n, 4)``; n, and the number of steps. It replaces states and what is kept.
    """
    code = kept("roaming", (body, hull, width), lambda: _roaming(body, hull, width))
    return code.function("roam", 7)


def _roaming(body: Car | DifferentialDrive, hull: Hull, width: int) -> Ir:
    module = new_module("roaming")
    code = Code(module, "roam", [BYTES] * 5 + [I64] * 2, I64)
    dt_at, state_at, command_at, kept_at, shown_at, count, steps = code.arguments
    lanes = Lanes(code, width)
    dt_s = lanes.spread(code.get(dt_at, 0, F64))
    with _blocks(code, count, width) as block:
        command = block.get(command_at, _COMMAND)

        def step(values: list[Ir]) -> list[Ir]:
            *state, kept_one = (Lane(lanes, value) for value in values)
            _, kept_one, forces = _pushed(body, hull, dt_s, state, command, kept_one)
            return [value.ir for value in (*moved(hull, dt_s, state, forces), kept_one)]

        begun = [*block.get(state_at, _BODY), *block.get(kept_at, 1)]
        ended = code.repeated(steps, [value.ir for value in begun], step)
        *state, kept_one = (Lane(lanes, value) for value in ended)
        block.put(state_at, state)
        block.put(kept_at, [kept_one])
        block.put(shown_at, [*axle(hull, state), ahead(state)])
    code.b.ret(word(0))
    return module


def _pushed(
    body: Car | DifferentialDrive,
    hull: Hull,
    dt_s: Lane,
    state: list[Lane],
    command: list[Lane],
    kept_one: Lane,
) -> tuple[Lane, Lane, tuple[Lane, Lane, Lane]]:
    """Speeds and what is kept under commands, and the forces of engine and tyres."""
    if isinstance(body, Car):
        speed, kept_one = bicycles.actuated(body, dt_s, command, ahead(state), kept_one)
        turn = bicycles.bends(body, speed, kept_one)
    else:
        wheels = rovers.wheels(body, ahead(state), state[5])
        wheels = rovers.actuated(body, dt_s, command, wheels)
        speed, turn = rovers.speed_and_turn(body, wheels)
    return speed, kept_one, tyres(hull, dt_s, state, speed, turn)


@cache
def _puller(hull: Hull, width: int) -> Callable[..., int]:
    """Compile what tyres do in a step, of ``width`` vehicles at a time.

    The function takes the addresses of the time of a step, of states, ``(n, 6)``, of speeds and
    rates, and of the forces, ``(n, 3)``; and n.
    """
    return kept("tyres", (hull, width), lambda: _pulling(hull, width)).function("pull", 6)


def _pulling(hull: Hull, width: int) -> Ir:
    module = new_module("tyres")
    code = Code(module, "pull", [BYTES] * 5 + [I64], I64)
    dt_at, state_at, speed_at, turn_at, force_at, count = code.arguments
    dt_s = Lanes(code, width).spread(code.get(dt_at, 0, F64))
    with _blocks(code, count, width) as block:
        (speed,), (turn,) = block.get(speed_at, 1), block.get(turn_at, 1)
        block.put(force_at, tyres(hull, dt_s, block.get(state_at, _BODY), speed, turn))
    code.b.ret(word(0))
    return module


@cache
def _shower(hull: Hull, width: int) -> Callable[..., int]:
    """Compile what bodies look like to programs: x, y, heading and speed, ``(n, 4)``, of states."""
    return kept("axles", (hull, width), lambda: _showing(hull, width)).function("show", 3)


def _showing(hull: Hull, width: int) -> Ir:
    module = new_module("axles")
    code = Code(module, "show", [BYTES] * 2 + [I64], I64)
    state_at, shown_at, count = code.arguments
    with _blocks(code, count, width) as block:
        state = block.get(state_at, _BODY)
        block.put(shown_at, [*axle(hull, state), ahead(state)])
    code.b.ret(word(0))
    return module


class _Block:
    """Cars side by side, by their numbers in each lane."""

    def __init__(self, code: Code, lanes: Lanes, numbers: Sequence[Ir]) -> None:
        self._code, self._lanes, self._numbers = code, lanes, numbers

    def get(self, start: Ir, columns: int) -> list[Lane]:
        """What they have in an array with so many columns."""
        found = [self._lanes.constant(0.0).ir] * columns
        for lane, number in enumerate(self._numbers):
            for column in range(columns):
                value = self._code.get(start, self._offset(number, columns, column), F64)
                place = I32(lane)
                found[column] = self._code.b.insert_element(found[column], value, place)
        return [Lane(self._lanes, vector) for vector in found]

    def put(self, start: Ir, values: Sequence[Lane]) -> None:
        """Put numbers into an array that has as many columns."""
        for lane, number in enumerate(self._numbers):
            for column, value in enumerate(values):
                single = self._code.b.extract_element(value.ir, I32(lane))
                self._code.put(start, self._offset(number, len(values), column), single)

    def _offset(self, number: Ir, columns: int, column: int) -> Ir:
        row = self._code.b.mul(number, word(columns * DOUBLE_BYTES))
        return self._code.b.add(row, word(column * DOUBLE_BYTES))


@contextmanager
def _blocks(code: Code, count: Ir, width: int) -> Iterator[_Block]:
    """A loop over cars, so many at a time."""
    b = code.b
    last = b.sub(count, word(1))
    with code.loop(word(0), b.udiv(b.add(last, word(width)), word(width))) as block:
        first = b.mul(block, word(width))
        numbers = []
        for lane in range(width):
            number = b.add(first, word(lane))
            numbers.append(b.select(b.icmp_signed("<", number, last), number, last))
        yield _Block(code, Lanes(code, width), numbers)
