"""Liveness as an invariant: fairness is met fewer than k times while something is pending.

[T-COUNT] See Claessen and Sörensson, *A liveness checking algorithm that counts* (2012).
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from koord.verify.effort import Deadline
from koord.verify.engines.bits.circuit import Latch
from koord.verify.engines.bits.clauses import OTHER, QUICK, Clauses
from koord.verify.engines.bits.constraint_selection import related
from koord.verify.engines.bits.fairness_monitors import MonitoredCircuit
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.ic3 import SafetyQuery, reduced


class Counting(Struct, frozen=True):
    """What is counted: the part of a circuit that it is about, and when the count starts anew.

    ``met`` are the conditions of fairness by name; ``on`` holds of rounds that count.
    """

    graph: Graph
    latches: tuple[Latch, ...]
    opens: int
    steps: int
    whole: int  #: the same with all constraints, and what is lost then
    lost: int
    given: tuple[int, ...]
    met: tuple[tuple[str, int], ...]
    pending: int
    settled: tuple[Latch, ...]  #: in the order in which they settle
    on: int  #: pending, and nothing that settles changes


def counting(
    watched: MonitoredCircuit, given: Sequence[int], *, locks: bool, narrow: bool
) -> Counting:
    """What is to be counted.

    Without ``locks`` that of locks is left out, and with ``narrow`` constraints that hardly matter:
    both allow more runs.
    """
    circuit = watched.circuit
    g, pending = circuit.d.graph, watched.pending
    latches = list(circuit.latches)
    met = [(condition.name, condition.met) for condition in watched.conditions]
    required: list[int] = []
    for grant in watched.grants if locks else ():
        name = f"{grant.name} is asked for no more"
        before = g.input(name)
        over = g.either(before, g.input(f"{name}, from now on"))
        latches.append(Latch(name, before, FALSE, g.both(over, pending)))
        required.append(g.both(over, grant.asked) ^ 1)
        met.append((grant.name, g.either(over, grant.granted)))
    roots = [pending, *(now for _, now in met), *required, *given]
    steps = whole = g.all_of([circuit.steps, *required])
    if narrow:
        kept, inputs = related(circuit, latches, [*roots, circuit.lost])
        steps = g.all_of([*kept, *required])
        mine = tuple(latch for latch in latches if latch.literal >> 1 in inputs)
    else:
        mine = reduced(latches, g.cone, [*roots, steps])
    settled = tuple(settling(g, mine, [steps, pending, *given]))
    changed = g.any_of(g.differ(x.literal, x.next) for x in settled)
    on = g.both(pending, changed ^ 1)
    lost = g.both(circuit.lost, steps)
    known = tuple(given)
    return Counting(
        g, mine, circuit.opens, steps, whole, lost, known, tuple(met), pending, settled, on
    )


def settling(g: Graph, latches: Sequence[Latch], required: Sequence[int]) -> list[Latch]:
    """Bits that change finitely often in each run: no more, once those before them have settled.

    Each of them never rises, or never falls, in a round in which the ones before do not change.
    """
    clauses = Clauses(g, QUICK)
    for must in required:
        clauses.require(must)
    pending = {latch: (clauses.of(latch.literal), clauses.of(latch.next)) for latch in latches}
    found: list[Latch] = []
    while True:
        before = len(found)
        for latch, (now, then) in list(pending.items()):
            if clauses.solve([now, -then]) and clauses.solve([-now, then]):
                continue
            found.append(latch)
            del pending[latch]
            clauses.add([-now, then])
            clauses.add([now, -then])
        if len(found) == before:
            clauses.close()
            return found


def settles(of: Counting, deadline: Deadline) -> bool:
    """Whether all that counts as settling does: asked of another solver, with all constraints."""
    clauses = Clauses(of.graph, OTHER, deadline)
    for must in (of.whole, of.pending, *of.given):
        clauses.require(must)
    for latch in of.settled:
        now, then = clauses.of(latch.literal), clauses.of(latch.next)
        if clauses.solve([now, -then]) and clauses.solve([-now, then]):
            return False
        clauses.add([-now, then])
        clauses.add([now, -then])
    clauses.close()
    return True


def counted(of: Counting, times: int) -> SafetyQuery:
    """Whether all conditions of fairness can be met so many times while the count goes on."""
    g, on = of.graph, of.on
    latches = list(of.latches)
    # One after the other, one in each round: what is known of the first may rule out the next.
    seen, behind = [], TRUE
    for name, now in of.met:
        before = g.input(f"{name} met")
        seen.append((f"{name} met", before, g.either(before, g.both(behind, now))))
        behind = before
    all_seen = seen[-1][2] if seen else TRUE
    for name, before, now in seen:
        latches.append(Latch(name, before, FALSE, g.all_of([on, all_seen ^ 1, now])))
    reached = TRUE
    for number in range(1, times + 1):
        before = g.input(f"met {number} times")
        after = g.either(before, g.both(all_seen, reached))
        latches.append(Latch(f"met {number} times", before, FALSE, g.both(on, after)))
        reached = before
    bad = g.either(reached, of.lost)
    return SafetyQuery(tuple(latches), of.opens, of.steps, bad, of.given)
