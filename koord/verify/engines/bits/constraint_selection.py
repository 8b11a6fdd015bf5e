"""Smaller queries: constraints are left out that hardly matter to the claim.

What is required of opaque values that the claim never looks at is left out, and with it the state
that only such constraints are about. That allows more runs: an invariant of these is one of all
runs, but a violation has to be looked for again with everything.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from koord.verify.claims import Claim, ClaimPhase
from koord.verify.engines.bits.circuit import Circuit, Latch
from koord.verify.engines.bits.graph import Graph
from koord.verify.engines.bits.ic3 import SafetyQuery, reduced


def narrowed(circuit: Circuit, claims: Iterable[Claim], given: Iterable[int]) -> SafetyQuery:
    """The query whether one of the claims can break, with the related constraints only."""
    g = circuit.d.graph
    relations = {x >> 1 for atoms in circuit.d.opaques.atoms.values() for x in atoms.values()}
    broken = [each for claim in claims for each in circuit.broken[claim]]
    # One by one as they were made: of a conjunction no part stands for itself.
    needed = {phase: set(_single(g, parts)) for phase, parts in circuit.needed.items()}
    sound = _single(g, [literal ^ 1 for literal in circuit.faults])
    about = {x: _inputs(g, [x]) for x in dict.fromkeys([*needed[ClaimPhase.END], *sound])}
    by_node = {latch.literal >> 1: latch for latch in circuit.latches}
    pending = sorted(x for x in about if about[x])
    kept: set[int] = set()
    roots = [circuit.lost, *given, *(when for _, when in broken)]
    inputs: set[int] = set()
    while roots:
        inputs = _closed(g, by_node, roots, inputs)
        roots = [x for x in pending if about[x] & inputs and about[x] & relations <= inputs]
        kept.update(roots)
        pending = [x for x in pending if x not in kept]
    steps = g.all_of(kept)
    latches = tuple(latch for latch in circuit.latches if latch.literal >> 1 in inputs)
    violated = [g.all_of([when, *(kept & needed[phase])]) for phase, when in broken]
    lost = g.both(circuit.lost, steps)
    return SafetyQuery(latches, circuit.opens, steps, g.any_of([*violated, lost]), tuple(given))


def related(
    circuit: Circuit, latches: Sequence[Latch], roots: Sequence[int]
) -> tuple[set[int], set[int]]:
    """The constraints of whole rounds that share inputs with some literals.

    Second are the inputs and latches that any of it depends on. ``latches`` may be more than the
    circuit's own.
    """
    g = circuit.d.graph
    relations = {x >> 1 for atoms in circuit.d.opaques.atoms.values() for x in atoms.values()}
    whole = [*circuit.needed[ClaimPhase.END], *(literal ^ 1 for literal in circuit.faults)]
    about = {x: _inputs(g, [x]) for part in _single(g, whole) for x in _implied(g, part)}
    by_node = {latch.literal >> 1: latch for latch in latches}
    pending = sorted(x for x in about if about[x])
    kept: set[int] = set()
    inputs: set[int] = set()
    more = list(roots)
    while more:
        inputs = _closed(g, by_node, more, inputs)
        more = [x for x in pending if about[x] & inputs and about[x] & relations <= inputs]
        kept.update(more)
        pending = [x for x in pending if x not in kept]
    return kept, inputs


def _implied(g: Graph, literal: int) -> list[int]:
    """Split an implication of a conjunction, so that each part can be left out by itself."""
    node = literal >> 1
    if literal & 1 and not g.is_input(node):
        for one, other in ((g.left[node], g.right[node]), (g.right[node], g.left[node])):
            if other & 1 and not g.is_input(other >> 1):
                parts = g.conjuncts(other ^ 1)
                return [g.both(one, part ^ 1) ^ 1 for part in parts]
    return [literal]


def _single(g: Graph, literals: Iterable[int]) -> list[int]:
    return [part for literal in literals for part in g.conjuncts(literal)]


def everything(circuit: Circuit, claims: Iterable[Claim], given: Iterable[int]) -> SafetyQuery:
    """The query whether one of the claims can break, with all constraints."""
    g = circuit.d.graph
    bad = [x for claim in claims for _, x in circuit.bad[claim]]
    violated, known = g.any_of([*bad, g.both(circuit.lost, circuit.steps)]), tuple(given)
    latches = reduced(circuit.latches, g.cone, [violated, circuit.steps, *known])
    return SafetyQuery(latches, circuit.opens, circuit.steps, violated, known)


def _closed(g: Graph, latches: dict[int, Latch], roots: list[int], known: set[int]) -> set[int]:
    """The inputs and latches that literals depend on, now or later, and those known before."""
    found = set(known)
    while roots:
        new = _inputs(g, roots) - found
        found |= new
        roots = [latches[node].next for node in new if node in latches]
    return found


def _inputs(g: Graph, literals: Iterable[int]) -> set[int]:
    return {node for node in g.cone(literals) if g.is_input(node)}
