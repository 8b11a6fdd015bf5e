"""What the assumptions say about how variables start: which they read, which lengths they fix."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct

from koord.syntax import core
from koord.syntax.walk import nodes

Key = tuple[core.Home, int | None, int]


def key(variable: core.Variable, kind: int | None) -> Key:
    """What tells variables apart: slots of locals count per kind of robot."""
    local = variable.home in (core.Home.LOCAL, core.Home.PORT)
    return (variable.home, kind if local else None, variable.slot)


class Assumed(Struct, frozen=True):
    """The variables that the assumptions read, and the lengths of lists that they fix."""

    read: frozenset[Key]
    lengths: dict[Key, int]


def assumed(assumptions: Iterable[core.Assumption], kinds: int) -> Assumed:
    """What the assumptions say about how variables start."""
    read: set[Key] = set()
    lengths: dict[Key, int] = {}
    for assumption in assumptions:
        for place, kind in places_read(assumption.condition):
            for each in range(kinds) if kind is None else (kind,):
                read.add(key(place.variable, each))
        for found, length in fixed_lengths(assumption.condition, kinds).items():
            lengths.setdefault(found, length)
    return Assumed(frozenset(read), lengths)


def places_read(expr: core.Expr) -> Iterator[tuple[core.Place, int | None]]:
    """Every place that the expression reads, with the kind of its robot where only one can be."""
    kinds: dict[int, int | None] = {}
    for node in nodes(expr):
        match node:
            case core.Quantified(variable=variable, domain=core.RobotRange(agent=agent)):
                kinds[variable.slot] = agent
            case core.Place(robot=core.Read(place=core.Place(variable=robot))):
                yield node, kinds.get(robot.slot) if robot.home is core.Home.BOUND else None
            case core.Place():
                yield node, None


def fixed_lengths(condition: core.Expr, kinds: int) -> dict[Key, int]:
    """The lists whose length an assumption fixes: ``length(x) == c``, for all robots or plainly."""
    result: dict[Key, int] = {}
    robots: dict[int, int | None] = {}
    stack = [condition]
    while stack:
        match stack.pop():
            case core.Binary(op=core.BinaryOp.AND, left=left, right=right):
                stack.extend((left, right))
            case core.Quantified(
                quantifier=core.QuantifierKind.FORALL,
                variable=variable,
                domain=core.RobotRange(agent=agent),
                body=inner,
            ):
                robots[variable.slot] = agent
                stack.append(inner)
            case core.Binary(op=core.BinaryOp.EQ, left=left, right=right):
                for list_, size in ((left, right), (right, left)):
                    for found in _fixed(list_, size, robots, kinds):
                        result.setdefault(found[0], found[1])
    return result


def _fixed(
    list_: core.Expr, size: core.Expr, robots: dict[int, int | None], kinds: int
) -> Iterator[tuple[Key, int]]:
    match list_, size:
        case (
            core.Builtin(op=core.ListOp.LENGTH, arguments=(core.Read(place=place),)),
            core.Const(value=int() as length),
        ) if length >= 0:
            pass
        case _:
            return
    variable = place.variable
    match variable.home:
        case core.Home.ALLWRITE if not place.steps:
            yield key(variable, None), length
        case core.Home.ALLREAD if len(place.steps) == 1:
            step = place.steps[0]
            if isinstance(step, core.IndexStep) and _robot(step.index, robots) is not None:
                yield key(variable, None), length
        case core.Home.LOCAL | core.Home.PORT if not place.steps:
            robot = _robot(place.robot, robots)
            if robot is not None:
                for kind in range(kinds) if robot[0] is None else (robot[0],):
                    yield key(variable, kind), length
        case _:
            return


def _robot(expr: core.Expr | None, robots: dict[int, int | None]) -> tuple[int | None] | None:
    """The kind of robot that a quantified variable goes through, or None if it is no such."""
    match expr:
        case core.Read(place=core.Place(variable=variable, steps=())) if (
            variable.home is core.Home.BOUND and variable.slot in robots
        ):
            return (robots[variable.slot],)
        case _:
            return None
