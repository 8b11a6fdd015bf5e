"""Narrow questions leave out constraints, and so allow all that there is, and more."""

from __future__ import annotations

from collections.abc import Iterator

from koord.verify.engines.bits.circuit import Circuit
from koord.verify.engines.bits.clauses import QUICK, Clauses
from koord.verify.engines.bits.constraint_selection import (
    everything,
    narrowed,
    projected,
    with_all,
)
from koord.verify.engines.bits.domain import BitDomain
from koord.verify.engines.bits.graph import TRUE
from tests.verify.engines.bits.asking import finite_circuit


def circuits() -> Iterator[tuple[int, Circuit]]:
    """Circuits of generated programs, by their seeds, as far as these are finite."""
    for seed in range(9_000, 9_030):
        made = finite_circuit(seed)
        if made is not None:
            yield seed, made


def test_every_step_and_every_mistake_is_one_of_the_narrow_question() -> None:
    """A mistake may be that of the state that a narrow round leads to. [T-ROUND-ENDS]"""
    fewer = between = 0
    for seed, circuit in circuits():
        g = circuit.d.graph
        next_ = {latch.literal >> 1: latch.next for latch in circuit.latches}
        for claim in circuit.bad:
            whole = everything(circuit, [claim], [])
            narrow = narrowed(circuit, [claim], [], between=True)
            then = g.both(narrow.steps, g.substituted(narrow.bad, next_))
            clauses = Clauses(g, QUICK)
            steps, bad = (clauses.of(of) for of in (whole.steps, whole.bad))
            now, soon = clauses.of(narrow.bad), clauses.of(then)
            assert not clauses.solve([steps, clauses.of(narrow.steps ^ 1)]), (seed, claim.name)
            assert not clauses.solve([bad, -now, -soon]), (seed, claim.name)
            between += clauses.solve([bad, -now])
            fewer += clauses.solve([clauses.of(narrow.steps), -steps])
            clauses.close()
    assert fewer >= 10
    assert between >= 2


def test_within_rounds_every_mistake_is_one_of_the_round() -> None:
    for seed, circuit in circuits():
        for claim in circuit.bad:
            whole = everything(circuit, [claim], [])
            narrow = narrowed(circuit, [claim], [], between=False)
            clauses = Clauses(circuit.d.graph, QUICK)
            now, ever = clauses.of(narrow.bad), clauses.of(whole.bad)
            assert not clauses.solve([ever, -now]), (seed, claim.name)
            clauses.close()


def test_with_all_constraints_it_is_the_circuit_wherever_numbers_are_in_range() -> None:
    fewer = 0
    for seed, circuit in circuits():
        g = circuit.d.graph
        steps, bad = with_all(circuit, circuit.bad)
        ranges = [x for number in circuit.ranges for x in circuit.d.in_range(number)]
        pairs = [(circuit.steps, steps)]
        pairs += [(g.any_of(x for _, x in circuit.bad[claim]), bad[claim]) for claim in bad]
        for old, new in pairs:
            clauses = Clauses(g, QUICK)
            for literal in ranges:
                clauses.require(literal)
            assert not clauses.solve([clauses.of(g.differ(old, new))]), seed
            fewer += g.cone([new]) != g.cone([old])
            clauses.close()
    assert fewer >= 5


def test_a_range_says_of_some_bits_what_numbers_in_it_have() -> None:
    for low, high in [(-1, 9), (0, 4), (-3, 2), (3, 12), (-6, -2)]:
        for some in range(32):
            d = BitDomain()
            number = d.vector("a", low, high, 0)
            literals = [(k, x) for k, x in enumerate(number.literals) if x > 1]
            seen = [(k, x) for k, x in literals if (some >> k) & 1]
            found = projected(d.graph, number, {x >> 1 for _, x in seen})
            assert found == TRUE or seen
            within = {tuple((v >> k) & 1 for k, _ in seen) for v in range(low, high + 1)}
            for bits in range(1 << len(seen)):
                given = {x >> 1: bool((bits >> n) & 1) for n, (_, x) in enumerate(seen)}
                pattern = tuple((bits >> n) & 1 for n in range(len(seen)))
                assert d.graph.values([found], given) == [pattern in within], (low, high, some)
