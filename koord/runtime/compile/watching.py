"""Compilation of claims: invariants, assumptions, contracts and summaries as methods.

They become functions of a program of their own, which is compiled like any other; the class that
has them looks at robots from outside (:class:`koord.runtime.watch.Watch`).
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from fractions import Fraction

from msgspec import Struct, field
from msgspec.structs import replace

from koord.runtime.compile.module import Module
from koord.runtime.compile.naming import PythonNames, string, tuple_of
from koord.runtime.compile.scope import Scope
from koord.runtime.compile.slack import Loosening
from koord.runtime.compile.statements import Lines, indented
from koord.syntax import core
from koord.syntax.core import Home, PropertyKind, QuantifierKind
from koord.syntax.source import Span
from koord.syntax.types import BOOL
from koord.syntax.walk import nodes


class WatchedKind(Enum):
    """The kinds of compiled claims, which determine when they are checked."""

    INVARIANT = "invariant"
    AT_ROUND = "invariant at round"
    ASSUMPTION = "assumption"
    CONTRACT = "contract"
    SUMMARY = "summary"


class WatchedClaim(Struct, frozen=True):
    """A compiled claim: the method that checks it, and the method's arguments.

    An invariant is given robots, of the ``agents`` that it is about (None: of any); a contract is
    of the robots of one agent; a summary is given the arguments of ``function`` and its answer.
    ``stated`` is the function of the core program that the method is compiled from.
    """

    name: str
    sort: WatchedKind
    span: Span
    method: str
    agents: tuple[int | None, ...] = ()
    function: str = ""
    looks: Looks | None = None
    stated: str = ""


class Looks(Struct, frozen=True):
    """The reads of an invariant: attributes of the given robots, and shared variables.

    Attributes of robots, by the position of the robot among those that are given; allread variables
    at these robots' entries; and shared variables as a whole.
    """

    own: tuple[frozenset[str], ...]
    entries: tuple[frozenset[str], ...]
    shared: frozenset[str]


class Watched(Struct):
    """The claims of a program, the text of the module that checks them, and the core program of it.

    That has the claims as functions.
    """

    claims: tuple[WatchedClaim, ...]
    text: str
    program: core.Program


def watched(program: core.Program, slack: Fraction) -> Watched:
    """Compile the claims of a program, with a slack (in metres) except for summaries."""
    return _Gathering(program, slack).watched()


class _Gathering(Struct):
    program: core.Program
    slack: Fraction
    claims: list[WatchedClaim] = field(default_factory=list)
    functions: list[core.Function] = field(default_factory=list)

    def watched(self) -> Watched:
        loosening = Loosening(self.program, self.slack)
        for stated in self.program.properties:
            if stated.kind in (PropertyKind.INVARIANT, PropertyKind.AT_ROUND):
                at_round = stated.kind is PropertyKind.AT_ROUND
                sort = WatchedKind.AT_ROUND if at_round else WatchedKind.INVARIANT
                loose = loosening.expression(stated.condition)
                self._of_robots(stated.name, sort, stated.span, loose, stated.bound)
        for assumed in self.program.assumptions:
            loose = loosening.expression(assumed.condition)
            self._of_robots(
                assumed.name, WatchedKind.ASSUMPTION, assumed.span, loose, assumed.bound
            )
        for kind, agent in enumerate(self.program.agents):
            for module in agent.modules:
                for contract in module.contracts:
                    if module.environment is None:
                        self._of_contract(kind, contract, loosening)
        for external in self.program.externals:
            self._of_summary(external)
        functions = (*self.program.functions, *loosening.functions.values(), *self.functions)
        # Their bodies are in order of dependence as long as loosened ones stand behind the others.
        made = replace(self.program, functions=functions)
        watching = WatchModule(made, PythonNames(self.program), self.claims)
        claims = tuple(replace(c, method=watching.names.methods[c.method]) for c in self.claims)
        return Watched(claims, watching.text(), made)

    def _of_robots(
        self, name: str, sort: WatchedKind, span: Span, e: core.Expr, bound: int
    ) -> None:
        """A statement, without the quantifiers over robots at its beginning."""
        robots: list[core.Variable] = []
        agents: list[int | None] = []
        while True:
            match e:
                case core.Quantified(
                    quantifier=QuantifierKind.FORALL, domain=core.RobotRange(agent=agent)
                ) if not any(variable.slot == e.variable.slot for variable in robots):
                    robots.append(e.variable)
                    agents.append(agent)
                    e = e.body
                case _:
                    break
        self._add(name, sort, span, e, robots, bound, agents=tuple(agents))

    def _of_contract(self, kind: int, contract: core.Contract, loosening: Loosening) -> None:
        required = _all(contract.requires)
        ensured = loosening.expression(_all(contract.ensures))
        e = core.Binary(core.BinaryOp.IMPLIES, required, ensured, BOOL)
        self._add(
            contract.name,
            WatchedKind.CONTRACT,
            contract.span,
            e,
            [],
            contract.bound,
            agents=(kind,),
        )

    def _of_summary(self, external: core.External) -> None:
        if external.ensures:
            parameters = [*external.parameters, external.result]
            e = _all(external.ensures)
            bound = external.bound
            self._add(
                external.name,
                WatchedKind.SUMMARY,
                external.span,
                e,
                parameters,
                bound,
                function=external.name,
            )

    def _add(
        self,
        name: str,
        sort: WatchedKind,
        span: Span,
        e: core.Expr,
        parameters: list[core.Variable],
        bound: int,
        *,
        agents: tuple[int | None, ...] = (),
        function: str = "",
    ) -> None:
        called = f"{sort.value} {len(self.functions)}"
        body = (core.Return(e),)
        made = core.Function(called, tuple(parameters), BOOL, body, bound, span=span)
        self.functions.append(made)
        looks = None if sort is WatchedKind.SUMMARY else _looks(self.program, e, parameters)
        self.claims.append(WatchedClaim(name, sort, span, called, agents, function, looks, called))


def _all(conditions: tuple[core.Expr, ...]) -> core.Expr:
    if not conditions:
        return core.Const(True, BOOL)
    first, *others = conditions
    for other in others:
        first = core.Binary(core.BinaryOp.AND, first, other, BOOL)
    return first


# --- where claims look ----------------------------------------------------------------------------


def _looks(program: core.Program, e: core.Expr, robots: list[core.Variable]) -> Looks | None:
    """The reads of a claim; None where the text does not determine them."""
    names = PythonNames(program)
    own: list[set[str]] = [set() for _ in robots]
    entries: list[set[str]] = [set() for _ in robots]
    shared: set[str] = set()
    positions = {variable.slot: k for k, variable in enumerate(robots)}
    inner = {node.variable.slot for node in nodes(e) if isinstance(node, core.Quantified)}
    for node, called in _below(program, e):
        match node:
            case core.Ran() | core.Stopped():
                return None
            case core.Place(variable=variable) if variable.home is Home.ALLREAD:
                name, first = names.attribute(variable, None), node.steps[:1]
                where = None
                if first and isinstance(first[0], core.IndexStep) and not called:
                    where = _named(first[0].index, positions, inner)
                (shared if where is None else entries[where]).add(name)
            case core.Place(variable=variable) if variable.home is Home.ALLWRITE:
                shared.add(names.attribute(variable, None))
            case core.Place(variable=variable, robot=robot) if variable.home is not Home.BOUND:
                where = None if called or robot is None else _named(robot, positions, inner)
                if where is None:
                    return None
                own[where] |= {
                    names.attribute(entry.variable, kind)
                    for kind, agent in enumerate(program.agents)
                    for entry in (*agent.locals, *(port.declaration for port in agent.ports))
                    if entry.variable.name == variable.name
                }
            case _:
                pass
    return Looks(tuple(map(frozenset, own)), tuple(map(frozenset, entries)), frozenset(shared))


def _below(program: core.Program, part: object) -> Iterator[tuple[object, bool]]:
    """The nodes of a part, and of the functions that it calls."""
    waiting, seen, called = [part], set[str](), False
    known = {f.name.rsplit(" ", 1)[0]: f for f in program.functions}
    while waiting:
        for node in nodes(waiting.pop()):
            yield node, called
            if isinstance(node, core.Call) and node.function not in seen:
                seen.add(node.function)
                waiting.append(known[node.function.rsplit(" ", 1)[0]].body)
        called = True


def _named(index: core.Expr, positions: dict[int, int], inner: set[int]) -> int | None:
    """The position, among the robots of a claim, of the one that an index names."""
    match index:
        case core.Read(place=core.Place(variable=variable, steps=())):
            if variable.home is Home.BOUND and variable.slot not in inner:
                return positions.get(variable.slot)
    return None


# --- the module -----------------------------------------------------------------------------------


class WatchModule(Module):
    """A module with one class, which has the claims as methods."""

    watching = True

    def __init__(
        self, program: core.Program, names: PythonNames, claims: list[WatchedClaim]
    ) -> None:
        super().__init__(program)
        methods = {claim.method for claim in claims}
        self._contracts = {c.method: c.agents[0] for c in claims if c.sort is WatchedKind.CONTRACT}
        self._kind: int | None = None
        # What robots hold has the names that their own module has given it.
        self.names.shared, self.names.own = names.shared, names.own
        knowledge = self.knowledge
        knowledge.methods |= methods
        knowledge.asking -= methods  # nobody calls them, so there is no way to them
        wanted = tuple(f.body for f in program.functions if f.name in methods)
        knowledge.used = knowledge.called(wanted) | methods
        # Whoever holds an answer against a summary has to know what shape it has.
        knowledge.used |= {claim.function for claim in claims if claim.function}
        knowledge.in_init = set()

    def text(self) -> str:
        """The text of the module, without formatting, as nobody reads it."""
        body = [*self.types(), *self.functions(), *self.watch()]
        first = "from koord.runtime.watch import Watch"
        return "\n".join([*self.head(body), first, *body]) + "\n"

    def watch(self) -> Lines:
        shared = [line for line in self.shared_part() if not line.startswith("SOURCE")]
        source = f"SOURCE = {string(self.names.file)}"
        body = [source, *shared, *self.shared_methods()]
        return [
            "",
            "",
            "class Claims(Watch):",
            *indented(body),
            "",
            f"KINDS = {tuple_of(['Claims'])}",
        ]

    def function(self, function: core.Function, *, in_method: bool) -> Lines:
        self._kind = self._contracts.get(function.name)
        return super().function(function, in_method=in_method)

    def scope(
        self,
        agent: int | None,
        *,
        sure: set[tuple[Home, int]] | None = None,
        in_method: bool = True,
    ) -> Scope:
        scope = super().scope(agent, sure=sure, in_method=in_method)
        scope.agent = self._kind  # a contract is of a robot of one kind
        if len(self.program.agents) == 1:
            scope.assigned |= self.knowledge.own[0]  # INIT is over when claims are looked at
        return scope
