"""Generated programs that go through stages, so that what happens in them happens late.

Most random programs come to rest within a round or two, and break what they break in it. Here a
shared number counts up, one step a round at most; events wait for it, and so do properties.
"""

from __future__ import annotations

from random import Random

from msgspec.structs import replace

from koord.refinement.generating.palette import Profile
from koord.refinement.generating.programs import system
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import BOOL, INT
from tests.generators.profiles import FINITE

#: The last stage.
STAGES = 4

#: Nothing faults before the stages have passed, and no event must run.
STEADY = replace(
    FINITE, robots=(2, 2), faulty=0.0, unset=0.0, urgent=0.0, statements=(1, 2), nesting=1
)


def staged(random: Random, profile: Profile = STEADY) -> System:
    """A random system in stages."""
    made = system(random, profile)
    program = made.program
    stage = core.Variable(Home.ALLWRITE, len(program.allwrite), "stage", INT)
    lock = core.LockClass(len(program.lock_classes), ("stage",))
    return replace(
        made,
        program=replace(
            program,
            agents=tuple(_waiting(a, stage, lock.index, random) for a in program.agents),
            allwrite=(*program.allwrite, core.Declaration(stage, _number(0))),
            lock_classes=(*program.lock_classes, lock),
            properties=tuple(_later(p, stage, random) for p in program.properties),
        ),
    )


def _waiting(agent: core.Agent, stage: core.Variable, lock: int, random: Random) -> core.Agent:
    """The agent with events that wait for a stage, most of them, and one that goes on to it."""
    events = tuple(
        replace(e, guard=_both(_from(stage, random.randint(1, STAGES)), e.guard))
        if random.random() < 0.7
        else e
        for e in agent.events
    )
    place = Span("generated", 0, 1, 0, 2)
    further = core.Binary(BinaryOp.ADD, _read(stage), _number(1), INT)
    going = core.Event(
        name="Further",
        urgent=False,
        guard=core.Binary(BinaryOp.LT, _read(stage), _number(STAGES), BOOL),
        effect=(core.Atomic(lock, (core.Assign(core.Place(stage), further),)),),
        bound=0,
        lock_classes=frozenset({lock}),
        span=place,
    )
    return replace(agent, events=(*events, going))


def _later(stated: core.Property, stage: core.Variable, random: Random) -> core.Property:
    """What is stated of a stage and those after it, or of all."""
    if random.random() < 0.2:
        return stated
    before = core.Binary(BinaryOp.LT, _read(stage), _number(random.randint(1, STAGES)), BOOL)
    return replace(stated, condition=core.Binary(BinaryOp.OR, before, stated.condition, BOOL))


def _from(stage: core.Variable, first: int) -> core.Expr:
    return core.Binary(BinaryOp.LE, _number(first), _read(stage), BOOL)


def _both(left: core.Expr, right: core.Expr) -> core.Expr:
    return core.Binary(BinaryOp.AND, left, right, BOOL)


def _read(variable: core.Variable) -> core.Expr:
    return core.Read(core.Place(variable))


def _number(value: int) -> core.Expr:
    return core.Const(value, INT)
