"""Compilation to Python modules: what programs and claims have alike, types and functions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from koord.runtime import robot
from koord.runtime.compile.expressions import expression
from koord.runtime.compile.knowledge import Knowledge
from koord.runtime.compile.naming import (
    PythonNames,
    annotation,
    constant_name,
    shape,
    string,
    tuple_of,
)
from koord.runtime.compile.scope import Code, Scope
from koord.runtime.compile.statements import Lines, block, indented
from koord.syntax import core
from koord.syntax.core import Home, Start
from koord.syntax.problem import told
from koord.syntax.source import Span
from koord.syntax.types import EnumType, RecordType


class Module:
    """A Python module under construction."""

    watching = False  #: whether it is about claims

    def __init__(self, program: core.Program) -> None:
        self.program = program
        self.names = PythonNames(program)
        self.knowledge = Knowledge(program)

    def head(self, body: Lines) -> Lines:
        """The docstring, and the imports that the body needs."""
        text = "\n".join(body)
        needed = sorted(
            (n for n in robot.__all__ if re.search(rf"(?<![\w.\"']){n}\b", text)),
            key=lambda n: (not n.isupper() and not n[0].isupper(), not n.isupper(), n),
        )
        typing = [n for n in ("Any", "NamedTuple") if re.search(rf"\b{n}\b", text)]
        file = one_line(self.names.file)
        given = [f"# param {one_line(told(given))}" for given in self.program.parameters]
        return [
            f'"""{file}, compiled: `koord compile` writes this file anew."""',
            "",
            *([*given, ""] if given else []),
            *_guide(text),
            "from __future__ import annotations",
            "",
            *([f"from typing import {', '.join(typing)}", ""] if typing else []),
            *([f"from koord.runtime.robot import {', '.join(needed)}"] if needed else []),
        ]

    # --- types ----------------------------------------------------------------------------------

    def types(self) -> Iterator[str]:
        for type_, name in self.names.types.items():
            yield from ["", ""]
            if isinstance(type_, EnumType):
                yield from self.enumeration(type_, name)
            else:
                yield from self.record(type_, name)

    def enumeration(self, type_: EnumType, name: str) -> Lines:
        members = [self.names.member(member) for member in type_.members]
        quoted = [string(member) for member in type_.members]
        return [
            f"class {name}:",
            *indented([f"{member} = {position}" for position, member in enumerate(members)]),
            "",
            "",
            f"{constant_name(name)} = Enumeration({string(type_.name)}, {tuple_of(quoted)})",
        ]

    def record(self, type_: RecordType, name: str) -> Lines:
        fields = [(self.names.field(field), its) for field, its in type_.fields]
        shapes = [shape(self.names, its) for _, its in fields]
        return [
            f"class {name}(NamedTuple):",
            *indented([f"{field}: {annotation(self.names, its)}" for field, its in fields]),
            "",
            "",
            f"{constant_name(name)} = Record({name}, {tuple_of(shapes)})",
        ]

    # --- functions ------------------------------------------------------------------------------

    def functions(self) -> Iterator[str]:
        """Functions that need no robot."""
        for function in self.program.functions:
            if function.name in self.knowledge.used - self.knowledge.methods:
                yield from ["", "", *self.function(function, in_method=False)]

    def function(self, function: core.Function, *, in_method: bool) -> Lines:
        early = function.name in self.knowledge.in_init
        scope = self.scope(None, sure=set() if early else None, in_method=in_method)
        parameters = ["self"] if in_method else []
        if function.name in self.knowledge.asking:
            parameters.append("trail: Key")
            scope.trail = ("*trail",)
        parameters += self.parameters(scope, function.parameters)
        names = self.names.methods if in_method else self.names.module_functions
        result = "None" if function.result is None else annotation(self.names, function.result)
        body = block(scope, function.body)
        if function.result is not None and not _returns(function.body):
            made = "self.numAgents" if in_method else "0"
            of_result = shape(self.names, function.result)
            body.append(f"nothing: {result} = default({of_result}, {made})")
            body.append("return nothing")
        return [
            f"def {names[function.name]}({', '.join(parameters)}) -> {result}:",
            *indented([self.where(function.span), *self.blanks(scope), *body]),
        ]

    def parameters(self, scope: Scope, parameters: Iterable[core.Variable]) -> list[str]:
        made = []
        for parameter in parameters:
            scope.assigned.add((Home.BOUND, parameter.slot))
            made.append(f"{scope.name(parameter)}: {annotation(self.names, parameter.type)}")
        return made

    def external(self, external: core.External) -> Lines:
        """The method that asks an external function, and checks its ``requires``."""
        scope = self.scope(None)
        name = self.names.externals[external.name]
        parameters = ["self", "key: Key"]
        if external.requires:
            parameters.append("place: str")
        parameters += self.parameters(scope, external.parameters)
        result = annotation(self.names, external.result.type)
        arguments = "".join(f", {scope.name(p)}" for p in external.parameters)
        body: Lines = []
        if any(self.knowledge.asks(requirement) for requirement in external.requires):
            body.append("trail = (*key[1:], key[0])")
            scope.trail = ("*trail",)
        for requirement in external.requires:
            met = expression(scope, requirement).text
            body.append(f"self.require(lambda: {met}, {string(external.name)}, place)")
        answer = scope.temporary("answer")
        body += [
            f"{answer}: {result} = self.ask({string(external.name)}, key{arguments})",
            f"return {answer}",
        ]
        return [
            f"def {name}({', '.join(parameters)}) -> {result}:",
            *indented([self.where(external.span), *body]),
        ]

    # --- shared variables -----------------------------------------------------------------------

    def shared_part(self) -> Lines:
        names = self.names
        entries = (*self.program.allread, *self.program.allwrite)
        lines = [f"SOURCE = {string(names.file)}"]
        for entry in entries:
            home = "allread" if entry.variable.home is Home.ALLREAD else "allwrite"
            of_all = annotation(names, entry.variable.type)
            name = names.attribute(entry.variable, None)
            lines.append(f"{name}: {of_all}  # {home}, {self.line(entry.span)}")
        if entries:
            shared = [
                f"Shared({string(names.attribute(e.variable, None))}, "
                f"{shape(names, e.variable.type)})"
                for e in entries
            ]
            lines.append(f"SHARED = Layout({tuple_of(shared)})")
        if self.externals():
            made = [f"{string(e.name)}: {shape(names, e.result.type)}" for e in self.externals()]
            lines.append(f"EXTERNALS = {{{', '.join(made)}}}")
        return lines

    def externals(self) -> list[core.External]:
        return [e for e in self.program.externals if e.name in self.knowledge.used]

    def shared_methods(self) -> Lines:
        lines: Lines = []
        if any(e.initial is not Start.UNSET for e in self.program.allwrite):
            lines += ["", *self.declare(self.program.allwrite)]
        for function in self.program.functions:
            if function.name in self.knowledge.used & self.knowledge.methods:
                lines += ["", *self.function(function, in_method=True)]
        for external in self.externals():
            lines += ["", *self.external(external)]
        return lines

    def declare(self, allwrite: Iterable[core.Declaration]) -> Lines:
        """Set the allwrite variables to their initial values. [INIT]"""
        scope = self.scope(None, sure=set())
        body: Lines = []
        for entry in allwrite:
            if entry.initial is Start.UNSET:
                continue
            name = self.names.attribute(entry.variable, None)
            body.append(f"self.{name} = {self.initial(scope, entry, name).text}")
            scope.assigned.add((Home.ALLWRITE, entry.variable.slot))
        return ["def declare(self) -> None:", *indented(body)]

    def initial(self, scope: Scope, entry: core.Declaration, name: str) -> Code:
        if isinstance(entry.initial, Start):
            asked = "start_shared" if entry.variable.home is Home.ALLWRITE else "start"
            return Code(f"self.{asked}({string(name)})")
        return expression(scope, entry.initial)

    # --- bodies ---------------------------------------------------------------------------------

    def scope(
        self,
        agent: int | None,
        *,
        sure: set[tuple[Home, int]] | None = None,
        in_method: bool = True,
    ) -> Scope:
        if sure is None:
            own = self.knowledge.own[agent] if agent is not None else set()
            sure = self.knowledge.shared | own
        return Scope(
            self.names,
            self.knowledge,
            agent,
            in_method,
            taken=self.names.locals_taken(),
            assigned=set(sure),
            watching=self.watching,
        )

    def blanks(self, scope: Scope) -> Lines:
        """Variables that are read before anything need be stored in them."""
        lines = []
        for slot, variable in sorted(scope.unset.items()):
            of = annotation(self.names, variable.type)
            lines.append(f"{scope.bound[slot]}: {of} = UNSET")
        return lines

    def where(self, span: Span) -> str:
        return f'"""{self.line(span)}"""'

    def line(self, span: Span) -> str:
        return f"{one_line(span.file)}:{span.line}"


def _guide(text: str) -> Lines:
    """Comments that explain the generated text to its readers."""
    said = []
    if "self.enter(" in text:
        said.append("# enter(k): an atomic block of lock class k; one robot a round is let through")
    if "self.set(" in text:
        said.append("# set(name, value, path): a write of a shared variable, or of a part of it")
    if re.search(r"\bkey\b|choose\(", text):
        said.append("# (2, i): which evaluation of choose or of an external function it is")
    if re.search(r'"\d+:\d+"', text):
        said.append(
            '# "12:5": the line and the column of what may fault, or is written to a stream'
        )
    return [*said, ""] if said else []


def one_line(name: str) -> str:
    """A file's name on one line, for a docstring or a comment."""
    return "".join(c if c.isprintable() and c not in '"\\' else "_" for c in name)


def _returns(body: core.Block) -> bool:
    """Return whether a body surely ends with ``return``."""
    return any(
        isinstance(s, core.Return)
        or (isinstance(s, core.If) and _returns(s.then) and _returns(s.otherwise))
        or (isinstance(s, core.Atomic) and _returns(s.body))
        for s in body
    )
