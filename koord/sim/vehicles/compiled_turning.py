"""Machine code of the law by which differential drives follow routes, automata and all.

What :func:`.automaton.step`, :class:`.Legs` and :class:`.Turning` compute, robot by robot and in
the same order of operations, so that commands are equal to the last bit. So a tick of a squad is
one call. Tests hold the two together.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from msgspec import Struct

from koord.machine.code import BYTES, F64, I1, I64, Code, Ir, constant, new_module, word
from koord.machine.kept import kept
from koord.machine.lanes import Lane, Lanes
from koord.runtime.motion.angles import sine_cosine, unwound
from koord.runtime.motion.bodies import DifferentialDrive, Pace
from koord.runtime.motion.driving import (
    ACROSS,
    ALONG_RAD,
    ASIDE_RAD,
    HEADING,
    SLOWEST_MPS,
    Turning,
)
from koord.sim.squads import STEP_S, STEPS, SquadSetup, Wheeled
from koord.sim.vehicles.compiled_automata import arrays_of, numbers_of
from koord.sim.vehicles.compiled_legs import (
    CONSTANTS,
    DrivenSquad,
    OneDriver,
    Spot,
    arrays_in,
    unsigned,
)

_EVERY_S = STEPS * STEP_S


class TurningSquad(DrivenSquad):
    """A squad of differential drives, by machine code."""

    OWN = ("last_speed", "last_turn", "turns")

    def __init__(self, setup: SquadSetup, vehicles: Wheeled, law: Turning) -> None:
        code = turning_code(_Kind(law.body, setup.group.routes.pace))
        super().__init__(setup, vehicles, law, code)
        self._law = law

    def own(self) -> tuple[Any, ...]:
        law = self._law
        return law.speed, law.turn, law.turns


# --- the machine code -----------------------------------------------------------------------------


class _Kind(Struct, frozen=True):
    """The constants of drives of one kind, and of their routes."""

    body: DifferentialDrive
    pace: Pace


@cache
def turning_code(kind: _Kind) -> Callable[..., int]:
    """Compile a tick of a squad of differential drives.

    The function takes the address of the table of arrays, the number of robots, how many points
    there is room for in each route, nothing, and whether the law acts at this tick. It returns how
    many have missed the ends of their routes.
    """
    return kept("turning", (kind,), lambda: _turning(kind)).function("track", 5)


def _turning(kind: _Kind) -> Ir:
    code = Code(new_module("turning"), "track", [BYTES, *[I64] * 4], I64)
    table, count, room, _, acts = code.arguments
    b, lanes = code.b, Lanes(code, 1)
    arrays = arrays_of(code, table, arrays_in(TurningSquad.OWN, TurningSquad.MORE))
    numbers = numbers_of(lanes, arrays["constants"], CONSTANTS)
    acts, missed = b.icmp_signed("!=", acts, word(0)), code.slot(I64)
    b.store(word(0), missed)
    with code.loop(word(0), count) as robot:
        one = _OneRover(lanes, arrays, numbers, robot, room, count)
        one.body, one.pace = kind.body, kind.pace
        one.accel_mps2, one.every_s = kind.body.wheel_accel_mps2, _EVERY_S
        one.step_automaton()
        with code.only_if(acts):
            b.store(b.add(b.load(missed), one.command()), missed)
    b.ret(b.load(missed))
    return code.function.module


class _OneRover(OneDriver):
    """What is computed for one differential drive."""

    body: DifferentialDrive

    def command(self) -> Ir:
        """Command, as ``Turning.command``; 1 where the end of the route is missed, else 0."""
        b, code, zero = self.code.b, self.code, self.lanes.constant(0.0)
        last_speed, last_turn = (self.number(x, self.robot) for x in ("last_speed", "last_turn"))
        turned, asked = self.truth("turns"), [code.slot(F64) for _ in range(2)]
        self.keep("turns", constant(I1, 0))
        for slot in asked:
            b.store(zero.ir, slot)
        with self.on_its_leg() as (s, k, left):
            self.keep("going", constant(I1, 1))
            spot = self.at(s, k)
            aside = unwound(spot.course - self.number("heading", self.robot))
            begins = b.fcmp_ordered("==", last_speed.ir, zero.ir)
            is_strict = b.or_(turned, b.and_(self.stands(), begins))
            along, most = self.lanes.constant(ALONG_RAD), self.lanes.constant(ASIDE_RAD)
            turns = self.either(is_strict, along, most).is_below(unsigned(aside))
            self.keep("turns", turns)
            with code.only_if(turns):
                b.store(self._on_the_spot(aside, last_turn).ir, asked[1])
            with code.only_if(b.not_(turns)):
                speed = self.paced(s, k, left, last_speed)
                b.store(speed.ir, asked[0])
                b.store(self._along(spot, aside, speed).ir, asked[1])
        speed, turn = (Lane(self.lanes, b.load(slot)) for slot in asked)
        going = self.truth("going")
        missed = self.watch(going)
        speed = self.speed_of(b.and_(going, b.not_(self.truth("turns"))), speed)
        half = self.body.track_m / 2
        quickest = (unsigned(speed) + half * unsigned(turn)).greater(SLOWEST_MPS)
        share = (self.body.wheel_mps / quickest).lesser(1.0)
        speed, turn = share * speed, share * turn
        self.put("last_speed", self.robot, speed)
        self.put("last_turn", self.robot, turn)
        self.put("command", self.pair(0), speed - half * turn)
        self.put("command", self.pair(1), speed + half * turn)
        return b.zext(missed, I64)

    def _on_the_spot(self, aside: Lane, last: Lane) -> Lane:
        """The rate of turning to the path, as ``Turning._on_the_spot``."""
        body = self.body
        accel = body.wheel_accel_mps2 / body.track_m
        rate = (2 * accel * unsigned(aside)).sqrt().lesser(unsigned(aside) / self.every_s)
        rate = rate.lesser(body.cruise_turn_radps).signed_as(aside)
        most = 2 * accel * self.every_s
        return last + (rate - last).greater(-most).lesser(most)

    def _along(self, spot: Spot, aside: Lane, speed: Lane) -> Lane:
        """The rate of turning that follows the path, as ``Turning._along``."""
        sine, cosine = sine_cosine(spot.course)
        gap_x, gap_y = spot.x - self.position[0], spot.y - self.position[1]
        across = cosine * gap_y - sine * gap_x
        bend: Lane = spot.curvature + ACROSS * across + HEADING * sine_cosine(aside)[0]
        most = self.body.cruise_turn_radps
        return (speed * bend).greater(-most).lesser(most)
