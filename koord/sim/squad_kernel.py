"""Machine code of whole ticks of a squad of drones: automata, references, control, flight.

What :class:`.DroneSquad` does in one tick after the other, in one call for as many as nobody looks
at in between. It is put together of the machine code of :mod:`.compiled_flying` and of
:mod:`.compiled`, so that whatever comes of it is equal to the last bit. Tests hold them together.

Squads whose measurements, commands or air are drawn or late are not of this kind: what happens to
them comes from generators of NumPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from msgspec import Struct

from koord.machine.code import BYTES, I64, Code, Ir, new_module, word
from koord.machine.kept import kept
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes, widest
from koord.runtime.motion.arrays import Bools, Floats, Ints, lengths
from koord.runtime.motion.bodies import Drone
from koord.runtime.motion.group import TICK_S, Group
from koord.sim.disturbances import Disturbances
from koord.sim.run_log import tilts_of
from koord.sim.squads import STEP_S, STEPS, Seed, SquadSetup
from koord.sim.vehicles.compiled import (
    STATE_ROWS,
    TOLD_ROWS,
    block_code,
    constants,
    fly_all,
    parts,
)
from koord.sim.vehicles.compiled_automata import AUTOMATA, Table, arrays_of, numbers_of
from koord.sim.vehicles.compiled_flying import (
    ARRAYS,
    CONSTANTS,
    CompiledFlying,
    OneDrone,
)
from koord.sim.vehicles.quadrotors import FlightState, Quadrotors

#: What ticks are given besides what references are: times of ticks, and blocks of drones' states.
_MORE = ("times", "places", "short", "told", "flight", "tilts", "one", "other")

#: References are given their position and send what they ask for by arrays of this kernel.
TABLE = (*ARRAYS, *_MORE)


class SquadArrays(Struct, frozen=True):
    """Arrays of a squad in the order of :data:`TABLE`, and those of them that ticks write over."""

    whole: tuple[Any, ...]
    written: tuple[Any, ...]
    tilts: Floats


def is_undisturbed(disturbances: Disturbances) -> bool:
    """Return whether measurements are exact and at once, commands too, and the air moves evenly."""
    positioning, wind = disturbances.positioning, disturbances.wind
    return (
        positioning.noise_m == positioning.heading_noise_rad == 0
        and not positioning.rate_hz
        and disturbances.actuation_delay_s == 0
        and wind.gust_mps == 0
    )


class FusedDrones:
    """A squad of drones whose ticks are made by machine code, several in one call."""

    #: Where in the table of arrays those stand that are others at each tick.
    moving = tuple(map(TABLE.index, ("times", "places", "short")))
    table_size = len(TABLE)

    def __init__(self, setup: SquadSetup) -> None:
        drone, start = setup.model.body, np.ascontiguousarray(setup.start)
        assert isinstance(drone, Drone)
        assert is_undisturbed(setup.model.disturbances)
        count, ground_m = len(start), setup.engines.world.ground
        self.group, self.flying = setup.group, CompiledFlying(setup.group, start)
        self.vehicles = Quadrotors(drone, start, ground_m)
        self.position = start.copy()  #: of drones, shape ``(n, 3)``; never written over
        self._heading: Floats = np.zeros(count)  # drones keep their noses along x
        self._constants: Floats = np.empty(len(CONSTANTS))
        # What drones are told, and last the air; a zero that is added makes one zero of both.
        told: Floats = np.empty((TOLD_ROWS, count))
        told[-3:] = np.array(setup.model.disturbances.wind.mean_mps)[:, None] + 0.0
        flight = np.array(
            constants(drone, self.vehicles.gains, ground_m, STEP_S, STEPS), dtype=np.float64
        )
        #: States are in these in turn: that which counts comes first.
        self._blocks = [np.empty((STATE_ROWS, count)) for _ in range(2)]
        self._states = [_state(block) for block in self._blocks]
        self._table = Table(len(TABLE))
        #: Of what roll and pitch are worked out: tangents, as quotients, and a sine.
        self._tilts: Floats = np.empty((3, count))
        self._fixed = told, flight, self._tilts
        self._times: Floats = np.empty(2)
        #: How far drones are from the ends of their routes, and how often these had changed then.
        self._short: tuple[Floats, int] | None = None
        self._fly = ticking_code(widest())

    def tick(self, now_s: float) -> None:
        self.ticks([now_s])

    def reseed(self, noise: Sequence[Seed], wind: Sequence[Seed]) -> None:
        """Nothing that is left to chance disturbs these."""

    def ticks(self, times_s: Sequence[float]) -> list[Floats]:
        """Make a tick at each time, and return where drones are after it, shape ``(n, 3)``."""
        if not self.group.targets:
            return self._flown(times_s)
        found: list[Floats] = []
        while len(found) < len(times_s):
            left = times_s[len(found) :]
            self.plan(left[0])
            found += self._flown(left[:1] if self.group.targets else left)
        return found

    def plan(self, now_s: float) -> None:
        """Plan ways to targets, as the next tick does first."""
        if self.group.targets:
            self.group.plan(self.flying.origin(self.position), self._heading, now_s)

    def _flown(self, times_s: Sequence[float]) -> list[Floats]:
        """Make ticks for which nothing is to be planned."""
        vehicles, count = self.vehicles, len(self.position)
        if vehicles.state is not self._states[0]:  # somebody has set it, or it is the first
            self._blocks[0][:] = np.vstack(parts(vehicles.state))
            vehicles.state = self._states[0]
        ticks = len(times_s)
        self._constants[:] = self.flying.constants(times_s[0], TICK_S)
        if ticks > len(self._times):
            self._times = np.empty(ticks)
        self._times[:ticks] = times_s
        # Places after each tick, and how far drones are from their ends after the last.
        given: Floats = np.empty((3 * ticks + 1) * count)
        size = 3 * ticks * count
        places, short = given[:size].reshape(ticks, count, 3), given[size:]
        rest, one, other = self.flying.rest, *self._blocks
        self._table.point_to(0, self._constants, rest, rest, rest, *self.flying.arrays())
        self._table.point_to(len(ARRAYS), self._times, given, given, *self._fixed, one, other)
        self._table.shift(len(ARRAYS) + _MORE.index("short"), DOUBLE_BYTES * size)
        self._fly(*(self._table.address, count, self.group.routes.s.shape[1], ticks, STEPS))
        if ticks % 2:
            self._blocks.reverse()
            self._states.reverse()
            vehicles.state = self._states[0]
        self.position, self._short = places[-1], (short, self.group.routes.changes)
        return list(places)

    @property
    def code(self) -> Callable[..., int]:
        """The machine code of ticks."""
        return self._fly

    @property
    def is_settled(self) -> bool:
        """Whether the state of flight is that of the last tick."""
        return self.vehicles.state is self._states[0]

    def arrays(self, now_s: float) -> SquadArrays:
        """The arrays that ticks are given, if those that are other ones at each are left out."""
        self._constants[:] = self.flying.constants(now_s, TICK_S)
        rest, (told, _, tilts) = self.flying.rest, self._fixed
        group = self.flying.arrays()
        one, other = self._blocks
        written = rest, *group[: 2 + len(AUTOMATA)], told, tilts, one
        whole = (
            self._constants,
            rest,
            rest,
            rest,
            *group,
            rest,
            rest,
            rest,
            *self._fixed,
            one,
            other,
        )
        return SquadArrays(whole, written, tilts)

    def room_for(self, ticks: int) -> None:
        """What ticks need there is."""

    @property
    def groups(self) -> tuple[Group, ...]:
        return (self.group,)

    @property
    def route_room(self) -> int:
        """How many points there is room for in each route."""
        return len(self.group.routes.s[0])

    @property
    def state(self) -> Ints:
        """The states of automata."""
        return self.group.automata.state

    @property
    def reached(self) -> Bools:
        """Who is where it was to go."""
        return self.group.automata.reached

    @property
    def heading(self) -> Floats:
        return self._heading

    def pass_ticks(self, ticks: int, position: Floats, short: Floats) -> None:
        """Note an even number of ticks that were made: where drones are, and how far from goals."""
        self.position, self._short = position, (short, self.group.routes.changes)

    def fixes(self, now_s: float) -> tuple[Floats, Floats]:
        return self.position, self._heading

    def truth(self) -> tuple[Floats, Floats]:
        return self.position, self._heading

    def attitude(self) -> Floats:
        return self.vehicles.state.attitude.T.copy()

    def tilts(self) -> Floats:
        if self.vehicles.state is not self._states[0]:
            return tilts_of(self.attitude())
        return tilts_by(self._tilts)

    def short_m(self) -> Floats:
        if self._short is not None and self._short[1] == self.group.routes.changes:
            return self._short[0]
        left = lengths(self.position - self.group.routes.end) - self.group.visit.epsilon_m
        found: Floats = np.maximum(left, 0.0)
        return found


def tilts_by(parts_of: Floats) -> Floats:
    """Roll and pitch, shape ``(…, n, 2)``, by what they are worked out of, ``(3, …, n)``."""
    rising, upright, sine = parts_of
    found: Floats = np.empty((*sine.shape, 2))
    found[..., 0], found[..., 1] = np.arctan2(rising, upright), np.arcsin(sine)
    return found


def _state(block: Floats) -> FlightState:
    return FlightState(
        *(block[0:3], block[3:6], block[6:10], block[10:13], block[13], block[14:17])
    )


# --- the machine code -----------------------------------------------------------------------------


@cache
def ticking_code(width: int) -> Callable[..., int]:
    """Compile ticks of a squad, ``width`` drones at a time.

    The function takes the address of the table of arrays, the number of drones, how many points
    there is room for in each route, and how many ticks there are, with how many steps in each.
    After each tick the blocks of states change places.
    """
    return kept("ticks", (width,), lambda: _ticking(width)).function("ticks", 5)


def _ticking(width: int) -> Ir:
    module = new_module("ticks")
    block = block_code(module, width)
    code = Code(module, "ticks", [BYTES, *[I64] * 4], I64)
    table, count, room, ticks, steps = code.arguments
    b = code.b
    arrays = arrays_of(code, table, TABLE)
    lanes = Lanes(code, 1)
    pitch = b.mul(count, word(DOUBLE_BYTES))

    def tick(values: list[Ir]) -> list[Ir]:
        before, after, number, places = values
        now = {**arrays, "before": before, "after": after}
        numbers = numbers_of(lanes, arrays["constants"], CONSTANTS)
        numbers["now_s"] = lanes.get(arrays["times"], b.mul(number, word(DOUBLE_BYTES)))
        with code.loop(word(0), count) as robot:
            one = _Told(lanes, now, numbers, robot, room, count)
            one.step_automaton()
            one.command()
        fly_all(code, block, width, (before, now["told"], now["flight"], after), count, steps)
        with code.loop(word(0), count) as robot:
            first = b.mul(robot, word(3 * DOUBLE_BYTES))
            for axis in range(3):
                there = b.add(b.mul(pitch, word(axis)), b.mul(robot, word(DOUBLE_BYTES)))
                lanes.put(places, b.add(first, word(axis * DOUBLE_BYTES)), lanes.get(after, there))
        with code.only_if(b.icmp_signed("==", b.add(number, word(1)), ticks)):
            told = {**now, "position": places}
            with code.loop(word(0), count) as robot:
                _Seen(lanes, told, numbers, robot, room, count).show()
        following = code.at(places, b.mul(pitch, word(3)))
        return [after, before, b.add(number, word(1)), following]

    code.repeated(ticks, [arrays["one"], arrays["other"], word(0), arrays["places"]], tick)
    b.ret(word(0))
    return module


class _Seen(OneDrone):
    """A drone at the end of the last tick."""

    def show(self) -> None:
        """Store how far it is from its goal, and how it tilts, as ``tilts_of`` works it out."""
        b = self.code.b
        end = self.three("points", b.add(b.mul(self.robot, self.room), self.whole("size")))
        x, y, z = (here - there for here, there in zip(self.position, end, strict=True))
        left = (x * x + y * y + z * z).sqrt() - self.of["epsilon_m"]
        self.put("short", self.robot, left.greater(0.0))
        qw, qx, qy, qz = (self.row("after", 6 + k) for k in range(4))
        tilts = (
            2.0 * (qw * qx + qy * qz),
            1.0 - 2.0 * (qx * qx + qy * qy),
            (2.0 * (qw * qy - qx * qz)).greater(-1.0).lesser(1.0),
        )
        for row, value in enumerate(tilts):
            self.lanes.put(self.arrays["tilts"], self.place(row), value)


class _Told(OneDrone):
    """A drone that is measured to be where it is, and whose controller is told at once."""

    def where(self) -> list[Lane]:
        return [self.row("before", axis) for axis in range(3)]

    def send(self, row: int, axis: int, value: Lane) -> None:
        if row == 0:
            # As in the reference, what is measured is off by nothing; or is no number.
            value = value - (self.position[axis] - self.position[axis])
        self.lanes.put(self.arrays["told"], self.place(3 * row + axis), value)
