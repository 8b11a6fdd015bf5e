"""Smaller queries: constraints are left out that hardly matter to the claim.

What is required of opaque values that the claim never looks at is left out, and with it the state
that only such constraints are about. That allows more runs: an invariant of these is one of all
runs, but a violation has to be looked for again with everything.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from koord.verify.claims import Claim, ClaimPhase
from koord.verify.engines.bits.circuit import Circuit, Latch
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.ic3 import SafetyQuery, reduced
from koord.verify.engines.bits.numbers import TABLE, Number
from koord.verify.engines.bits.state_claims import broken_in_state


class _Ranges:
    """The ranges of a circuit's numbers, as far as they are about bits that matter.

    A round leads from any state to one in range, so they hold of all that is reached. Of a number
    of which some bits matter these are in the projection of its range, and nothing is required of
    bits that do not: a query with the rest of the range has an answer if that without it has one.
    """

    def __init__(self, circuit: Circuit) -> None:
        self.graph, self.numbers = circuit.d.graph, circuit.ranges
        self.parts = {
            part
            for number in circuit.ranges
            for part in _single(self.graph, circuit.d.in_range(number))
        }
        self._whole = circuit.d.in_range
        self._latches = {latch.literal >> 1: latch for latch in circuit.latches}

    def closed(self, roots: list[int], known: set[int]) -> set[int]:
        """The bits that literals depend on, now or later, with those of wide ranges of them."""
        inputs = _closed(self.graph, self._latches, roots, known)
        while (more := _closed(self.graph, self._latches, self._wide(inputs), inputs)) != inputs:
            inputs = more
        return inputs

    def _wide(self, inputs: set[int]) -> list[int]:
        """The ranges of numbers with bits that matter which are too wide to be projected."""
        return [
            x
            for number in self.numbers
            if number.high - number.low >= TABLE and inputs & _nodes(number)
            for x in self._whole(number)
        ]

    def about(self, inputs: set[int]) -> list[int]:
        """What ranges say of the bits that matter."""
        found = self._wide(inputs)
        for number in self.numbers:
            if number.high - number.low < TABLE:
                found.append(projected(self.graph, number, inputs))
        return [x for x in found if x != TRUE]


def _nodes(number: Number) -> set[int]:
    return {x >> 1 for x in number.literals if x > 1}


def projected(g: Graph, number: Number, inputs: set[int]) -> int:
    """The literal that the bits of a number that are inputs are those of a number in its range."""
    bits = [(k, x) for k, x in enumerate(number.literals) if x >> 1 in inputs]

    def among(values: frozenset[int], left: Sequence[tuple[int, int]]) -> int:
        if not values:
            return FALSE
        if not left:
            return TRUE
        (k, literal), *others = left
        one = frozenset(v for v in values if (v >> k) & 1)
        return g.choose(literal, among(one, others), among(values - one, others))

    return among(frozenset(range(number.low, number.high + 1)), bits)


def narrowed(
    circuit: Circuit, claims: Sequence[Claim], given: Iterable[int], *, between: bool
) -> SafetyQuery:
    """The query whether one of the claims can break, with the related constraints only.

    Claims are judged in the states ``between`` rounds, where that is as good. [T-ROUND-ENDS]
    Where rounds break them, no state before the first of these breaks one: all claims are kept.
    That numbers are in their ranges is none of them: whoever goes back from a bad state would have
    to show it of all, and it holds of all that is reached.
    """
    g, ranges = circuit.d.graph, _Ranges(circuit)
    relations = {x >> 1 for atoms in circuit.d.opaques.atoms.values() for x in atoms.values()}
    broken = [each for claim in claims for each in circuit.broken[claim]]
    # One by one as they were made: of a conjunction no part stands for itself.
    needed = {phase: set(_single(g, parts)) for phase, parts in circuit.needed.items()}
    sound = _single(g, [literal ^ 1 for literal in circuit.faults])
    about = {x: _inputs(g, [x]) for x in dict.fromkeys([*needed[ClaimPhase.END], *sound])}
    pending = sorted(x for x in about if about[x] and x not in ranges.parts)
    kept: set[int] = set()
    kept_claims = [] if between else circuit.kept_by_states(claims)
    roots = [circuit.lost, *given, *kept_claims, *(when for _, when in broken)]
    inputs: set[int] = set()
    while roots:
        inputs = ranges.closed(roots, inputs)
        roots = [x for x in pending if about[x] & inputs and about[x] & relations <= inputs]
        kept.update(roots)
        pending = [x for x in pending if x not in kept]
    steps = g.all_of(kept)
    latches = tuple(latch for latch in circuit.latches if latch.literal >> 1 in inputs)
    required = {phase: kept & parts for phase, parts in needed.items()}
    violated: list[int] = []
    for claim in claims:
        in_state = broken_in_state(circuit, claim, required, kept) if between else None
        if in_state is None:
            ways = circuit.broken[claim]
            violated += [g.all_of([when, *required[phase]]) for phase, when in ways]
        else:
            violated.append(in_state)
    lost = g.both(circuit.lost, steps)
    bad = g.any_of([*violated, lost])
    bounds = tuple(ranges.about(inputs))
    return SafetyQuery(latches, circuit.opens, steps, bad, tuple(given), bounds, tuple(kept_claims))


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
    g, known = circuit.d.graph, tuple(given)
    steps, bad = with_all(circuit, claims, known)
    violated = g.any_of([*bad.values(), g.both(circuit.lost, steps)])
    latches = reduced(circuit.latches, g.cone, [violated, steps, *known])
    return SafetyQuery(latches, circuit.opens, steps, violated, known)


def with_all(
    circuit: Circuit, claims: Iterable[Claim], more: Iterable[int] = ()
) -> tuple[int, dict[Claim, int]]:
    """Whole rounds, and when claims break, with all constraints: of ranges, what matters.

    What the literals of ``more`` depend on matters as well.
    """
    g, ranges = circuit.d.graph, _Ranges(circuit)
    needed, whole = _unbounded(circuit, ranges)
    broken = {claim: circuit.broken[claim] for claim in claims}
    roots = [circuit.lost, *whole, *more, *(x for each in broken.values() for _, x in each)]
    roots += [x for parts in needed.values() for x in parts]
    bounds = ranges.about(ranges.closed(roots, set()))
    bad = {
        claim: g.any_of(g.all_of([when, *needed[phase], *bounds]) for phase, when in phases)
        for claim, phases in broken.items()
    }
    return g.all_of([*whole, *bounds]), bad


def whatever_range(
    circuit: Circuit, *, between: bool
) -> tuple[int, dict[Claim, int], dict[Claim, int]]:
    """Whole rounds, and when claims break, with all constraints but ranges.

    Ranges hold of all that is reached. Second are the claims that rounds break; last, if looked at
    ``between`` rounds, those that states break where that is as good. [T-ROUND-ENDS]
    """
    g = circuit.d.graph
    needed, whole = _unbounded(circuit, _Ranges(circuit))
    required = {phase: set(parts) for phase, parts in needed.items()}
    all_of_them = set(_single(g, whole))
    in_rounds: dict[Claim, int] = {}
    in_states: dict[Claim, int] = {}
    for claim, ways in circuit.broken.items():
        state = broken_in_state(circuit, claim, required, all_of_them) if between else None
        if state is None:
            in_rounds[claim] = g.any_of(g.all_of([when, *needed[phase]]) for phase, when in ways)
        else:
            in_states[claim] = state
    return g.all_of(whole), in_rounds, in_states


def _unbounded(circuit: Circuit, ranges: _Ranges) -> tuple[dict[ClaimPhase, list[int]], list[int]]:
    """The constraints of rounds up to each phase, and those of whole ones, without ranges."""
    needed = {
        phase: [x for x in _single(circuit.d.graph, parts) if x not in ranges.parts]
        for phase, parts in circuit.needed.items()
    }
    return needed, [*needed[ClaimPhase.END], *(literal ^ 1 for literal in circuit.faults)]


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
