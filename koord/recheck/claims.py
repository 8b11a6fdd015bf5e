"""Claims and their obligations: goals that have to follow from hypotheses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from enum import Enum

from msgspec import Struct

from koord.recheck.storage import Cell, Fault, ParameterisedState, State, Storage
from koord.recheck.terms import Term
from koord.recheck.turns import Turns
from koord.recheck.values import Values
from koord.recheck.world import Instance
from koord.syntax import core
from koord.syntax.types import EnumType, Type


class ClaimKind(Enum):
    """The kinds of claims, by their origin."""

    STATEMENT = "property"  #: a statement about configurations
    FAULT = "fault"
    LOST_UPDATE = "lost update"
    CONTRACT = "contract"
    LIVENESS = "liveness"  #: a statement about whole runs


class Claim(Struct, frozen=True):
    """A claim; ``subject`` is the variable of a lost update, or the contract.

    ``depth`` is over how many rounds it is inductive.
    """

    name: str
    kind: ClaimKind
    stated: core.Property | None = None
    subject: str = ""
    depth: int = 1

    @property
    def at_round(self) -> bool:
        return self.stated is not None and self.stated.kind is core.PropertyKind.AT_ROUND


class Goal(Struct, frozen=True):
    """A goal: ``holds`` has to follow, ``legal`` is assumed of the answers in it."""

    claim: str
    legal: Term
    holds: Term


class ShownTerm(Struct, frozen=True):
    """A part of a configuration, or a choice, for display in a counterexample."""

    what: str
    term: Term
    type: Type | None


class Entailment(Struct, frozen=True):
    """An entailment: each goal has to follow from the hypotheses. ``shown`` is for counterexamples.

    ``names`` are numbers of robots that it is about, where there is any number of them.
    """

    hypotheses: tuple[Term, ...]
    goals: tuple[Goal, ...]
    shown: tuple[ShownTerm, ...] = ()
    names: tuple[Term, ...] = ()


class Obligation(Struct, frozen=True):
    """An obligation with attempts at it: the first are quick, and use fewer hypotheses.

    A counterexample to the last attempt is one to the obligation. Attempts are made when asked for.
    ``hollow`` is what it means if nothing satisfies the hypotheses: less is shown than it seems.
    """

    name: str
    attempts: tuple[Callable[[], Entailment], ...]
    hollow: str = ""


#: What it means that no configuration is an initial one, or that contracts let no round end.
NO_START = "no configuration satisfies what is assumed of the start"
NO_END = "no round can end: nothing satisfies the contracts"


class History(Struct, frozen=True):
    """A configuration at the start of a round, with facts about its history."""

    state: State
    facts: tuple[Term, ...]


def stated(
    turns: Turns,
    state: State | ParameterisedState,
    claims: Iterable[Claim],
    *,
    between_rounds: bool,
) -> list[Goal]:
    """The claims that are statements about configurations."""
    goals = []
    for claim in claims:
        if claim.stated is not None and (between_rounds or not claim.at_round):
            holds, legal = turns.holds(state, claim.stated.condition, claim.stated.bound)
            goals.append(Goal(claim.name, legal, holds))
    return goals


def fault_name(fault: Fault) -> str:
    """The name of the claim that a fault does not occur."""
    return f"no fault ({fault.what}, {fault.span.line}:{fault.span.column})"


def sound(turns: Turns, fault: Fault, legal: Term | None = None) -> Goal:
    """The goal that a fault does not occur."""
    t = turns.v.t
    known = t.truth(True) if legal is None else legal
    return Goal(fault_name(fault), known, t.negation(fault.when))


def as_facts(goals: Iterable[Goal]) -> list[Term]:
    """The facts that hold where goals hold."""
    return [term for goal in goals for term in (goal.legal, goal.holds)]


# --- configurations in the words of the program ---------------------------------------------------


def parts(world: Instance, v: Values, state: State, suffix: str = "") -> Iterator[ShownTerm]:
    """The variables of a configuration, part by part."""
    program = world.program
    for d, storage in zip(program.allread, state.store.allread, strict=True):
        yield from _leaves(v, d.variable.name, suffix, storage, d.variable.type)
    for d, storage in zip(program.allwrite, state.store.allwrite, strict=True):
        yield from _leaves(v, d.variable.name, suffix, storage, d.variable.type)
    for i, robot in enumerate(state.robots):
        agent, where = world.agent(i), f"@{i}{suffix}"
        for d, storage in zip(agent.locals, robot.locals, strict=True):
            yield from _leaves(v, d.variable.name, where, storage, d.variable.type)
        for port, storage in zip(agent.ports, robot.ports, strict=True):
            its = port.declaration.variable
            yield from _leaves(v, port.label, where, storage, its.type)
        if world.stops():
            yield ShownTerm(f"stopped@{i}{suffix}", robot.stopped, None)


def _leaves(v: Values, name: str, where: str, storage: Storage, type_: Type) -> Iterator[ShownTerm]:
    if isinstance(storage, Cell):
        if storage.is_set.value is False:
            return
        for term, leaf in v.leaves(storage.value, type_):
            yield ShownTerm(f"{name}{where}", term, leaf if isinstance(leaf, EnumType) else None)
        return
    parts = v.parts(type_)
    assert parts is not None
    assert isinstance(storage, tuple)
    for below, (label, part) in zip(storage, parts, strict=True):
        yield from _leaves(v, name + label, where, below, part)
