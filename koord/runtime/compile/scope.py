"""Pieces of compiled Python, and the context in which they stand."""

from __future__ import annotations

from msgspec import Struct, field
from msgspec.structs import replace

from koord.runtime.compile.knowledge import Knowledge
from koord.runtime.compile.naming import PythonNames, string, tuple_of
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.source import Span

#: How tightly the parts of a Python expression hold together.
OR, AND, NOT, COMPARE, ADD, MULTIPLY, NEGATE, ATOM = range(8)


class Code(Struct, frozen=True):
    """A piece of Python: its text, its precedence, and whether it may fault."""

    text: str
    level: int = ATOM
    faults: bool = False

    def within(self, level: int) -> str:
        """The text as an operand at a precedence, in parentheses if need be."""
        return self.text if self.level >= level else f"({self.text})"


class Scope(Struct):
    """The context of an expression in compiled code: names of variables, and facts about them.

    ``trail`` are the loops, quantifiers and calls around, outermost first, as Python expressions.
    ``ranges`` are the variables of loops that no statement writes, with the loop's upper bound.
    """

    names: PythonNames
    knowledge: Knowledge
    agent: int | None
    in_method: bool = True
    in_environment: bool = False
    trail: tuple[str, ...] = ()
    bound: dict[int, str] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)
    #: Variables that surely hold something where the scope stands, by home and slot.
    assigned: set[tuple[Home, int]] = field(default_factory=set)
    #: Bound slots that are looked at where nothing may have been stored in them yet.
    unset: dict[int, core.Variable] = field(default_factory=dict)
    ranges: dict[int, core.Expr] = field(default_factory=dict)
    #: Ports that the environment writes, and the local variables that they are written to.
    after: dict[int, str] = field(default_factory=dict)
    watching: bool = False  #: in claims, which are about all robots and of no one

    def name(self, variable: core.Variable) -> str:
        """The local variable of a bound slot."""
        if variable.slot not in self.bound:
            self.bound[variable.slot] = self.names.local(variable.name, self.taken)
        return self.bound[variable.slot]

    def temporary(self, name: str) -> str:
        """A local variable of the compiler's own."""
        return self.names.local(name, self.taken)

    def inner(self, label: str) -> Scope:
        """The scope inside a loop or a quantifier."""
        return replace(self, trail=(*self.trail, label))

    def place(self, span: Span) -> str:
        """A place in the text, as a string literal."""
        where = f"{span.line}:{span.column}"
        return string(where if span.file == self.names.file else f"{span.file}:{where}")

    def key(self, site: int) -> str:
        """The key of an answer. [RECORDING]"""
        return tuple_of([str(site), *self.trail])

    def trail_to(self, site: int) -> str:
        """The trail of the body of a function that is called at a site."""
        return tuple_of([*self.trail, str(site)])

    def is_sure(self, variable: core.Variable) -> bool:
        """Return whether a variable surely holds a value in this scope."""
        return (variable.home, variable.slot) in self.assigned
