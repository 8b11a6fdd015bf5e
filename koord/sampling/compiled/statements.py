"""Python text of statements: those of functions, of events and of environments.

What may fault is in doubt, so the text only says what happens where nothing does. [S-SEQ]
"""

from __future__ import annotations

from typing import ClassVar, assert_never

from koord.sampling.compiled.expressions import Names, NoCodeError, Writer
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import ArrayType, QueueType, RecordType, Type

INDENT = "    "


class BodyWriter(Writer):
    """A writer of a body: its lines, and how deep inside it they stand."""

    def __init__(self, names: Names, depth: int = 1) -> None:
        super().__init__(names)
        self.lines: list[str] = []
        self.depth = depth
        self.loops = 0
        #: What is around the place in the text, as in keys of answers. [RECORDING]
        self.trail: list[str] = []

    # --- what bodies differ in -------------------------------------------------------------------

    def write(self, place: core.Place, value: str) -> None:
        """Write a variable of the system, or a part of it."""
        raise NoCodeError(f"{place.variable.name} is written in a function")

    def leave(self, value: core.Expr | None) -> None:
        """Return from the body. [S-RETURN]"""
        raise NoCodeError("an event returns")

    def simple(self, s: core.Atomic | core.Stop | core.TryStop | core.Output) -> None:
        """A statement of events alone."""
        raise NoCodeError(f"{type(s).__name__} in a function")

    # --- statements ------------------------------------------------------------------------------

    def line(self, text: str) -> None:
        self.lines.append(INDENT * self.depth + text)

    def begin(self, bound: int) -> None:
        """Name the bound variables of a body, which are not set at first."""
        for slot in range(bound):
            name = self.bound[slot] = self.names.new("b")
            self.line(f"{name} = UNSET")

    def block(self, block: core.Block) -> None:
        """Statements one below the other, a step deeper. [S-SEQ]"""
        self.depth += 1
        if not block:
            self.line("pass")
        for s in block:
            self.statement(s)
        self.depth -= 1

    def statement(self, s: core.Stmt) -> None:
        """One statement."""
        match s:
            case core.Assign():
                self.assign(s.place, self.sure(s.value))
            case core.If():
                # [S-IF]
                self.line(f"if {self.expression(s.condition)}:")
                self.block(s.then)
                if s.otherwise:
                    self.line("else:")
                    self.block(s.otherwise)
            case core.ForRange():
                # [S-FOR]
                name = self.bound[s.variable.slot]
                low, high = self.expression(s.low), self.expression(s.high)
                self._loop(name, f"range({low}, {high})", None, s.body)
            case core.ForEach():
                # [S-FOREACH]
                key = self.bound[s.key.slot] if s.key is not None else self.names.new("b")
                item = self.bound[s.value.slot]
                self._loop(f"{key}, {item}", None, f"pairs({self.sure(s.sequence)})", s.body)
            case core.Break():
                # [S-BREAK]
                if not self.loops:
                    raise NoCodeError("break outside of loops")
                self.line("break")
            case core.Return():
                self.leave(s.value)
            case core.Append():
                # [S-APPEND]
                whole = self.sure(core.Read(s.place, span=s.span))
                self.assign(s.place, f"appended({self.sure(s.value)}, {whole})")
            case core.Remove():
                # [S-REMOVE]
                rest = self.names.new("t")
                whole = self.sure(core.Read(s.place, span=s.span))
                self.line(f"{rest} = removed(D, {self.sure(s.value)}, {whole})")
                self.line(f"if {rest} is not UNSET:")
                self.depth += 1
                self.assign(s.place, rest)
                self.depth -= 1
            case core.Pop():
                self._pop(s)
            case core.Atomic() | core.Stop() | core.TryStop() | core.Output():
                self.simple(s)
            case _:
                assert_never(s)

    def _loop(self, names: str, numbers: str | None, over: str | None, body: core.Block) -> None:
        """A loop over numbers, or over something else, whose trips are numbered."""
        number = self.names.new("t")
        if numbers is not None:
            self.line(f"for {number} in {numbers}:")
            self.line(f"{INDENT}{names} = {number}")
        else:
            self.line(f"for {number}, ({names}) in enumerate({over}):")
        self.line(f"{INDENT}spend()")
        self.loops += 1
        self.trail.append(number)
        self.block(body)
        self.trail.pop()
        self.loops -= 1

    def _pop(self, s: core.Pop) -> None:
        """The first of a queue, or the last of a list. [S-POP]"""
        taken, rest = self.names.new("t"), self.names.new("t")
        position = 0 if isinstance(s.place.type, QueueType) else -1
        whole = self.sure(core.Read(s.place, span=s.span))
        self.line(f"{taken}, {rest} = popped({whole}, {position})")
        self.assign(s.place, rest)
        if s.into is not None:
            self.assign(s.into, taken)

    def assign(self, place: core.Place, value: str) -> None:
        """Write a place. [S-ASSIGN]"""
        variable = place.variable
        if variable.home is not Home.BOUND:
            self.write(place, value)
            return
        if is_tree(variable.type):
            raise NoCodeError("a record or array of a function is written")
        name = self.bound[variable.slot]
        if place.steps:
            part = self.names.new("t")
            self.line(f"{part} = {value}")
            value = f"put_inside(D, {name}, {self.locations(place.steps)}, {part})"
        self.line(f"{name} = {value}")

    def locations(self, steps: tuple[core.Step, ...]) -> str:
        """The steps of a place, evaluated. [LOCATION]"""
        made = []
        for step in steps:
            match step:
                case core.FieldStep():
                    made.append(f"at_field({step.position}), ")
                case core.IndexStep():
                    made.append(f"at_index({self.expression(step.index)}), ")
                case core.KeyStep():
                    made.append(f"at_key({self.expression(step.key)}), ")
                case _:
                    assert_never(step)
        return f"({''.join(made)})"

    # --- what is asked ---------------------------------------------------------------------------

    def call(self, e: core.Call) -> str:
        return call_text(self, e, "pid, ask", [*self.trail, str(e.site)])

    def choose(self, e: core.Choose) -> str:
        """A choice, by who is asked. [CHOOSE]"""
        type_ = self.names.new("k", e.type)
        key = tuple_text([str(e.site), *self.trail])
        return f"ask.choose({key}, {self.sure(e.low)}, {self.sure(e.high)}, {type_})"

    def external(self, e: core.ExternalCall) -> str:
        """A call of an external function, by who is asked. [EXTERNAL]"""
        call = self.names.new("k", e)
        arguments = tuple_text([self.sure(argument) for argument in e.arguments])
        return f"ask.external({call}, {tuple_text(self.trail)}, {arguments})"


