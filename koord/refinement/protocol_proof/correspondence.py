"""The model held against the machine.

Each state of the machine that is explored has to satisfy the axioms, the invariant and the claims,
and each transition has to be some actions of the model, one after another, or none.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

from koord.refinement.protocol_proof.abstraction import Abstraction, Said
from koord.refinement.protocol_proof.invariant import CLAIMS, INVARIANT
from koord.refinement.protocol_proof.logic import (
    Action,
    And,
    Atom,
    Equal,
    Exists,
    Statement,
    statement,
)
from koord.refinement.protocol_proof.model import (
    ACTIONS,
    AXIOMS,
    CHILD,
    CONSTANTS,
    PARENT,
    STATE,
    k,
    p,
)
from koord.refinement.protocol_proof.structures import Element, Query, Structure, counterexamples
from koord.runtime.exploration.claims import BrokenInvariant
from koord.runtime.exploration.exploring import Explored, Search
from koord.runtime.exploration.world import (
    ExplorationBounds,
    Explorer,
    ProtocolState,
    Transition,
)
from koord.runtime.protocol.setup import Setup, Timing


class Correspondence:
    """What is checked of the states and transitions of an explorer."""

    def __init__(self, explorer: Explorer) -> None:
        self._abstraction = Abstraction(explorer)
        self._checked: set[Said] = set()
        self._explained: set[tuple[Said, Said]] = set()
        self.actions: dict[str, int] = {}  #: how often each was found

    @property
    def states(self) -> int:
        """How many different states of the model were checked."""
        return len(self._checked)

    def broken(self, before: ProtocolState, after: ProtocolState) -> Iterator[BrokenInvariant]:
        """Yield what is not as the model has it in a transition, and in the state after it."""
        map_ = self._abstraction
        was, now = map_.said(before), map_.said(after)
        if (was, now) in self._explained:
            return
        self._explained.add((was, now))
        target = map_.structure(now, now)
        if now not in self._checked:
            self._checked.add(now)
            for name in false_statements(target, map_.constants):
                yield BrokenInvariant("model", f"not so in a state of the machine: {name}")
        actions = ActionSearch(map_.structure(was, now), target, map_.constants).found()
        if actions is None:
            yield BrokenInvariant("model", "no actions of the model are this step")
        for name in actions or ():
            self.actions[name] = self.actions.get(name, 0) + 1


@cache
def _statements() -> tuple[tuple[str, Query], ...]:
    exist = (
        statement("a history has a parent", Exists((p,), PARENT)),
        statement("there is a way from a prefix", Exists((k,), CHILD)),
    )
    checked: tuple[Statement, ...] = (*AXIOMS, *exist, *INVARIANT, *CLAIMS)
    return tuple((one.name, counterexamples(one.formula, CONSTANTS)) for one in checked)


def false_statements(structure: Structure, constants: tuple[Element, ...]) -> Iterator[str]:
    """Yield the axioms, statements of the invariant and claims that are not true in a structure."""
    for name, query in _statements():
        if query(structure, *constants):
            yield name


class Effects(NamedTuple):
    """An action, to be looked up: its parameters by the fact by which it is told, its effects."""

    action: Action
    told: Query
    effects: tuple[tuple[str, Query], ...]


@cache
def _lookup() -> dict[str, tuple[Effects, ...]]:
    """The actions by the relation of the fact by which they are told."""
    found: dict[str, tuple[Effects, ...]] = {}
    for action in ACTIONS:
        fact = _told_by(action)
        given = (*CONSTANTS, *fact.arguments)
        told = Query(action.parameters, given, action.guard)
        effects = tuple(
            (
                one.relation.name,
                Query(one.variables, (*CONSTANTS, *action.parameters), [one.where]),
            )
            for one in action.effects
        )
        name = fact.relation.name
        found[name] = (*found.get(name, ()), Effects(action, told, effects))
    return found


def _told_by(action: Action) -> Atom:
    """The fact by which an action is told: what its first effect makes true."""
    first = action.effects[0]
    assert isinstance(first.where, And)
    arguments = tuple(one.right for one in first.where.parts if isinstance(one, Equal))
    return Atom(first.relation, arguments)


class ActionSearch:
    """The search for actions that lead from one state of the model to another."""

    def __init__(self, start: Structure, target: Structure, constants: tuple[Element, ...]) -> None:
        self._start = start
        self._target = target.relations
        self._constants = constants
        self._names = [one.name for one in STATE]

    def found(self) -> list[str] | None:
        """The names of the actions, in an order in which they can happen, or None."""
        if any(self._start.relations[name] - self._target[name] for name in self._names):
            return None  # something is not so any more
        return self._from(self._start)

    def _from(self, at: Structure) -> list[str] | None:
        missing = {name: self._target[name] - at.relations[name] for name in self._names}
        if not any(missing.values()):
            return []
        for name, lookups in _lookup().items():
            for fact in missing[name]:
                for one in lookups:
                    for after in self._after(at, one, fact):
                        rest = self._from(after)
                        if rest is not None:
                            return [one.action.name, *rest]
        return None

    def _after(self, at: Structure, one: Effects, fact: tuple[Element, ...]) -> Iterator[Structure]:
        """The states after an action that makes a fact true, if they are on the way."""
        reached = set()
        for parameters in one.told(at, *self._constants, *fact):
            new = {
                name: frozenset(query(at, *self._constants, *parameters))
                for name, query in one.effects
            }
            key = tuple(new.values())
            if key in reached or any(new[name] - self._target[name] for name in new):
                continue
            reached.add(key)
            relations = {**at.relations, **{name: at.relations[name] | new[name] for name in new}}
            yield Structure(at.domains, relations)


class ModelSearch(Search):
    """An exploration that holds each state and each transition against the model as well."""

    def __init__(self, explorer: Explorer) -> None:
        super().__init__(explorer)
        self.model = Correspondence(explorer)

    def broken(self, world: ProtocolState, transition: Transition) -> Iterator[BrokenInvariant]:
        yield from super().broken(world, transition)
        yield from self.model.broken(world, transition.world)


def held_against_model(bounds: ExplorationBounds) -> Explored:
    """Explore the machine within bounds, and hold it against the model."""
    return ModelSearch(Explorer(Setup(bounds.robots, Timing.zero()), bounds)).run()
