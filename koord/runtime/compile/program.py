"""Compilation of whole programs to Python modules."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from fractions import Fraction

from koord.runtime.compile.expressions import expression
from koord.runtime.compile.formatting import formatted
from koord.runtime.compile.module import Module, one_line
from koord.runtime.compile.naming import (
    annotation,
    shape,
    string,
    tuple_of,
)
from koord.runtime.compile.statements import Lines, block, indented
from koord.syntax import core
from koord.syntax.core import Direction, Home, Start
from koord.syntax.walk import nodes, written


def compiled(program: core.Program) -> str:
    """Compile a program to formatted Python. It imports :mod:`koord.runtime.robot` only.

    Raises NotCompilableError for programs that the verifier has abstracted.
    """
    return formatted(ProgramModule(program).lines())


class ProgramModule(Module):
    """The module of a program: a class for each kind of robot."""

    def lines(self) -> Lines:
        body = [*self.types(), *self.functions(), *self.classes(), *self.table()]
        return [*self.head(body), *body]

    # --- classes --------------------------------------------------------------------------------

    def classes(self) -> Iterator[str]:
        agents = self.program.agents
        fleet = self.names.fleet
        if len(agents) == 1:
            yield from ["", "", f"class {fleet}(Robot):"]
            docstring = f'"""The robots of {one_line(self.names.file)}."""'
            yield from indented(
                [docstring, "", *self.shared_part(), *self.kind(0), *self.shared_methods()]
            )
            return
        yield from ["", "", f"class {fleet}(Robot):"]
        docstring = f'"""What all robots of {one_line(self.names.file)} have in common."""'
        yield from indented([docstring, "", *self.shared_part(), *self.shared_methods()])
        for number, agent in enumerate(agents):
            yield from ["", "", f"class {self.names.kinds[number]}({fleet}):"]
            docstring = f'"""A robot of the kind {agent.name}, {self.line(agent.span)}."""'
            yield from indented([docstring, "", *self.kind(number)])

    def table(self) -> Lines:
        """The classes by the position of their kind."""
        return ["", "", f"KINDS = {tuple_of(self.names.kinds)}"]

    def kind(self, number: int) -> Lines:
        """The class of one kind of robot."""
        agent, names = self.program.agents[number], self.names
        lines = [] if number == 0 else [f"KIND = {number}"]
        own = [(entry, "local") for entry in agent.locals]
        own += [(port.declaration, port.direction.value) for port in agent.ports]
        for entry, what in own:
            name = names.attribute(entry.variable, number)
            of = annotation(names, entry.variable.type)
            lines.append(f"{name}: {of}  # {what}, {self.line(entry.span)}")
        lines += self.shapes("LOCALS", number, agent.locals)
        lines += self.shapes("PORTS", number, [port.declaration for port in agent.ports])
        lines += self.sensors(number)
        models = [m.environment for m in agent.modules if m.environment is not None]
        modelled = self.environment(number, models) if models else []
        if self.may_fault(models, modelled):
            lines.append("MODEL_MAY_FAULT = True")
        lines += ["", *self.initialise(number)]
        for position, event in enumerate(agent.events):
            lines += self.event(number, position, event)
        if modelled:
            lines += ["", *modelled]
        if agent.events:
            lines += ["", *self.events(number)]
        return lines

    def shapes(self, what: str, number: int, entries: Iterable[core.Declaration]) -> Lines:
        made = [
            f"{string(self.names.attribute(e.variable, number))}: "
            f"{shape(self.names, e.variable.type)}"
            for e in entries
        ]
        return [f"{what} = {{{', '.join(made)}}}"] if made else []

    def sensors(self, number: int) -> Lines:
        """The sensors, of modules without a model and with one."""
        agent = self.program.agents[number]
        lines = []
        for name, is_modelled in (("SENSORS", False), ("MODELLED", True)):
            found = [
                string(self.names.attribute(agent.ports[position].declaration.variable, number))
                for module in agent.modules
                if (module.environment is not None) is is_modelled
                for position in module.ports
                if agent.ports[position].direction is Direction.SENSOR
            ]
            lines += [f"{name} = {tuple_of(found)}"] if found else []
        return lines

    # --- INIT -----------------------------------------------------------------------------------

    def initialise(self, number: int) -> Lines:
        """The initial values of ports, locals and allread entries, then ``init:``. [INIT]"""
        agent = self.program.agents[number]
        shared = {
            (Home.ALLWRITE, e.variable.slot)
            for e in self.program.allwrite
            if e.initial is not Start.UNSET
        }
        scope = self.scope(number, sure=shared)
        body: Lines = []
        for entry in (*(port.declaration for port in agent.ports), *agent.locals):
            if entry.initial is not Start.UNSET:
                name = self.names.attribute(entry.variable, number)
                body.append(f"self.{name} = {self.initial(scope, entry, name).text}")
                scope.assigned.add((entry.variable.home, entry.variable.slot))
        for entry in self.program.allread:
            if entry.initial is not Start.UNSET:
                name = self.names.attribute(entry.variable, number)
                value = self.initial(scope, entry, name).text
                body.append(f"self.set({string(name)}, {value}, (self.pid,))")
        if agent.init:
            body += block(scope, agent.init)
        head = "def initialise(self) -> None:"
        return [head, *indented([*self.blanks(scope), *(body or ["pass"])])]

    # --- turns ----------------------------------------------------------------------------------

    def event(self, number: int, position: int, event: core.Event) -> Lines:
        effect, enabled = self.names.events[number][position]
        scope = self.scope(number)
        lines: Lines = []
        if not _is_true(event.guard):
            holds = expression(scope, event.guard).text
            lines += ["", f"def {enabled}(self) -> bool:", *indented([f"return {holds}"])]
        scope = self.scope(number)
        body = block(scope, event.effect)
        where = self.where(event.span)
        head = f"def {effect}(self) -> None:"
        return [*lines, "", head, *indented([where, *self.blanks(scope), *body])]

    def events(self, number: int) -> Lines:
        made = []
        agent = self.program.agents[number]
        for (effect, enabled), event in zip(self.names.events[number], agent.events, strict=True):
            parts = [string(event.name), effect]
            if not _is_true(event.guard):
                parts.append(enabled)
            if event.urgent:
                parts.append("urgent=True")
            made.append(f"Event({', '.join(parts)})")
        return [f"EVENTS = {tuple_of(made)}"]

    def may_fault(self, models: list[core.Block], compiled: Lines) -> bool:
        """Return whether a model has an operation that may fault, and is compiled with its place.

        So is a choice, which does not fault if its bounds are in order, as those of models are.
        """
        called = [
            f for f in self.program.functions if f.name in self.knowledge.called(tuple(models))
        ]
        parts = (tuple(models), tuple(function.body for function in called))
        sure = sum(isinstance(n, core.Choose) and _is_in_order(n.low, n.high) for n in nodes(parts))
        text = list(compiled)
        for function in called:
            text += self.function(function, in_method=function.name in self.knowledge.methods)
        return len(re.findall(r'"[^"\n]*\d+:\d+"', "\n".join(text))) > sure

    def environment(self, number: int, blocks: list[core.Block]) -> Lines:
        """The models: reads are of the ports before the turn, writes of those after. [ENV-MODEL]"""
        scope = self.scope(number)
        scope.in_environment = True
        ports = {
            place.variable.slot: place.variable
            for node in nodes(tuple(blocks))
            for place in written(node)
            if place.variable.home is Home.PORT
        }
        first: Lines = []
        for slot, variable in sorted(ports.items()):
            name = self.names.attribute(variable, number)
            scope.after[slot] = scope.temporary(name)
            first.append(f"{scope.after[slot]} = self.{name}")
        body: Lines = []
        for one in blocks:
            scope.bound = {}
            scope.assigned = {key for key in scope.assigned if key[0] is not Home.BOUND}
            body += block(scope, one)
            first += self.blanks(scope)
            scope.unset = {}
        after = [
            f"{string(self.names.attribute(variable, number))}: {scope.after[slot]}"
            for slot, variable in sorted(ports.items())
        ]
        head = "def environment(self) -> dict[str, Any]:"
        return [head, *indented([*first, *body, f"return {{{', '.join(after)}}}"])]


def _is_in_order(low: core.Expr, high: core.Expr) -> bool:
    """Return whether the interval between two bounds is surely nonempty; δ is above 0."""
    if isinstance(low, core.Const) and isinstance(high, core.Const):
        return _number(low) <= _number(high)
    return _sign(low, -1) and _sign(high, 1)


def _sign(e: core.Expr, sign: int) -> bool:
    """Return whether a constant, maybe times δ, is surely 0 or of a sign."""
    match e:
        case core.Const():
            return sign * _number(e) >= 0
        case core.Delta():
            return sign > 0
        case core.Binary(op=core.BinaryOp.MUL, left=left, right=right):
            return (_sign(left, sign) and _sign(right, 1)) or (
                _sign(left, 1) and _sign(right, sign)
            )
        case _:
            return False


def _number(e: core.Const) -> Fraction:
    return Fraction(e.value)


def _is_true(e: core.Expr) -> bool:
    return isinstance(e, core.Const) and e.value is True
