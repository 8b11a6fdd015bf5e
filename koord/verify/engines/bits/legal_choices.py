"""Choices that are legal by themselves: what a constraint forbids counts as not chosen.

Robots choose events by inputs, and constraints say which choices make a round. Whoever goes back
from a bad state has to show that the round was one, by all that the guards of chosen events read.
Where a choice is put in conjunction with its constraints, each choice makes a round: the same
rounds in all, of which little is to be shown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from koord.verify.engines.bits.circuit import Circuit, Latch
from koord.verify.engines.bits.domain import literal
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.ic3 import SafetyQuery


def choices_of(circuit: Circuit) -> tuple[int, ...]:
    """The inputs by which robots choose events, by node, in the order of robots and events."""
    chosen = (literal(option.chosen) for option in circuit.round.options)
    return tuple(x >> 1 for x in chosen if not x & 1 and circuit.d.graph.is_input(x >> 1))


def with_legal_choices(g: Graph, question: SafetyQuery, choices: Sequence[int]) -> SafetyQuery:
    """The same safety query, in which as many constraints of choices as can be hold by themselves.

    Rounds have constraints of their own, and so has each way to be bad, which is in a round that
    need not end.
    """
    steps, latches = legal_rounds(g, question.steps, question.latches, choices)
    bad = legal_mistakes(g, question.bad, choices)
    return replace(question, steps=steps, bad=bad, latches=latches)


def legal_rounds(
    g: Graph, steps: int, latches: Sequence[Latch], choices: Sequence[int]
) -> tuple[int, tuple[Latch, ...]]:
    """What is left to be required of rounds, and latches with the next values of legal choices."""
    next_ = [latch.next for latch in latches]
    left, *then = _legal(g, steps, (steps, *next_), choices)
    pairs = zip(latches, then, strict=True)
    return left, tuple(replace(latch, next=value) for latch, value in pairs)


def legal_mistakes(g: Graph, bad: int, choices: Sequence[int]) -> int:
    """A disjunction of ways to be bad, each with the choices that its own constraints allow."""
    ways = [way ^ 1 for way in g.conjuncts(bad ^ 1)]
    return g.any_of(x for way in ways for x in _legal(g, way, (way,), choices))


def _legal(
    g: Graph, condition: int, literals: Sequence[int], choices: Sequence[int]
) -> Sequence[int]:
    """Literals that are looked at under a condition, with the choices that it allows put in.

    A constraint is left to the choices that it is about: the last of them is made only where the
    constraint holds with it, and what is left of it without that is one of those before. That
    leaves the same set of rounds: a choice that keeps its constraints is what it was, and any other
    counts as not made.
    """
    rank = {node: k for k, node in enumerate(choices)}
    about: dict[int, list[int]] = {}
    settled: dict[int, int] = {}  #: constraints that hold by themselves
    for part in g.conjuncts(condition):
        shares = _shares(g, part, rank, choices)
        for k, share in shares or ():
            about.setdefault(k, []).append(share)
        if shares is not None:
            settled[part >> 1] = TRUE ^ (part & 1)
    meaning: dict[int, int] = {}
    for k in sorted(about):
        kept = g.all_substituted(about[k], meaning)
        meaning[choices[k]] = g.all_of([2 * choices[k], *kept])
    return g.all_substituted(literals, meaning | settled)


def _shares(
    g: Graph, part: int, rank: Mapping[int, int], choices: Sequence[int]
) -> list[tuple[int, int]] | None:
    """What a constraint requires of each choice, by rank, if that choice is made.

    These say together what the constraint says. None where none do, as where it requires a choice.
    """
    found: list[tuple[int, int]] = []
    while part != TRUE:
        named = [rank[node] for node in g.cone([part]) if node in rank]
        if not named:
            return None
        last = max(named)
        made, not_made = (g.substituted(part, {choices[last]: x}) for x in (TRUE, FALSE))
        if g.both(made, not_made ^ 1) != FALSE:
            return None
        found.append((last, made))
        part = not_made
    return found
