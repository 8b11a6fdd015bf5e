"""Bodies on all robots at once, where their number is open. [T-EVERY-N]

Statements about all robots are given to the solver as such: with quantifiers over their numbers.
"""

from __future__ import annotations

from collections.abc import Callable

from koord.recheck.body import RunningBody
from koord.recheck.sorts import Family, Value
from koord.recheck.storage import Robot
from koord.recheck.terms import INT, Term
from koord.syntax import core
from koord.syntax.core import ListOp, QuantifierKind


def is_robot(body: RunningBody, index: Term) -> Term:
    """The condition that a number is that of a robot."""
    if index is body.robot or index in body.here or index.value == 0:
        return body.t.truth(True)
    return body.v.is_robot(index)


# --- quantifiers ----------------------------------------------------------------------------------


def is_open(body: RunningBody, domain: core.QuantifierDomain) -> bool:
    """Return whether a quantifier's domain cannot be listed."""
    if body.v.robots is not None:
        return False
    match domain:
        case core.RobotRange():
            return True
        case core.IntRange(low=low, high=high):
            return body.condition(low).value is None or body.condition(high).value is None
        case core.Elements(sequence=sequence):
            return isinstance(body.value(sequence), Family)
        case core.AllValues():
            return False


def quantified(body: RunningBody, e: core.Quantified) -> Term:
    """Evaluate a quantifier over robots, or up to a number that depends on theirs. [E-QUANT]"""
    v, type_ = body.v, e.variable.type
    low, high, universal = v.t.integer(0), v.count, e.quantifier is QuantifierKind.FORALL
    item: Callable[[Term], Value] = lambda index: index  # noqa: E731
    allowed: Callable[[Term], Term] = lambda index: v.t.truth(True)  # noqa: E731
    match e.domain:
        case core.RobotRange(agent=int() as agent):
            allowed = lambda index: body.world.is_of(v, index, agent)  # noqa: E731
        case core.IntRange():
            low, high = body.condition(e.domain.low), body.condition(e.domain.high)
        case core.Elements(sequence=sequence):
            family = body.value(sequence)
            assert isinstance(family, Family)
            item = family.at
        case _:
            pass

    def holds(index: Term) -> Term:
        body.bound[e.variable.slot] = body.s.stored(item(index), type_)
        return body.condition(e.body)

    return over(body, low, high, allowed, holds, universal=universal)


def over(
    body: RunningBody,
    low: Term,
    high: Term,
    allowed: Callable[[Term], Term],
    holds: Callable[[Term], Term],
    *,
    universal: bool,
) -> Term:
    """The condition that a Boolean holds of all (or some) integers of a range.

    Values after a deciding smaller one are not evaluated, and cannot fault.
    """
    t, v = body.t, body.v

    def inside(index: Term, end: Term) -> Term:
        return t.conjunction([t.at_most(low, index), t.less(index, end), allowed(index)])

    faults, legal = len(body.faults), len(body.legal)
    with v.within() as k:
        with body.where(inside(k, high)), body.among(k, low, high):
            found = holds(k)
        with v.within() as lesser:
            goes_on = found if universal else t.negation(found)
            earlier = t.for_all([lesser], t.implies(inside(lesser, k), t.put(goes_on, k, lesser)))
    body.faults[faults:] = [
        fault.of(t.exists([k], t.both(fault.when, earlier))) for fault in body.faults[faults:]
    ]
    body.legal[legal:] = [t.for_all([k], fact) for fact in body.legal[legal:]]
    if universal:
        return t.for_all([k], t.implies(inside(k, high), found))
    return t.exists([k], t.both(inside(k, high), found))


# --- functions of lists ---------------------------------------------------------------------------


def of_all(body: RunningBody, e: core.Builtin, family: Family) -> Term:
    """Evaluate ``any``, ``all``, ``min``, ``max`` of an array over all robots. [E-LIST]"""
    t, v = body.t, body.v

    def at(index: Term) -> Term:
        found = family.at(index)
        assert isinstance(found, Term)
        return found

    if e.op is ListOp.ALL:
        return v.every(at)
    if e.op is ListOp.ANY:
        return t.negation(v.every(lambda index: t.negation(at(index))))
    best = v.symbol(e.op.value, at(t.integer(0)).sort)
    witness = v.symbol("where it is", INT)

    def bounded(index: Term) -> Term:
        return t.at_most(best, at(index)) if e.op is ListOp.MIN else t.at_most(at(index), best)

    body.legal += [
        v.every(bounded),
        t.both(v.is_robot(witness), t.equal(best, at(witness))),
    ]
    return best


# --- robots by number -----------------------------------------------------------------------------


def candidates(body: RunningBody, number: Term) -> list[tuple[int, Term, Robot]]:
    """The robots that a number may name: of a kind, if so, that one."""
    crowd, world = body.crowd, body.world
    if crowd is not None:
        kinds = range(len(world.program.agents))
        return [(k, world.is_of(body.v, number, k), crowd.robot(k, number)) for k in kinds]
    robots = zip(world.kinds, body.state().robots, strict=True)
    return [
        (kind, body.t.equal(number, body.t.integer(i)), robot)
        for i, (kind, robot) in enumerate(robots)
    ]


def of_robot(body: RunningBody, e: core.Ran | core.Stopped) -> Term:
    """The condition that a robot ran an event, or is stopped; false if there is none. [PROP-RAN]"""
    t, number, found = body.t, body.condition(e.robot), []
    for kind, here, robot in candidates(body, number):
        holds = robot.stopped
        if isinstance(e, core.Ran):
            positions = [position for k, position in e.events if k == kind]
            holds = t.disjunction(t.equal(robot.ran, t.integer(p)) for p in positions)
        found.append(t.both(here, holds))
    there = t.truth(True) if body.crowd is None else is_robot(body, number)
    return t.both(there, t.disjunction(found))
