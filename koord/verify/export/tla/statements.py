"""Translation of statements to TLA+, as expressions from memory to memory.

A memory is a record: the robot's locals ``l``, its copy ``c`` of what is shared, the store ``s``,
bound variables ``b``, lock classes entered ``k``, whether to stop ``st``, how control goes on ``f``
and what a function returns ``v``. A statement is an expression over one memory for the next.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import count

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home
from koord.syntax.walk import statements
from koord.verify.export.tla.expressions import (
    Scope,
    check_type,
    field_name,
    name_of,
    refused,
    text,
)


class TlaWriter(Struct):
    """A translator of bodies, with a fresh name per memory; ``longest`` bounds list lengths."""

    longest: int
    names: Iterator[int] = field(default_factory=count)

    def block(self, block: core.Block, of: Scope) -> str:
        """Translate a block: the memory after it, from ``of.memory``."""
        if not block:
            return of.memory
        steps, memory, may_leave = [], of.memory, False
        for s in block:
            after = self.statement(s, of.at(memory))
            if may_leave:
                after = f'IF {memory}.f # "next" THEN {memory} ELSE {after}'
            name = f"m{next(self.names)}"
            steps.append(f"{name} == {after}")
            memory, may_leave = name, may_leave or _leaves(s)
        return f"(LET {' '.join(steps)} IN {memory})"

    def statement(self, s: core.Stmt, of: Scope) -> str:
        m = of.memory
        match s:
            case core.Assign(place=place, value=value):
                check_type(place.variable.type, s.span)
                return self.assigned(place, text(value, of), of)
            case core.If(condition=condition, then=then, otherwise=otherwise):
                yes, no = self.block(then, of), self.block(otherwise, of)
                return f"(IF {text(condition, of)} THEN {yes} ELSE {no})"
            case core.ForRange(variable=variable, low=low, high=high, body=body):
                values = range(constant(low, of), constant(high, of))
                return self._loop([[(variable.slot, str(n))] for n in values], body, of)
            case core.ForEach():
                return self._each(s, of)
            case core.Break():
                return f'[{m} EXCEPT !.f = "break"]'
            case core.Return(value=value):
                given = "0" if value is None else text(value, of)
                return f'[{m} EXCEPT !.f = "return", !.v = {given}]'
            case core.Atomic(lock_class=lock, body=body):
                entered = f"m{next(self.names)}"
                inner = self.block(body, of.at(entered))
                return f"(LET {entered} == [{m} EXCEPT !.k = @ \\cup {{{lock}}}] IN {inner})"
            case core.Stop():
                return f'[{m} EXCEPT !.st = "stopped"]'
            case core.TryStop():
                return f'[{m} EXCEPT !.st = IF @ = "stopped" THEN @ ELSE "asked"]'
            case core.Output():
                return m
            case _:
                raise refused("a list that changes its length", s.span, "use an array")

    def assigned(self, place: core.Place, value: str, of: Scope) -> str:
        """Translate a write: shared variables are written in the copy and in the store."""
        variable, m = place.variable, of.memory
        if variable.home is Home.PORT:
            raise refused("an actuator", place.span, "leave modules out")
        path = ""
        type_ = variable.type
        for step in place.steps:
            if isinstance(step, core.IndexStep):
                size = of.size(type_)
                if size is None:
                    raise refused("a write into a list", place.span, "use an array")
                path += f"[Within({text(step.index, of)}, {size - 1})]"
            elif isinstance(step, core.FieldStep):
                path += f".{field_name(step, type_)}"
            else:
                raise refused("a map", place.span, "use an array")
            type_ = step.type
        if variable.home is Home.BOUND:
            return f"[{m} EXCEPT !.b[{variable.slot}]{path} = {value}]"
        where = f"{name_of(variable.name)}{path}"
        if variable.home is Home.LOCAL:
            return f"[{m} EXCEPT !.l.{where} = {value}]"
        name = f"v{next(self.names)}"
        return f"(LET {name} == {value} IN [{m} EXCEPT !.c.{where} = {name}, !.s.{where} = {name}])"

    def _each(self, s: core.ForEach, of: Scope) -> str:
        check_type(s.sequence.type, s.span)
        length = of.size(s.sequence.type)
        whole = f"v{next(self.names)}"
        turns = []
        for n in range(self.longest if length is None else length):
            bound = [(s.value.slot, f"{whole}[{n}]")]
            turns.append(bound if s.key is None else [*bound, (s.key.slot, str(n))])
        if length is None:
            there = [f"{n} \\in DOMAIN {whole}" for n in range(self.longest)]
            inner = self._loop(turns, s.body, of, there)
            return f"(LET {whole} == {text(s.sequence, of)} IN {inner})"
        return f"(LET {whole} == {text(s.sequence, of)} IN {self._loop(turns, s.body, of)})"

    def _loop(
        self,
        turns: list[list[tuple[int, str]]],
        body: core.Block,
        of: Scope,
        there: Sequence[str] = (),
    ) -> str:
        """Unroll a loop: its body so many times, with the values of bound variables.

        ``there`` are conditions, if there may be fewer times.
        """
        memory, steps = of.memory, []
        for n, bound in enumerate(turns):
            given = ", ".join(f"!.b[{slot}] = {value}" for slot, value in bound)
            start, name = f"m{next(self.names)}", f"m{next(self.names)}"
            inner = self.block(body, of.at(start))
            after = f"(LET {start} == [{memory} EXCEPT {given}] IN {inner})"
            past = f" \\/ ~({there[n]})" if there else ""
            steps.append(f'{name} == IF {memory}.f # "next"{past} THEN {memory} ELSE {after}')
            memory = name
        if not steps:
            return of.memory
        again = f'[{memory} EXCEPT !.f = IF @ = "break" THEN "next" ELSE @]'
        return f"(LET {' '.join(steps)} IN {again})"


def _leaves(s: core.Stmt) -> bool:
    return any(isinstance(inner, core.Return | core.Break) for inner in statements((s,)))


def constant(e: core.Expr, of: Scope, where: str = "a loop") -> int:
    """Evaluate the bound of a loop or choice, equal for all robots. Raises KoordError."""
    match e:
        case core.Const(value=int() as value):
            return int(value)
        case core.NumAgents():
            return len(of.kinds)
        case core.Builtin(op=core.ListOp.LENGTH, arguments=(sequence,)) if (
            size := of.size(sequence.type)
        ) is not None:
            return size
        case core.Binary(op=BinaryOp.ADD, left=left, right=right):
            return constant(left, of, where) + constant(right, of, where)
        case core.Binary(op=BinaryOp.SUB, left=left, right=right):
            return constant(left, of, where) - constant(right, of, where)
        case core.Binary(op=BinaryOp.MUL, left=left, right=right):
            return constant(left, of, where) * constant(right, of, where)
        case _:
            raise refused(f"{where} whose bound is not a constant", e.span, "use a constant bound")
