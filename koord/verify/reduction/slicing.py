"""Slicing: a program without the parts outside of a cone of influence. [T-CONE]

Nothing is numbered anew: a variable that is left out leaves a constant in its slot, an event one
that is never enabled. So slots, sites and events mean the same in slice and program.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.auxiliary import (
    Var,
    always_met,
    auxiliary,
    primed,
    promises_of,
    variables,
)
from koord.syntax.core import Direction, Home, PropertyKind
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import BOOL, ArrayType, Robots, Type
from koord.syntax.walk import nodes, reached, statements
from koord.verify.claims import Claim, claims_of, liveness_of
from koord.verify.reachability_goals import Aim, reachability_goals_of
from koord.verify.reduction.influence import Answers, Cone, Happens, Influence, Matter, Part
from koord.verify.reduction.problems import Identity, identity

_FALSE = core.Const(False, BOOL)

_DECLARED = (Home.ALLREAD, Home.ALLWRITE, Home.LOCAL, Home.PORT)

_OF_WHOLE_RUNS = (PropertyKind.EVENTUALLY, PropertyKind.LEADS_TO)


def sliced(influence: Influence, cone: Cone) -> core.Program:
    """Slice a program by a cone."""
    return _Slicer(influence, cone).program()


class _Slicer(Struct, frozen=True, dict=True):
    influence: Influence
    cone: Cone

    def program(self) -> core.Program:
        whole = self.influence.program
        agents = tuple(self._agent(kind, agent) for kind, agent in enumerate(whole.agents))
        kept = replace(
            whole,
            agents=agents,
            allread=tuple(self._shared(declaration) for declaration in whole.allread),
            allwrite=tuple(self._shared(declaration) for declaration in whole.allwrite),
            assumptions=tuple(a for a in whole.assumptions if self._meets(a.condition)),
            properties=tuple(p for p in whole.properties if self._is_inside(p)),
            expectations=whole.expectations if Matter.WHOLE_RUNS in self.cone else (),
            functions=(),
            externals=(),
        )
        asked = {part.function for part in self.cone if isinstance(part, Answers)}
        return _with_functions(whole, kept, asked)

    # --- statements of the program --------------------------------------------------------------

    def _meets(self, stated: core.Expr) -> bool:
        """Return whether a statement restricts parts in the cone, or reads no variables."""
        reads = self.influence.reads(stated, None)
        return not reads or bool(reads & self.cone)

    def _is_inside(self, stated: core.Property) -> bool:
        if stated.kind in _OF_WHOLE_RUNS and Matter.WHOLE_RUNS not in self.cone:
            return False
        return self.influence.reads((stated.condition, stated.trigger), None) <= self.cone

    # --- robots ---------------------------------------------------------------------------------

    def _agent(self, kind: int, agent: core.Agent) -> core.Agent:
        return replace(
            agent,
            locals=tuple(self._declaration(x, kind) for x in agent.locals),
            ports=tuple(self._port(port, kind) for port in agent.ports),
            modules=tuple(self._module(module, kind) for module in agent.modules),
            init=self._block(agent.init, runs=self._starts_matter),
            events=tuple(
                self._event(event) if Happens(kind, position) in self.cone else _never(event)
                for position, event in enumerate(agent.events)
            ),
        )

    @cached_property
    def _starts_matter(self) -> bool:
        """True if stops in INIT matter to the cone."""
        return Matter.STATUS in self.cone or any(isinstance(part, Happens) for part in self.cone)

    def _has(self, variable: core.Variable, kind: int | None) -> bool:
        return Var(variable.home, kind, variable.slot) in self.cone

    def _declaration(self, declaration: core.Declaration, kind: int | None) -> core.Declaration:
        if self._has(declaration.variable, kind):
            return declaration
        return _constant(declaration)

    def _shared(self, declaration: core.Declaration) -> core.Declaration:
        return self._declaration(declaration, None)

    def _port(self, port: core.Port, kind: int) -> core.Port:
        if self._has(port.declaration.variable, kind):
            return port
        # An actuator that nobody writes: the environment reads nothing into it.
        constant = _constant(port.declaration)
        return replace(port, direction=Direction.ACTUATOR, declaration=constant)

    def _module(self, module: core.Module, kind: int) -> core.Module:
        if module.environment is not None:
            return replace(
                module,
                environment=self._block(module.environment, runs=False),
                contracts=tuple(
                    c
                    for c in module.contracts
                    if self.influence.reads((c.requires, c.ensures), kind) <= self.cone
                ),
            )
        contracts = (self._contract(contract, kind) for contract in module.contracts)
        return replace(module, contracts=tuple(c for c in contracts if c is not None))

    def _contract(self, contract: core.Contract, kind: int) -> core.Contract | None:
        """The promises of a contract that restrict parts in the cone, if there are any."""
        restricted = (
            (promise, self.influence.restricted(contract, promise, kind))
            for promise in contract.ensures
        )
        kept = tuple(promise for promise, parts in restricted if not parts or parts & self.cone)
        return replace(contract, ensures=kept) if kept else None

    def _event(self, event: core.Event) -> core.Event:
        return replace(event, effect=self._block(event.effect, runs=True))

    # --- bodies ---------------------------------------------------------------------------------

    def _block(self, block: core.Block, *, runs: bool) -> core.Block:
        """The slice of a block; ``runs``: its locks and stops matter."""
        return tuple(kept for s in block for kept in self._statement(s, runs=runs))

    def _statement(self, s: core.Stmt, *, runs: bool) -> Iterator[core.Stmt]:
        is_risk = self._is_risk(s)
        match s:
            case core.If(then=then, otherwise=otherwise):
                then = self._block(then, runs=runs)
                otherwise = self._block(otherwise, runs=runs)
                if then or otherwise or is_risk:
                    yield replace(s, then=then, otherwise=otherwise)
            case core.ForRange(body=body) | core.ForEach(body=body):
                # A loop that does nothing but end is none.
                if is_risk or any(self._matters(inner, runs=runs) for inner in statements(body)):
                    yield replace(s, body=self._block(body, runs=runs))
            case core.Atomic(body=body):
                body = self._block(body, runs=runs)
                if body or runs:
                    yield replace(s, body=body)
            case core.Break() | core.Return():
                yield s
            case _ if self._matters(s, runs=runs):
                yield s
            case _:
                pass

    def _matters(self, s: core.Stmt, *, runs: bool) -> bool:
        """Return whether a statement itself is in the cone, apart from those in it."""
        if isinstance(s, core.Atomic | core.Stop | core.TryStop):
            return runs
        return self._is_risk(s) or bool(self.influence.targets[id(s)] & self.cone)

    def _is_risk(self, s: core.Stmt) -> bool:
        return Matter.FAULT in self.cone and id(s) in self.influence.risky


def _constant(declaration: core.Declaration) -> core.Declaration:
    """The slice of a variable outside the cone: a constant that costs nothing."""
    variable = declaration.variable
    one_each = variable.home is Home.ALLREAD
    type_: Type = ArrayType(BOOL, Robots.ALL) if one_each else BOOL
    return replace(declaration, variable=replace(variable, type=type_), initial=_FALSE, length=None)


def _never(event: core.Event) -> core.Event:
    """The slice of an event outside the cone: one that is never enabled."""
    return replace(event, urgent=False, guard=_FALSE, effect=(), lock_classes=frozenset())


def _with_functions(whole: core.Program, kept: core.Program, asked: set[str]) -> core.Program:
    """The slice with the functions that it still calls, and the external ones ``asked`` for."""
    defined: set[str] = set()
    external = set(asked)
    waiting: list[object] = [kept, *(whole.external(name) for name in asked)]
    while waiting:
        for node in reached(whole, waiting.pop()):
            match node:
                case core.Call(function=name):
                    defined.add(name)
                case core.ExternalCall(function=name) if name not in external:
                    external.add(name)
                    waiting.append(whole.external(name))
                case _:
                    pass
    return replace(
        kept,
        functions=tuple(f for f in whole.functions if f.name in defined),
        externals=tuple(f for f in whole.externals if f.name in external),
    )


def speaks_of(program: core.Program, stated: core.Property) -> bool:
    """Return whether a program has all that a statement about another slice of it speaks of."""
    declared = {entry.variable for entry in (*program.allread, *program.allwrite)}
    for agent in program.agents:
        declared.update(entry.variable for entry in agent.locals)
        declared.update(port.declaration.variable for port in agent.ports)
    functions = {f.name for f in program.functions} | {f.name for f in program.externals}
    asked = {n.function for n in nodes(stated) if isinstance(n, core.Call | core.ExternalCall)}
    return asked <= functions and all(
        node.variable in declared
        for node in reached(program, stated)
        if isinstance(node, core.Place) and node.variable.home in _DECLARED
    )


class Slices(Struct, frozen=True, dict=True):
    """The slices of one system, by the claims that they are for."""

    system: System

    @cached_property
    def influence(self) -> Influence:
        return Influence(self.system)

    @cached_property
    def everything(self) -> frozenset[Part]:
        """All variables and events of the system."""
        program = self.system.program
        found: set[Part] = {*variables(program)}
        for kind, agent in enumerate(program.agents):
            found.update(Happens(kind, position) for position in range(len(agent.events)))
        return frozenset(found)

    @cached_property
    def claims(self) -> dict[Identity, Claim]:
        """The claims about the system, by their identity across slices."""
        claims = (*claims_of(self.system), *liveness_of(self.system))
        return {identity(claim): claim for claim in claims}

    def cone(self, claims: Iterable[Claim]) -> Cone:
        """The cone of influence of some claims together."""
        return self.influence.cone(claims)

    def returning(self, claims: Iterable[Claim]) -> Cone:
        """The parts to which a lasso that breaks liveness claims has to return. [AUXILIARY]"""
        stated = [claim.stated for claim in claims if claim.stated is not None]
        spared = auxiliary(self.system, stated)
        return self.influence.closed({*self.cone(claims), *(self.everything - spared)})

    def whole(self, claims: Iterable[Claim]) -> Cone:
        """The parts that any claim depends on, and all others."""
        return self.influence.closed({*self.cone(claims), *self.everything})

    def extent(self, cone: Cone) -> frozenset[Part]:
        """The variables and events in a cone, which determine its other parts."""
        return cone & self.everything

    def name(self, part: Part) -> str:
        """The name of a variable or event in the text."""
        program = self.system.program
        match part:
            case Happens(kind=kind, position=position):
                return program.agents[kind].events[position].name
            case Var(home=Home.LOCAL, kind=int(kind), slot=slot):
                return program.agents[kind].locals[slot].variable.name
            case Var(home=Home.PORT, kind=int(kind), slot=slot):
                return program.agents[kind].ports[slot].declaration.variable.name
            case Var(home=Home.ALLREAD, slot=slot):
                return program.allread[slot].variable.name
            case Var(home=Home.ALLWRITE, slot=slot):
                return program.allwrite[slot].variable.name
            case _:
                raise AssertionError(f"{part} has no name")

    def slice_of(self, cone: Cone) -> System:
        """The system sliced by a cone; itself if nothing is outside."""
        if self.extent(cone) == self.everything:
            return self.system
        return replace(self.system, program=sliced(self.influence, cone))

    def common(self) -> System:
        """The system sliced by the cone of all safety claims."""
        claims = claims_of(self.system)
        part = self.slice_of(self.cone(claims))
        # A claim that the slice's own text does not make is asked of the whole.
        same = [identity(claim) for claim in claims_of(part)] == [identity(c) for c in claims]
        return part if same else self.system

    def happening(self) -> System:
        """The system without parts that have no influence on whether events happen.

        Nothing is left out that could keep a run from starting or from going on: what happens in
        the slice happens in the system.
        """
        cone = self.of_events()
        if not self._goes_on_without(cone):
            return self.system
        part = self.slice_of(cone)
        if part is self.system:
            return part
        same = _aims(part) == _aims(self.system) and set(Slices(part).claims) == set(self.claims)
        return part if same else self.system

    def of_events(self) -> Cone:
        """The parts that any claim depends on, or whether any event happens."""
        events = (part for part in self.everything if isinstance(part, Happens))
        return self.influence.closed({*self.cone(self.claims.values()), *events})

    def _goes_on_without(self, cone: Cone) -> bool:
        """Return whether each run of a slice extends to a run of the system. [T-CONE]"""
        program, influence = self.system.program, self.influence
        stated = (influence.reads(each.condition, None) for each in program.assumptions)
        starts = all(not reads or reads & cone for reads in stated)
        answers = all(Answers(e.name) in cone or not e.ensures for e in program.externals)
        return (
            starts
            and answers
            and all(
                influence.restricted(contract, promise, kind) & cone
                or (primed(promise) and primed(promise) <= always_met(self.system, kind))
                for kind, agent in enumerate(program.agents)
                for contract, promise in promises_of(agent)
            )
        )


def _aims(system: System) -> set[tuple[Aim, str, Span]]:
    """The reachability goals of a system, as comparable tuples."""
    return {(goal.aim, goal.subject, goal.span) for goal in reachability_goals_of(system).all}
