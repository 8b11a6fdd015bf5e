"""Measures of what robots hand on around a ring: it has not passed a robot yet. [T-PROGRESS]

Where a robot writes to its neighbour, something may go round from robot to robot: a lock, a
message. It comes nearer to the robot that waits for it in two steps: it is beyond that robot, until
it is handed on from the last robot to the first; and then it passes one robot after the other.
"""

from __future__ import annotations

from collections.abc import Iterator

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, QuantifierKind
from koord.syntax.types import BOOL, INT, BoolType, is_by_robot
from koord.syntax.walk import nodes
from koord.verify.engines.every_n.candidates import binary
from koord.verify.engines.every_n.progress_parts import (
    READ_MEANT,
    READ_ROBOT,
    Measure,
    Phrase,
    Words,
    changes,
)

#: Some robot that has what goes round.
_OTHER = core.Variable(Home.BOUND, 2, "j", INT)
_READ_OTHER = core.Read(core.Place(_OTHER))


def rings_of(program: core.Program, stated: core.Property) -> Iterator[tuple[Measure, Measure]]:
    """Yield where around the ring something is that robots hand on, in two steps each.

    Who has it is known by its element of what is handed on, or by that and a state of its own.
    Nothing where no robot writes to its neighbour, or the claim means no robot.
    """
    if stated.each is None or len(program.agents) != 1:
        return
    own = Words(program, 0).plain_states(_READ_OTHER)
    for variable, is_up in dict.fromkeys(_handed_on(program)):
        handed = _element(variable, _READ_OTHER)
        for has in (handed, *(binary(BinaryOp.OR, handed, state) for state in own)):
            first, last = (READ_MEANT, _READ_OTHER) if is_up else (_READ_OTHER, READ_MEANT)
            beyond = Measure(_somebody(binary(BinaryOp.LT, first, last), has))
            first, last = (_READ_OTHER, READ_ROBOT) if is_up else (READ_ROBOT, _READ_OTHER)
            before = _somebody(binary(BinaryOp.LE, first, last), has)
            yield beyond, Measure(before, core.RobotRange())


def handed_on(program: core.Program) -> Iterator[Measure]:
    """Yield whether a robot was handed something on, or not: either may settle."""
    if len(program.agents) == 1:
        for variable, _ in dict.fromkeys(_handed_on(program)):
            yield from changes([_element(variable, READ_ROBOT)], core.RobotRange())


def _somebody(where: core.Expr, has: core.Expr) -> Phrase:
    """The statement that somebody in some place has it."""
    there = core.Quantified(
        QuantifierKind.EXISTS, _OTHER, core.RobotRange(), binary(BinaryOp.AND, where, has)
    )
    return Phrase(there, _OTHER.slot + 1)


def _element(variable: core.Variable, robot: core.Expr) -> core.Expr:
    return core.Read(core.Place(variable, (core.IndexStep(robot, BOOL),)))


def _handed_on(program: core.Program) -> Iterator[tuple[core.Variable, bool]]:
    """Yield variables of which a robot writes a neighbour's element, and whether it is the next.

    Where it is not seen whether that is the next or the one before, both are yielded.
    """
    for node in nodes(program.agents):
        match node:
            case core.Assign(
                place=core.Place(
                    variable=core.Variable(home=Home.ALLWRITE) as variable,
                    steps=(
                        core.IndexStep(
                            index=core.Binary(op=BinaryOp.MOD, left=left, right=core.NumAgents()),
                            type=BoolType(),
                        ),
                    ),
                )
            ) if is_by_robot(variable.type):
                match left:
                    case core.Binary(op=BinaryOp.ADD, left=core.Pid(), right=core.Const(value=1)):
                        yield variable, True
                    case core.Binary(op=BinaryOp.SUB, left=core.Pid(), right=core.Const(value=1)):
                        yield variable, False
                    case _ if any(isinstance(part, core.Pid) for part in nodes(left)):
                        yield variable, True
                        yield variable, False
            case _:
                pass
