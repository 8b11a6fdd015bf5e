"""What statements about configurations read, by their text: a statement is a function of it."""

from __future__ import annotations

from collections.abc import Iterator

from koord.recheck.progress_argument import Phrase
from koord.recheck.sorts import NotRecheckedError
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home
from koord.syntax.types import INT, ArrayType, BoolType, EnumType, FloatType, IntType, Type
from koord.syntax.walk import nodes, reached

#: What asks for more than configurations say, or for what stands in no variable.
_BEYOND = (core.Choose, core.ExternalCall, core.Ran, core.Stopped, core.Pid)

#: What a plain statement consists of.
_PLAIN = (
    core.Read,
    core.Place,
    core.Variable,
    core.IndexStep,
    core.FieldStep,
    core.Const,
    core.Unary,
    core.Binary,
)

#: What is left over of a division may be told as some number that has a law.
_DIVISIONS = (BinaryOp.DIV, BinaryOp.MOD)

#: A robot, whichever it is.
_ROBOT = core.Variable(Home.BOUND, 0, "robot", INT)


def is_plain(said: core.Expr) -> bool:
    """Return whether all of a statement, or number, is made of variables without any law beside."""
    return all(
        isinstance(node, _PLAIN) and not (isinstance(node, core.Binary) and node.op in _DIVISIONS)
        for node in nodes(said)
    )


def parts_read(program: core.Program, said: core.Expr) -> Iterator[Phrase]:
    """Yield all that a statement may read, each variable as a phrase of any robot, or of none.

    Where none of these differs between two configurations, of any robot, the statement says the
    same of both. Raises NotRecheckedError where that is not seen.
    """
    if len(program.agents) != 1:
        raise NotRecheckedError("what nothing moves, where robots are of several kinds")
    found: dict[core.Variable, None] = {}
    for node in reached(program, said):
        if isinstance(node, _BEYOND):
            raise NotRecheckedError("what nothing moves, of a statement that asks for more")
        if isinstance(node, core.Place):
            if node.primed or node.variable.home is Home.PORT:
                raise NotRecheckedError("what nothing moves, of a statement about sensors")
            if node.variable.home is not Home.BOUND:
                found[node.variable] = None
    for variable in found:
        yield _of_any(variable)


def _of_any(variable: core.Variable) -> Phrase:
    """A variable of any robot, or a shared one."""
    robot = core.Read(core.Place(_ROBOT))
    match variable.home:
        case Home.LOCAL:
            place, slot = core.Place(variable, robot=robot), _ROBOT.slot
        case Home.ALLREAD:
            assert isinstance(variable.type, ArrayType)
            entry = core.IndexStep(robot, variable.type.element)
            place, slot = core.Place(variable, (entry,)), _ROBOT.slot
        case _:
            return Phrase(core.Read(core.Place(_scalar(variable))), 1, None, None)
    _check(place.type)
    return Phrase(core.Read(place), 1, slot, None)


def _scalar(variable: core.Variable) -> core.Variable:
    _check(variable.type)
    return variable


def _check(type_: Type) -> None:
    if not isinstance(type_, BoolType | EnumType | IntType | FloatType):
        raise NotRecheckedError("what nothing moves, of lists and records")
