"""Influence analysis: dependencies between parts of a program, for slicing. [T-CONE]

The *cone of influence* of a claim is the least set with what the claim reads that is closed under
``Influence.edges``. The rest of the program can be left out (``slicing.py``).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import Enum
from typing import TypeAlias

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.analysis.auxiliary import Var, variables_of
from koord.syntax.analysis.definedness import Sure
from koord.syntax.core import Home
from koord.syntax.system import System
from koord.syntax.walk import children, nodes, operands, reached, statements, written
from koord.verify.claims import Claim, ClaimKind


class BodyVariable(Struct, frozen=True):
    """A bound variable of one body; bodies are numbered."""

    body: int
    slot: int


class Happens(Struct, frozen=True):
    """The part that robots of a kind run an event, by its position."""

    kind: int
    position: int


class Answers(Struct, frozen=True):
    """The part that an external function answers."""

    function: str


class Matter(Enum):
    """The parts that are neither variables nor events."""

    STATUS = "who has stopped"
    FAULT = "whether something faults"
    WHOLE_RUNS = "which runs are fair"


Part: TypeAlias = Var | BodyVariable | Happens | Answers | Matter

#: Stands for the body of a statement that is only evaluated: nothing is bound there but by itself.
_STATED = 0

#: A set of parts that is closed under influence.
Cone: TypeAlias = frozenset[Part]


class Site(Struct, frozen=True):
    """A statement, with the conditions on which its execution depends."""

    statement: core.Stmt
    controls: tuple[core.Expr, ...]
    sure: Sure


class Influence(Struct):
    """The influence graph of a system's program: the influences on each part of it."""

    system: System
    edges: dict[Part, set[Part]] = field(default_factory=dict)
    risky: set[int] = field(default_factory=set)  #: statements that may fault, by identity
    targets: dict[int, set[Part]] = field(default_factory=dict)  #: what statements write, likewise
    _bodies: int = 0
    _known: dict[tuple[int, int | None, int], frozenset[Part]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for kind, agent in enumerate(self.program.agents):
            self._starts(kind, agent)
            self._init(kind, agent)
            for position, event in enumerate(agent.events):
                self._event(Happens(kind, position), event)
            for module in agent.modules:
                self._module(kind, module)
        self._shared()
        self._urgency()
        self._assumptions()
        self._summaries()
        self._fairness()

    @property
    def program(self) -> core.Program:
        return self.system.program

    def cone(self, claims: Iterable[Claim]) -> Cone:
        """The cone of influence of some claims."""
        return self.closed(part for claim in claims for part in self.read_by(claim))

    def closed(self, parts: Iterable[Part]) -> Cone:
        """The closure of some parts under influence."""
        found = set(parts)
        waiting = list(found)
        while waiting:
            new = self.edges.get(waiting.pop(), set()) - found
            found |= new
            waiting += new
        return frozenset(found)

    def read_by(self, claim: Claim) -> frozenset[Part]:
        """The parts that a claim reads itself."""
        match claim.kind:
            case ClaimKind.PROPERTY | ClaimKind.LIVENESS:
                assert claim.stated is not None
                stated = (claim.stated.condition, claim.stated.trigger)
                whole = {Matter.WHOLE_RUNS} if claim.kind is ClaimKind.LIVENESS else set()
                return self.reads(stated, None) | whole
            case ClaimKind.FAULT:
                return frozenset({Matter.FAULT})
            case ClaimKind.LOST_UPDATE:
                return frozenset(
                    Var(Home.ALLWRITE, None, slot)
                    for slot, declaration in enumerate(self.program.allwrite)
                    if declaration.variable.name == claim.subject
                )
            case ClaimKind.CONTRACT:
                return frozenset(
                    part
                    for kind, agent in enumerate(self.program.agents)
                    for module in agent.modules
                    for contract in module.contracts
                    if module.environment is not None and contract.name == claim.subject
                    for part in self.reads((contract.requires, contract.ensures), kind)
                )

    def reads(self, part: object, kind: int | None, body: int = _STATED) -> frozenset[Part]:
        """The parts that an expression, or a tuple of them, reads, for one kind of robots or
        all.
        """
        key = (id(part), kind, body)
        if isinstance(part, tuple):
            return frozenset(x for item in part for x in self.reads(item, kind, body))
        if key not in self._known:
            found: set[Part] = set()
            for node in reached(self.program, part):
                match node:
                    case core.Variable():
                        found.update(self.variable(node, kind, body))
                    case core.Ran(events=events):
                        found.update(Happens(*event) for event in events)
                    case core.Stopped():
                        found.add(Matter.STATUS)
                    case core.ExternalCall(function=function):
                        found.add(Answers(function))
                    case _:
                        pass
            self._known[key] = frozenset(found)
        return self._known[key]

    def variable(
        self, variable: core.Variable, kind: int | None, body: int = _STATED
    ) -> Iterator[Part]:
        """The parts that a variable stands for: in a property, one for each kind that has it."""
        if variable.home is Home.BOUND and body != _STATED:
            yield BodyVariable(body, variable.slot)
        yield from variables_of(self.program, variable, kind)

    # --- edges ----------------------------------------------------------------------------------

    def _add(self, part: Part, by: Iterable[Part]) -> None:
        self.edges.setdefault(part, set()).update(by)

    def _starts(self, kind: int, agent: core.Agent) -> None:
        ports = (port.declaration for port in agent.ports)
        for declaration in (*agent.locals, *ports):
            self._start(declaration, kind)

    def _shared(self) -> None:
        for declaration in self.program.allwrite:
            self._start(declaration, None)
        for declaration in self.program.allread:
            for kind in range(len(self.program.agents)):
                self._start(declaration, kind)

    def _start(self, declaration: core.Declaration, kind: int | None) -> None:
        """Add the influences on a variable's start."""
        if isinstance(declaration.initial, core.Start):
            return
        reads = self.reads(declaration.initial, kind)
        for part in self.variable(declaration.variable, kind):
            self._add(part, reads)
        if not Sure(self.system, kind, in_init=True).of(declaration.initial):
            self._add(Matter.FAULT, (*reads, *self.variable(declaration.variable, kind)))

    def _init(self, kind: int, agent: core.Agent) -> None:
        """Add the influences of INIT: a robot that stops there runs nothing later."""
        for stop in self._body(kind, agent.init, (), in_init=True):
            self._add(Matter.STATUS, stop)
            for k, other in enumerate(self.program.agents):
                for position in range(len(other.events)):
                    self._add(Happens(k, position), stop)

    def _event(self, happens: Happens, event: core.Event) -> None:
        reads = self.reads(event.guard, happens.kind, self._bodies + 1)
        self._add(happens, reads)
        if not Sure(self.system, happens.kind).of(event.guard):
            self._add(Matter.FAULT, (happens,))
        for entered in self._body(happens.kind, event.effect, (happens,)):
            self._add(happens, entered)
        if any(isinstance(s, core.Stop | core.TryStop) for s in statements(event.effect)):
            self._add(Matter.STATUS, (happens,))

    def _body(
        self, kind: int, block: core.Block, by: tuple[Part, ...], *, in_init: bool = False
    ) -> Iterator[frozenset[Part]]:
        """Add the influences in a body; yield the conditions of locks and stops."""
        self._bodies += 1
        body = self._bodies
        for site in sites(block, (), Sure(self.system, kind, in_init=in_init)):
            statement = site.statement
            reads = self.reads((*site.controls, *_operands(statement)), kind, body)
            targets = [
                part
                for place in written(statement)
                for part in self.variable(place.variable, kind, body)
            ]
            self.targets.setdefault(id(statement), set()).update(targets)
            for target in targets:
                # What is written in part keeps the rest, and a list is read before it is longer.
                self._add(target, (*reads, *targets, *by))
            if not site.sure.of_statement(statement):
                self.risky.add(id(statement))
                self._add(Matter.FAULT, (*reads, *targets, *by))
            if isinstance(statement, core.Atomic | core.Stop | core.TryStop):
                yield reads

    def _module(self, kind: int, module: core.Module) -> None:
        if module.environment is not None:
            for _ in self._body(kind, module.environment, ()):
                raise AssertionError("models neither lock nor stop")
            return
        for contract in module.contracts:
            duties = self.reads(contract.requires, kind)
            for promise in contract.ensures:
                reads = duties | self.reads(promise, kind)
                for part in self.restricted(contract, promise, kind):
                    self._add(part, reads)

    def restricted(self, contract: core.Contract, promise: core.Expr, kind: int) -> frozenset[Part]:
        """The parts that a promise of a contract restricts: the ports after the turn that it reads.

        One that says nothing of them restricts which rounds end: all that it reads.
        """
        primed = frozenset(
            part
            for node in nodes(promise)
            if isinstance(node, core.Place) and node.primed
            for part in self.variable(node.variable, kind)
        )
        return primed or self.reads((contract.requires, promise), kind)

    def _urgency(self) -> None:
        """Add the influences of urgency: any event or taken lock ends an obligation. [SKIP]"""
        every = [
            Happens(kind, position)
            for kind, agent in enumerate(self.program.agents)
            for position in range(len(agent.events))
        ]
        if any(event.urgent for agent in self.program.agents for event in agent.events):
            for happens in every:
                self._add(happens, every)

    def _assumptions(self) -> None:
        for assumption in self.program.assumptions:
            reads = self.reads(assumption.condition, None)
            for part in reads:
                self._add(part, reads)

    def _summaries(self) -> None:
        for external in self.program.externals:
            mentioned = self.reads((external.requires, external.ensures), None)
            together = {Answers(external.name), *(p for p in mentioned if isinstance(p, Answers))}
            for part in together:
                self._add(part, together)

    def _fairness(self) -> None:
        for kind, agent in enumerate(self.program.agents):
            for position in range(len(agent.events)):
                self._add(Matter.WHOLE_RUNS, (Happens(kind, position),))
        for expected in self.program.expectations:
            self._add(Matter.WHOLE_RUNS, self.reads((expected.condition, expected.trigger), None))


def sites(block: core.Block, controls: tuple[core.Expr, ...], sure: Sure) -> Iterator[Site]:
    """Yield the statements of a block and those below them, each with its conditions."""
    for s in block:
        yield Site(s, controls, sure)
        match s:
            case core.If(condition=condition, then=then, otherwise=otherwise):
                inner = (*controls, condition)
                yield from sites(then, inner, sure)
                yield from sites(otherwise, inner, sure)
            case core.ForRange(variable=variable, low=low, high=high, body=body):
                inner = (*controls, low, high, *_leaving(body))
                yield from sites(body, inner, sure.in_range(variable.slot, low, high))
            case core.ForEach(key=key, value=value, sequence=sequence, body=body):
                bound = sure.with_value(value.slot)
                bound = bound if key is None else bound.with_value(key.slot)
                yield from sites(body, (*controls, sequence, *_leaving(body)), bound)
            case core.Atomic(body=body):
                yield from sites(body, controls, sure)
            case _:
                pass


def _leaving(body: core.Block) -> Iterator[core.Expr]:
    """The conditions under which a loop is left early, on which its later statements depend."""
    for s in body:
        match s:
            case core.If(condition=condition, then=then, otherwise=otherwise):
                if _leaves(then) or _leaves(otherwise):
                    yield condition
                    yield from _leaving(then)
                    yield from _leaving(otherwise)
            case core.Atomic(body=inside):
                yield from _leaving(inside)
            case _:
                pass


def _leaves(block: core.Block) -> bool:
    """Return whether a block has a ``break`` of its own loop."""
    for s in block:
        match s:
            case core.Break():
                return True
            case core.If(then=then, otherwise=otherwise) if _leaves(then) or _leaves(otherwise):
                return True
            case core.Atomic(body=body) if _leaves(body):
                return True
            case _:
                pass
    return False


def _operands(statement: core.Stmt) -> Iterator[core.Expr]:
    """The expressions that a statement evaluates itself, those in its places included."""
    for part in operands(statement):
        if isinstance(part, core.Place):
            yield from (e for step in part.steps for e in children(step))
        else:
            yield part
