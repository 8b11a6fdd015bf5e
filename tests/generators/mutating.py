"""Mistakes that a person might make, put into a core program one at a time.

Only what robots do is changed (INIT, events, functions, models of modules), never what is claimed
or assumed of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.source import Span
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import statements
from tests.generators.wellformed import complaints


@dataclass(frozen=True)
class Mutant:
    """A program with one mistake in it: what was done, and where in the text."""

    mistake: str
    span: Span
    program: core.Program

    def __str__(self) -> str:
        return f"{self.mistake} ({self.span})"


def mutants(program: core.Program) -> Iterator[Mutant]:
    """Every program that differs from this one by one mistake, and is well typed."""
    for mistake, span, made in _of_program(program):
        if not complaints(made):
            yield Mutant(mistake, span, made)


#: What was done, where, and what came of it.
_Changed = tuple[str, Span, Any]

_OTHERS = {
    BinaryOp.LT: BinaryOp.LE,
    BinaryOp.LE: BinaryOp.LT,
    BinaryOp.EQ: BinaryOp.NE,
    BinaryOp.NE: BinaryOp.EQ,
    BinaryOp.ADD: BinaryOp.SUB,
    BinaryOp.SUB: BinaryOp.ADD,
    BinaryOp.MIN: BinaryOp.MAX,
    BinaryOp.MAX: BinaryOp.MIN,
}

_DROPPED = (
    core.Assign,
    core.Append,
    core.Remove,
    core.Pop,
    core.Stop,
    core.TryStop,
    core.If,
    core.Break,
)


def _of_program(program: core.Program) -> Iterator[_Changed]:
    for number, agent in enumerate(program.agents):
        for mistake, span, changed in _of_agent(agent):
            agents = (*program.agents[:number], changed, *program.agents[number + 1 :])
            yield mistake, span, replace(program, agents=agents)
    for number, function in enumerate(program.functions):
        for mistake, span, body in _of_block(function.body):
            changed = replace(function, body=body)
            functions = (*program.functions[:number], changed, *program.functions[number + 1 :])
            yield mistake, span, replace(program, functions=functions)


def _of_agent(agent: core.Agent) -> Iterator[_Changed]:
    for mistake, span, init in _of_block(agent.init):
        yield mistake, span, replace(agent, init=init)
    for number, event in enumerate(agent.events):
        for mistake, span, changed in _of_event(event):
            events = (*agent.events[:number], changed, *agent.events[number + 1 :])
            yield mistake, span, replace(agent, events=events)
    for number, module in enumerate(agent.modules):
        for mistake, span, environment in _of_block(module.environment or ()):
            changed = replace(module, environment=environment)
            modules = (*agent.modules[:number], changed, *agent.modules[number + 1 :])
            yield mistake, span, replace(agent, modules=modules)


def _of_event(event: core.Event) -> Iterator[_Changed]:
    for mistake, span, guard in _of_node(event.guard):
        yield mistake, span, replace(event, guard=guard)
    if event.urgent:
        yield "not urgent", event.span, replace(event, urgent=False)
    for mistake, span, effect in _of_block(event.effect):
        entered = {s.lock_class for s in statements(effect) if isinstance(s, core.Atomic)}
        classes = event.lock_classes & entered
        yield mistake, span, replace(event, effect=effect, lock_classes=classes)


def _of_block(block: core.Block) -> Iterator[_Changed]:
    for number, statement in enumerate(block):
        before, after = block[:number], block[number + 1 :]
        if isinstance(statement, core.Atomic):
            yield "atomic dropped", statement.span, (*before, *statement.body, *after)
        if isinstance(statement, _DROPPED):
            yield f"{type(statement).__name__} dropped", statement.span, (*before, *after)
        if isinstance(statement, core.If) and statement.then and statement.otherwise:
            swapped = replace(statement, then=statement.otherwise, otherwise=statement.then)
            yield "branches swapped", statement.span, (*before, swapped, *after)
        for mistake, span, changed in _of_node(statement):
            yield mistake, span, (*before, changed, *after)


def _of_node(node: Any) -> Iterator[_Changed]:
    """The node itself changed, then what is below it."""
    for mistake, changed in _itself(node):
        yield mistake, node.span, changed
    for name in node.__struct_fields__:
        part = getattr(node, name)
        if name == "span":
            continue
        for mistake, span, changed in _of_part(part):
            yield mistake, span, replace(node, **{name: changed})


def _of_part(part: Any) -> Iterator[_Changed]:
    if isinstance(part, tuple) and part and isinstance(part[0], core.Stmt):
        yield from _of_block(part)
    elif isinstance(part, tuple):
        for number, item in enumerate(part):
            for mistake, span, changed in _of_part(item):
                yield mistake, span, (*part[:number], changed, *part[number + 1 :])
    elif isinstance(part, core.Node | core.IndexStep | core.KeyStep | core.IntRange):
        yield from _of_node(part)


def _itself(node: Any) -> Iterator[tuple[str, object]]:
    match node:
        case core.Binary(op=BinaryOp.AND | BinaryOp.OR as op, left=left, right=right):
            yield f"right of {op.value} dropped", left
            yield f"left of {op.value} dropped", right
            other = BinaryOp.OR if op is BinaryOp.AND else BinaryOp.AND
            yield f"{op.value} for {other.value}", replace(node, op=other)
        case core.Binary(op=op) if op in _OTHERS:
            yield f"{_OTHERS[op].value} for {op.value}", replace(node, op=_OTHERS[op])
        case core.Unary(op=UnaryOp.NOT, operand=operand):
            yield "not dropped", operand
        case core.Const(value=bool() as value):
            yield f"{not value} for {value}", replace(node, value=not value)
        case core.Const(value=int() as value, type=type_) if type_ == INT:
            yield f"{value + 1} for {value}", replace(node, value=value + 1)
            yield f"{value - 1} for {value}", replace(node, value=value - 1)
        case core.Const(value=Fraction() as value):
            yield f"{value + 1} for {value}", replace(node, value=value + 1)
        case core.Pid():
            one = core.Const(1, INT, span=node.span)
            yield "pid + 1", core.Binary(BinaryOp.ADD, node, one, INT, span=node.span)
            yield "pid - 1", core.Binary(BinaryOp.SUB, node, one, INT, span=node.span)
        case core.Ran() | core.Stopped():
            yield "what ran or stopped left out", core.Const(False, BOOL, span=node.span)
        case _:
            pass
