"""Machine code of what :class:`.Watchman` sees in most rounds: that nobody is blocked.

It is sure, or in doubt. Where somebody may be blocked, or may have moved by just as much as counts,
it says so and has noted nothing; then the watchman looks for itself.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from functools import cache

from koord.machine.code import BYTES, I8, I64, Code, Ir, constant, new_module, word
from koord.machine.kept import kept
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes
from koord.runtime.motion.arrays import Bools, Floats
from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.world import World
from koord.sim.sensing import FleetSensors
from koord.sim.standing import BLOCKED_M, BLOCKED_S, DOUBTFUL_M2, Watchman
from koord.sim.vehicles.compiled import address

#: What is found in a round. In doubt nothing is noted.
NOBODY, SOMEBODY, DOUBT = range(3)

#: A place, in bytes.
_PLACE = 3 * DOUBLE_BYTES


class CompiledWatchman(Watchman):
    """A watchman with machine code for rounds in which nobody is blocked."""

    def __init__(self, world: World, bodies: Sequence[Body]) -> None:
        super().__init__(world, bodies)
        self._watch = watching_code()
        lingering, self._times = self._lingering, (ctypes.c_double * 2)()
        self._noted_at = address(lingering.at), address(lingering.since_s)
        self._times_at = ctypes.addressof(self._times)

    @property
    def code(self) -> Callable[..., int]:
        """The machine code of a look."""
        return self._watch

    def _is_on_the_way(
        self, sensed: FleetSensors, stopped: Bools, places: Floats, began_s: float
    ) -> bool | None:
        self._times[:] = [began_s, self.now_s]
        found = self._watch(
            *(address(sensed.state), address(sensed.short_m), address(stopped), address(places)),
            *(*self._noted_at, self._times_at, len(places)),
        )
        return None if found == DOUBT else found == SOMEBODY


# --- the machine code -----------------------------------------------------------------------------


@cache
def watching_code() -> Callable[..., int]:
    """Compile a look at all robots.

    The function takes the addresses of the states of their automata, of how far each is from where
    it goes, of who has stopped, of places, shape ``(n, 3)``; of where they linger, ``(n, 3)``, and
    since when, which are written over; of when the round began and ended; and n.
    """
    return kept("watching", (), _watching).function("watch", 8)


def _watching() -> Ir:
    code = Code(new_module("watching"), "watch", [BYTES] * 7 + [I64], I64)
    *_, times, count = code.arguments
    b, lanes = code.b, Lanes(code, 1)
    began_s, now_s = (lanes.get(times, DOUBLE_BYTES * k) for k in range(2))

    def seen(values: list[Ir]) -> list[Ir]:
        found, robot = values
        one = _Robot(lanes, code.arguments, robot)
        long_ago = lanes.constant(BLOCKED_S - 1e-9).is_at_most(now_s - one.since_s)
        in_doubt = b.and_(one.is_going, b.or_(one.in_doubt, b.and_(b.not_(one.is_fresh), long_ago)))
        said = b.select(one.is_on_the_way, word(SOMEBODY), word(NOBODY))
        said = b.select(in_doubt, word(DOUBT), said)
        found = b.select(b.icmp_signed(">", said, found), said, found)
        return [found, b.add(robot, word(1))]

    found, _ = code.repeated(count, [word(NOBODY), word(0)], seen)
    is_sure = b.icmp_signed("!=", found, word(DOUBT))
    with code.only_if(is_sure), code.loop(word(0), count) as robot:
        _Robot(lanes, code.arguments, robot).note(began_s)
    b.ret(found)
    return code.function.module


class _Robot:
    """What is seen of a robot, as :meth:`.Watchman.round` sees it."""

    def __init__(self, lanes: Lanes, arguments: list[Ir], robot: Ir) -> None:
        self._code, self._lanes = lanes.code, lanes
        states, short, stopped, self._places, self._at, self._since, *_ = arguments
        b = self._code.b
        self._number, self._place = (b.mul(robot, word(size)) for size in (DOUBLE_BYTES, _PLACE))
        state = self._code.get(states, self._number, I64)
        runs = b.icmp_signed("==", self._code.get(stopped, robot, I8), constant(I8, 0))
        moves, plans = (
            b.icmp_signed("==", state, word(one))
            for one in (MotionState.MOVING, MotionState.PLANNING)
        )
        short_m = lanes.get(short, self._number)
        self.is_on_the_way = b.and_(b.or_(moves, plans), runs)
        self.is_going = b.and_(b.and_(moves, runs), b.not_(short_m.is_below(BLOCKED_M)))
        self.since_s = lanes.get(self._since, self._number)
        x, y, z = (
            a - c for a, c in zip(self._three(self._places), self._three(self._at), strict=True)
        )
        square, far = x * x + y * y + z * z, BLOCKED_M**2
        is_apart = lanes.constant(far + DOUBTFUL_M2).is_below(square)
        is_new = b.not_(self.since_s.is_at_most(math.inf))
        may_be_apart = lanes.constant(far - DOUBTFUL_M2).is_below(square)
        self.in_doubt = b.and_(b.not_(is_new), b.and_(may_be_apart, b.not_(is_apart)))
        self.is_fresh = b.and_(self.is_going, b.or_(is_apart, is_new))

    def note(self, began_s: Lane) -> None:
        """Note where it lingers, and since when."""
        b, lanes = self._code.b, self._lanes
        since = b.select(self.is_fresh, began_s.ir, self.since_s.ir)
        since = b.select(self.is_going, since, lanes.constant(math.nan).ir)
        lanes.put(self._since, self._number, Lane(lanes, since))
        with self._code.only_if(self.is_fresh):
            for axis, place in enumerate(self._three(self._places)):
                lanes.put(self._at, b.add(self._place, word(DOUBLE_BYTES * axis)), place)

    def _three(self, block: Ir) -> list[Lane]:
        there = self._code.at(block, self._place)
        return [self._lanes.get(there, DOUBLE_BYTES * axis) for axis in range(3)]
