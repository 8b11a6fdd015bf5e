"""Canonical forms of slices and of claims: all that a verdict depends on, and nothing else.

Two slices with equal forms are the same but for numbers that mean nothing by themselves: places in
the text, slots of variables, positions of events, numbers of calls and of lock classes. What a
slice leaves out [T-CONE] has no part in its form. So a variable or an event that is added beside it
changes nothing, wherever it stands. Nor does what may change places (``orders.py``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from fractions import Fraction
from functools import cached_property
from hashlib import blake2b
from typing import Any, TypeAlias

from msgspec import Struct, field
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.auxiliary import Var, variables, variables_of
from koord.syntax.core import Home
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import BaseType
from koord.syntax.walk import nodes
from koord.verify.cache.orders import in_order, statement_in_order
from koord.verify.claims import Claim
from koord.verify.reduction.influence import Happens, Matter, Part

#: What has no place in a slice. Equal things that a slice leaves out are equal constants.
_OUTSIDE = -1

_Numbers: TypeAlias = Mapping[Any, int]


def digest(*texts: str) -> str:
    """A digest of some texts: 64 hexadecimal digits."""
    found = blake2b(digest_size=32)
    for text in texts:
        raw = text.encode("utf-8", "surrogatepass")
        found.update(len(raw).to_bytes(8, "big"))
        found.update(raw)
    return found.hexdigest()


class Numbering(Struct, frozen=True, dict=True):
    """The new numbers of the parts of a slice: of its variables, events and lock classes."""

    variables: _Numbers  #: by ``Var``
    events: _Numbers  #: by ``(kind, position)``
    classes: _Numbers  #: by index

    @cached_property
    def layout(self) -> str:
        """The old numbers of all of them, in their order: those of a run mean the same in it."""
        found = [f"{v.home.value} {v.kind} {v.slot}" for v in self.variables]
        found += [f"event {kind} {position}" for kind, position in self.events]
        return "; ".join(found)


class Form(Struct, frozen=True, dict=True):
    """The form of one slice of a system; ``inside`` are the variables and events that it has."""

    system: System
    inside: frozenset[Part]
    places: list[Span] = field(default_factory=list)  #: of all nodes that were written, in order

    @classmethod
    def of(cls, system: System, inside: frozenset[Part]) -> Form:
        """The form of a sliced system. Without whole runs in it nothing is expected of these."""
        program = in_order(system.program)
        if Matter.WHOLE_RUNS not in inside:
            program = replace(program, expectations=())
        return cls(replace(system, program=program), inside)

    @cached_property
    def numbering(self) -> Numbering:
        program = self.system.program
        inside = [v for v in variables(program) if v in self.inside]
        events = [
            (kind, position)
            for kind, agent in enumerate(program.agents)
            for position in range(len(agent.events))
            if Happens(kind, position) in self.inside
        ]
        bodies = (program.agents, program.functions)
        entered = {node.lock_class for node in nodes(bodies) if isinstance(node, core.Atomic)}
        for kind, position in events:
            entered |= program.agents[kind].events[position].lock_classes
        return Numbering(_numbered(inside), _numbered(events), _numbered(sorted(entered)))

    @cached_property
    def text(self) -> str:
        """The slice in full, without what is claimed of it."""
        program, system = self.system.program, self.system
        writer = _Writer(program, self.numbering, self.places)
        for kind, agent in enumerate(program.agents):
            writer.agent(kind, agent)
        for home, declared in ((Home.ALLREAD, program.allread), (Home.ALLWRITE, program.allwrite)):
            writer.word(home.value)
            writer.declarations(declared, home, None)
        writer.write((program.functions, program.externals), None)
        for assumption in program.assumptions:
            writer.write((assumption.condition, assumption.bound), None)
        writer.write(program.expectations, None)
        for each in program.lock_classes:
            if each.index in self.numbering.classes:
                writer.write(each.variables, None)
        writer.write((program.tasks, system.kinds, system.delta_s, repr(system.crowd)), None)
        return writer.text

    def claim(self, claim: Claim) -> str:
        """A claim about the slice."""
        writer = _Writer(self.system.program, self.numbering, self.places)
        writer.claim(claim)
        return writer.text


def named(program: core.Program, claim: Claim) -> str:
    """A claim by the names of what it reads: the same in all slices, but of two it may be alike."""
    variables_ = dict.fromkeys(variables(program), 0)
    events = {
        (kind, position): event.name
        for kind, agent in enumerate(program.agents)
        for position, event in enumerate(agent.events)
    }
    writer = _Writer(program, Numbering(variables_, {}, {}), [])
    writer.claim(claim)
    ran = [node.events for node in nodes(claim.stated) if isinstance(node, core.Ran)]
    return writer.text + repr([[events[each] for each in found] for found in ran])


def _numbered(parts: Iterable[Any]) -> dict[Any, int]:
    return {part: number for number, part in enumerate(parts)}


class _Words(dict[BaseType, str]):
    """A cache: the words for types, of which a program has few and names many times."""

    def __missing__(self, type_: BaseType) -> str:
        self[type_] = found = repr(type_)
        return found


_WORDS = _Words()


class _Writer:
    """Writes parts of a program as words, with the numbers of a slice."""

    def __init__(self, program: core.Program, numbering: Numbering, places: list[Span]) -> None:
        self._program, self._numbering, self._places = program, numbering, places
        self._sites: dict[int, int] = {}
        self._words: list[str] = []
        self.word: Callable[[str], None] = self._words.append

    @property
    def text(self) -> str:
        return "\x1f".join(self._words)

    def agent(self, kind: int, agent: core.Agent) -> None:
        """Write what one kind of robots has of the slice."""
        numbers, ports = self._numbering, agent.ports
        kept = [
            port for k, port in enumerate(ports) if Var(Home.PORT, kind, k) in numbers.variables
        ]
        self.word(f"agent {agent.name!r} {agent.init_bound}")
        self.declarations(agent.locals, Home.LOCAL, kind)
        self.write(tuple(kept), kind)
        for module in agent.modules:
            owned = [numbers.variables.get(Var(Home.PORT, kind, k), _OUTSIDE) for k in module.ports]
            inside = [number for number in owned if number != _OUTSIDE]
            if inside or module.environment or module.contracts:
                self.word(f"module {module.name!r} {inside}")
                self.write((module.environment, module.environment_bound, module.contracts), kind)
        self.write(agent.init, kind)
        for position, event in enumerate(agent.events):
            if (kind, position) in numbers.events:
                classes = sorted(numbers.classes[k] for k in event.lock_classes)
                self.word(f"event {event.name!r} {event.urgent} {event.bound} {classes}")
                self._places.append(event.span)
                self.write((event.guard, event.effect), kind)

    def claim(self, claim: Claim) -> None:
        """Write a claim; what somebody calls a statement is nothing that it states."""
        stated = claim.stated
        name = claim.name if stated is None else ""
        unnamed = None
        if stated is not None:
            said = statement_in_order(self._program, stated.condition)
            unnamed = replace(stated, name="", condition=said)
        self.write((claim.kind, name, claim.subject, unnamed), None)

    def declarations(
        self, declared: tuple[core.Declaration, ...], home: Home, kind: int | None
    ) -> None:
        """Write those of some declarations that are in the slice."""
        inside = self._numbering.variables
        self.write(tuple(d for k, d in enumerate(declared) if Var(home, kind, k) in inside), kind)

    def write(self, value: object, kind: int | None) -> None:
        """Write a value; ``kind`` is that of the robots whose text it is, None outside of those."""
        match value:
            case tuple():
                self.word(f"({len(value)}")
                for part in value:
                    self.write(part, kind)
            case core.Variable():
                self._variable(value, kind)
            case BaseType():
                self.word(_WORDS[value])
            case Struct():
                self._struct(value, kind)
            case Enum():
                self.word(f"{type(value).__name__}.{value.name}")
            case None | bool() | int() | str() | Fraction():
                self.word(f"{type(value).__name__} {value!r}")
            case _:
                raise AssertionError(f"{type(value).__name__} has no form")

    def _struct(self, value: Struct, kind: int | None) -> None:
        self.word(type(value).__name__)
        for name in value.__struct_fields__:
            part = getattr(value, name)
            match name:
                case "span":
                    self._places.append(part)
                case "site":
                    self.word(f"site {self._sites.setdefault(part, len(self._sites))}")
                case "events" if isinstance(value, core.Ran):
                    numbers = self._numbering.events
                    self.word(f"events {[(k, numbers.get((k, n), _OUTSIDE)) for k, n in part]}")
                case "lock_class":
                    self.word(f"class {self._numbering.classes[part]}")
                case _:
                    self.write(part, kind)

    def _variable(self, variable: core.Variable, kind: int | None) -> None:
        if variable.home is Home.BOUND:
            numbers = str(variable.slot)
        else:
            found = variables_of(self._program, variable, kind)
            numbers = repr(
                [(each.kind, self._numbering.variables.get(each, _OUTSIDE)) for each in found]
            )
        self.word(f"{variable.home.name} {variable.name!r} {numbers}")
        self.write(variable.type, kind)