class EventWriter(BodyWriter):
    """A writer of the bodies of events, and of what environments do, which is less.

    ``stops`` and ``asks`` are the lines for a robot that stops, and for one that would.
    """

    stops: ClassVar[str]
    asks: ClassVar[str]
    in_environment = False

    def simple(self, s: core.Atomic | core.Stop | core.TryStop | core.Output) -> None:
        if self.in_environment:
            raise NoCodeError("a statement of events")
        match s:
            case core.Atomic():
                # [ATOMIC]
                self.line(f"entered |= {self.names.new('k', frozenset((s.lock_class,)))}")
                for inner in s.body:
                    self.statement(inner)
            case core.Stop():
                self.line(self.stops)
            case core.TryStop():
                self.line(self.asks)
            case core.Output():
                # [OUTPUT]
                values = "".join(f"{self.sure(value)}, " for value in s.values)
                types = self.names.new("k", tuple(value.type for value in s.values))
                self.line(f"written += (Written({s.stream!r}, ({values}), {types}),)")


class _FunctionWriter(BodyWriter):
    def leave(self, value: core.Expr | None) -> None:
        self.line("return UNSET" if value is None else f"return {self.sure(value)}")

    def pid(self) -> str:
        return "sure(pid)"


def function_text(names: Names, function: core.Function) -> str:
    """Write a function defined in Koord; its name. [E-CALL]"""
    name = names.new("f")
    writer = _FunctionWriter(names)
    writer.trail = ["*trail"]
    writer.begin(function.bound)
    given = [writer.bound[slot] for slot in range(len(function.parameters))]
    for line in [f"{one} = UNSET" for one in given]:
        writer.lines.remove(INDENT + line)
    writer.depth -= 1
    writer.block(function.body)
    writer.depth += 1
    writer.line("return UNSET")
    names.texts += [f"def {name}({', '.join(['pid', 'ask', 'trail', *given])}):", *writer.lines]
    names.functions[function.name] = name
    return name


def call_text(writer: Writer, e: core.Call, asking: str, trail: list[str]) -> str:
    """A call of a function, which has a text of its own. [E-CALL]"""
    names = writer.names
    name = names.functions.get(e.function)
    if name is None:
        name = function_text(names, names.system.program.function(e.function))
    arguments = [writer.sure(argument) for argument in e.arguments]
    return f"sure({name}({', '.join([asking, tuple_text(trail), *arguments])}))"


def tuple_text(parts: list[str]) -> str:
    return f"({''.join(f'{part}, ' for part in parts)})"


def is_tree(type_: Type) -> bool:
    """Return whether storage of a type is a tree, and no atom. [ATOM]"""
    return isinstance(type_, RecordType | ArrayType)
