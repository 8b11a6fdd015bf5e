"""Updates of shared variables, syntactically: reads and writes outside of ``atomic``. [LOST-UPDATE]

A robot that computes a shared variable's new value from the old one, outside of an atomic block,
loses the other's work if another robot writes the same location in the same round.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator

from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.source import Span
from koord.syntax.walk import nodes, statements


def rewritten(program: core.Program) -> dict[tuple[int, int], frozenset[int]]:
    """For each event (agent kind, position) the allwrite slots it updates outside of ``atomic``."""
    found = {}
    for kind, agent in enumerate(program.agents):
        for position, event in enumerate(agent.events):
            slots = frozenset(slot for slot, _ in updates(event.effect))
            if slots:
                found[kind, position] = slots
    return found


def updates(effect: core.Block) -> Iterator[tuple[int, Span]]:
    """The statements of an effect that update allwrite variables, each with its slot.

    To update is, outside of ``atomic``, to write a value that is computed from the variable's own
    old value, in the same statement or by way of others; to append, remove or pop; or to write a
    part of a map's entry, which writes the rest of the entry as it was read.
    """
    givers = _givers(effect)
    for statement in statements(effect, atomic=False):
        match statement:
            case core.Assign(place=place, value=value):
                if place.variable.home is Home.ALLWRITE and (
                    place.is_below_key or place.variable in _origins(givers, _read(value))
                ):
                    yield place.variable.slot, statement.span
            case core.Append(place=place) | core.Remove(place=place) | core.Pop(place=place):
                if place.variable.home is Home.ALLWRITE:
                    yield place.variable.slot, statement.span
                into = statement.into if isinstance(statement, core.Pop) else None
                if into is not None and into.variable.home is Home.ALLWRITE and into.is_below_key:
                    yield into.variable.slot, statement.span
            case _:
                pass


def _givers(effect: core.Block) -> dict[core.Variable, set[core.Variable]]:
    """The variables whose values flow into each variable in the statements of an effect."""
    found: dict[core.Variable, set[core.Variable]] = defaultdict(set)
    for statement in statements(effect):
        match statement:
            case core.Assign(place=place, value=value) | core.Append(place=place, value=value):
                found[place.variable].update(_read(value))
            case core.Pop(place=place, into=core.Place(variable=into)):
                found[into].add(place.variable)
            case core.ForEach(key=key, value=variable, sequence=sequence):
                for bound in (key, variable):
                    if bound is not None:
                        found[bound].update(_read(sequence))
            case _:
                pass
    return found


def _origins(
    givers: dict[core.Variable, set[core.Variable]], read: Iterable[core.Variable]
) -> set[core.Variable]:
    """The variables that are read, and those whose values flow into them."""
    found: set[core.Variable] = set()
    waiting = list(read)
    while waiting:
        variable = waiting.pop()
        if variable not in found:
            found.add(variable)
            waiting += givers.get(variable, ())
    return found


def _read(value: core.Expr) -> Iterator[core.Variable]:
    """Every variable read in an expression."""
    return (node.variable for node in nodes(value) if isinstance(node, core.Place))
