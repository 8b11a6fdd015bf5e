"""Programs with something more in them that no claim can depend on. [T-CONE]"""

from __future__ import annotations

from fractions import Fraction
from random import Random

from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, Direction, Home, Start
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import BOOL, FLOAT, INT, ArrayType, Robots

_ZERO = core.Const(0, INT)
_PLACE = Span("generated", 0, 1, 0, 2)


def with_junk(of: System, random: Random, *, events: bool = True) -> System:
    """The system with ports, variables, a lock and events of which nothing else in it knows.

    Nothing that was there before is numbered anew. In programs with urgent events any event meets
    an obligation [SKIP], so no event is junk there.
    """
    program = of.program
    each = ArrayType(INT, Robots.ALL)
    seen = core.Variable(Home.ALLREAD, len(program.allread), "junk_seen", each)
    total = core.Variable(Home.ALLWRITE, len(program.allwrite), "junk_total", INT)
    lock = core.LockClass(len(program.lock_classes), ("junk_total",))
    is_urgent = any(event.urgent for agent in program.agents for event in agent.events)
    more = events and not is_urgent
    agents = tuple(_agent(a, seen, total, lock, random, more) for a in program.agents)
    made = replace(
        program,
        agents=agents,
        allread=(*program.allread, core.Declaration(seen, _ZERO)),
        allwrite=(*program.allwrite, core.Declaration(total, _ZERO)),
        lock_classes=(*program.lock_classes, lock),
    )
    return replace(of, program=made)


def _agent(
    agent: core.Agent,
    seen: core.Variable,
    total: core.Variable,
    lock: core.LockClass,
    random: Random,
    more_events: bool,
) -> core.Agent:
    """The agent with a sensor of real numbers, a counter that nothing bounds, and junk events."""
    count = core.Variable(Home.LOCAL, len(agent.locals), "junk_count", INT)
    last = core.Variable(Home.LOCAL, len(agent.locals) + 1, "junk_last", FLOAT)
    level = core.Variable(Home.PORT, len(agent.ports), "junk_level", FLOAT)
    reading = core.Declaration(level, Start.ARBITRARY)
    port = core.Port("Junk", Direction.SENSOR, reading)
    module = core.Module("Junk", (len(agent.ports),), None, 0, ())
    declared = (
        core.Declaration(count, _ZERO),
        core.Declaration(last, core.Const(Fraction(0), FLOAT)),
    )
    counted = core.Assign(core.Place(count), _more(count))
    more: list[core.Stmt] = [
        core.Assign(core.Place(last), _read(level)),
        core.Assign(core.Place(seen, (core.IndexStep(core.Pid(INT), INT),)), _read(count)),
        core.Atomic(lock.index, (core.Assign(core.Place(total), _more(total)),)),
    ]
    random.shuffle(more)
    locks = frozenset({lock.index})
    event = core.Event("Junk", False, _TRUE, (counted, *more), 0, locks, span=_PLACE)
    # Some events count what they do: no claim asks.
    events = [
        replace(e, effect=(*e.effect, counted)) if random.random() < 0.5 else e
        for e in agent.events
    ]
    return replace(
        agent,
        locals=(*agent.locals, *declared),
        ports=(*agent.ports, port),
        modules=(*agent.modules, module),
        events=tuple([*events, event] if more_events else events),
    )


_TRUE = core.Const(True, BOOL)


def _read(variable: core.Variable) -> core.Expr:
    return core.Read(core.Place(variable))


def _more(variable: core.Variable) -> core.Expr:
    return core.Binary(BinaryOp.ADD, _read(variable), core.Const(1, INT), INT)
