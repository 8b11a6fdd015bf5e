"""Statements about configurations as code, on storage as it is. [PROP-READ] [PROP-FAULT]

What is asked of hundreds of configurations, as samples are, is asked by a function made for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from koord.sampling.compiled.expressions import Names, NoCodeError
from koord.sampling.compiled.operations import Code
from koord.sampling.compiled.statements import INDENT, call_text, is_tree
from koord.sampling.compiled.turn_text import TurnWriter
from koord.semantics.domain import Constant, Domain
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, QuantifierKind
from koord.syntax.system import System

_OF_ROBOTS: Final = {Home.LOCAL: "locals", Home.PORT: "ports"}


class _StatementWriter(TurnWriter):
    """A writer of a statement about the configuration ``here``, which is nobody's turn."""

    def pid(self) -> str:
        raise NoCodeError("there is no pid")

    def read(self, place: core.Place) -> str:
        """A shared variable, or one of the robot that ``v@i`` names. [PROP-READ]"""
        variable = place.variable
        if variable.home not in _OF_ROBOTS:
            return super().read(place)
        if len(self.names.system.program.agents) != 1 or place.robot is None:
            raise NoCodeError(f"{variable.name} is not everybody's")
        robot = f"pick(robots, {self.expression(place.robot)})"
        text = f"{robot}.{_OF_ROBOTS[variable.home]}[{variable.slot}]"
        if is_tree(variable.type):
            return self._in_tree(text, variable.type, place.steps)
        return self.below(f"sure(held({text}))", place.steps) if place.steps else f"held({text})"

    def call(self, e: core.Call) -> str:
        # A function that asks is in doubt at once.
        return call_text(self, e, "UNSET, UNSET", [])

    def choose(self, e: core.Choose) -> str:
        raise NoCodeError("a choice is asked for")

    def external(self, e: core.ExternalCall) -> str:
        raise NoCodeError("a function is asked for")

    def misses(self, e: core.Expr) -> str:
        """How many conjuncts and instances of a statement fail: 0 if and only if it holds."""
        match e:
            case core.Binary(op=BinaryOp.AND, left=left, right=right):
                return f"({self.misses(left)} + {self.misses(right)})"
            case core.Binary(op=BinaryOp.IMPLIES, left=left, right=right):
                return f"({self.misses(right)} if {self.expression(left)} else 0)"
            case core.Quantified(
                quantifier=QuantifierKind.FORALL,
                domain=core.RobotRange() | core.IntRange() | core.Elements(),
            ):
                with self.ranging(e) as (name, over):
                    return f"sum([{self.misses(e.body)} for {name} in {over}])"
            case _:
                return f"(not {self.expression(e)})"


def statement_code(
    d: Domain[Constant], system: System, given: Sequence[core.Variable], e: core.Expr
) -> Code:
    """Whether a statement holds: of a configuration, and values of ``given`` bound variables.

    It is in doubt where the reference semantics has to say what holds, as of faults.
    """
    return _code(d, system, given, lambda writer: writer.sure(e))


def misses_code(d: Domain[Constant], system: System, e: core.Expr) -> Code:
    """How many conjuncts and instances of a statement fail in a configuration."""
    return _code(d, system, (), lambda writer: writer.misses(e))


def _code(
    d: Domain[Constant],
    system: System,
    given: Sequence[core.Variable],
    text: Callable[[_StatementWriter], str],
) -> Code:
    names = Names(d, system)
    names.values["spend"] = system.budget.spend
    writer = _StatementWriter(names)
    name = names.new("statement")
    try:
        arguments = [names.new("b") for _ in given]
        writer.bound.update((v.slot, b) for v, b in zip(given, arguments, strict=True))
        writer.line(f"return {text(writer)}")
        names.texts += [
            f"def {name}({', '.join(['here', *arguments])}):",
            f"{INDENT}robots, R, W = here.robots, here.store.allread, here.store.allwrite",
            *writer.load(),
            *writer.lines,
        ]
        return Code(names.made(name))
    except NoCodeError:
        return Code(None)
