"""Drafts: the state of a program generator, with its random choices, names and scopes."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from random import Random
from typing import TypeVar

from msgspec import Struct, field

from koord.refinement.generating.palette import Palette, Profile
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.source import Span
from koord.syntax.types import Type

T = TypeVar("T")


class ReadScope(IntEnum):
    """The reads that a function's body may have, which limit where it may be called."""

    NOTHING = 0  #: its parameters: from everywhere
    SHARED = 1  #: the store too: from events and properties
    ROBOT = 2  #: ``pid`` too: from events


class Draft(Struct):
    """A program under construction: random generator, counters, and functions so far."""

    random: Random
    profile: Profile
    palette: Palette
    functions: list[tuple[ReadScope, core.Function]] = field(default_factory=list)
    externals: list[core.External] = field(default_factory=list)
    unset: set[str] = field(default_factory=set)  #: names that may well hold nothing yet
    _line: int = 0
    _site: int = 0
    _name: int = 0

    def span(self) -> Span:
        """A distinct span for each node, so that faults can be told apart."""
        self._line += 1
        return Span("generated", self._line, 1, self._line, 2)

    def site(self) -> int:
        """A fresh number for a call or choice."""
        self._site += 1
        return self._site

    def name(self, prefix: str) -> str:
        """A fresh name."""
        self._name += 1
        return f"{prefix}{self._name}"

    def chance(self, probability: float) -> bool:
        return self.random.random() < probability

    def between(self, bounds: tuple[int, int]) -> int:
        return self.random.randint(*bounds)

    def pick(self, options: Sequence[T]) -> T:
        return self.random.choice(options)

    def weighted(self, options: Sequence[tuple[float, T]]) -> T:
        weights = [weight for weight, _ in options]
        return self.random.choices([option for _, option in options], weights)[0]

    def type(self) -> Type:
        """A random type for a variable."""
        return self.pick(self.palette.all)

    def scalar(self) -> Type:
        return self.pick(self.palette.scalars)


class Slots(Struct):
    """The BOUND slots of one body."""

    used: int = 0

    def fresh(self, draft: Draft, type_: Type) -> core.Variable:
        """A fresh bound variable."""
        variable = core.Variable(Home.BOUND, self.used, draft.name("b"), type_)
        self.used += 1
        return variable


class Context(Struct):
    """The context of a generated expression or statement: the variables in scope.

    ``bound`` are the bound variables that hold a value there. In a property, ``robots`` are those
    that range over robots, with their agent kind (None: any); then locals and ports need one.
    """

    draft: Draft
    slots: Slots
    variables: list[core.Variable] = field(default_factory=list)
    writable: list[core.Variable] = field(default_factory=list)
    bound: list[core.Variable] = field(default_factory=list)
    robots: list[tuple[core.Variable, int | None]] = field(default_factory=list)
    primed: list[core.Variable] = field(default_factory=list)
    kinds: dict[tuple[Home, str], int] = field(default_factory=dict)
    events: list[tuple[int, int, str]] = field(default_factory=list)
    pid: bool = True
    in_property: bool = False
    calls: ReadScope | None = ReadScope.ROBOT
    externals: bool = True
    choices: bool = False
    result: Type | None = None
    loops: int = 0
    atomic: int | None = None
    may_lock: bool = False
    classes: dict[int, int] = field(default_factory=dict)
    entered: set[int] = field(default_factory=set)
    constant: bool = False  #: only what a loop's bound may be built from

    def inner(self) -> Context:
        """A context for an inner block, whose bindings are unknown outside."""
        return Context(
            draft=self.draft,
            slots=self.slots,
            variables=self.variables,
            writable=self.writable,
            bound=self.bound.copy(),
            robots=self.robots.copy(),
            primed=self.primed,
            kinds=self.kinds,
            events=self.events,
            pid=self.pid,
            in_property=self.in_property,
            calls=self.calls,
            externals=self.externals,
            choices=self.choices,
            result=self.result,
            loops=self.loops,
            atomic=self.atomic,
            may_lock=self.may_lock,
            classes=self.classes,
            entered=self.entered,
        )
