"""Claims that are judged in states: a round that breaks one leaves a state that breaks it.

A claim is looked at inside of a round, by its inputs and all that its turns calculate. Whoever goes
back from there has to find out first what the bad states are, one round early and each with a part
of the round's choices. Where nothing is lost by it, the claim is looked at between rounds instead.
[T-ROUND-ENDS]
"""

from __future__ import annotations

from collections.abc import Mapping, Set

from koord.verify.claims import Claim, ClaimPhase
from koord.verify.engines.bits.circuit import Circuit
from koord.verify.engines.bits.clauses import QUICK, Clauses, NoAnswerError


def broken_in_state(
    circuit: Circuit, claim: Claim, needed: Mapping[ClaimPhase, Set[int]], whole: Set[int]
) -> int | None:
    """The literal of states that break a claim, if each round that breaks it leaves such a state.

    ``needed`` are the constraints of rounds up to a phase, and ``whole`` those of whole rounds.
    None where that is not so, or not quickly shown: where the claim depends on more than the state;
    where a round breaks it on its way only; where a round that has broken it may come to no end.
    """
    held = circuit.held.get(claim)
    if held is None or not circuit.broken[claim]:
        return None
    g = circuit.d.graph
    next_ = {latch.literal >> 1: latch.next for latch in circuit.latches}
    if any(g.is_input(node) and node not in next_ for node in g.cone([held])):
        return None
    after = g.substituted(held, next_) ^ 1
    for phase, when in circuit.broken[claim]:
        left = {*g.conjuncts(after), *whole} - needed[phase] - set(g.conjuncts(when))
        if left and not _implies(circuit, {when, *needed[phase]}, g.all_of(left)):
            return None
    return held ^ 1


def _implies(circuit: Circuit, conditions: Set[int], conclusion: int) -> bool:
    """Return whether conditions are quickly shown to imply a literal where numbers are in range."""
    clauses = Clauses(circuit.d.graph, QUICK, left=1)
    try:
        for number in circuit.ranges:
            for literal in circuit.d.in_range(number):
                clauses.require(literal)
        for literal in conditions:
            clauses.require(literal)
        return not clauses.solve([clauses.of(conclusion ^ 1)])
    except NoAnswerError:
        return False
    finally:
        clauses.close()
