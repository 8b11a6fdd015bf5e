"""Invariant cores: the parts of an invariant that a proof needs, by unsatisfiable cores.

What keeps the claims is needed, and what keeps that from one round to the next, and so on: a part
of an inductive invariant that is inductive itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import Struct
from msgspec.structs import replace

from koord.verify.claims import Claim, ClaimPhase
from koord.verify.effort import Deadline
from koord.verify.engines.bits.circuit import Circuit
from koord.verify.engines.bits.clauses import QUICK, TRUE_SIDE, Clauses
from koord.verify.engines.bits.constraint_selection import everything
from koord.verify.engines.bits.graph import FALSE
from koord.verify.engines.bits.numbers import Number
from koord.verify.engines.bits.prime_implicants import (
    Orbit,
    PlaceTable,
    UnsaidError,
    complexity,
    facts,
)
from koord.verify.engines.bits.unrolling import keeps

#: What must not come about, in which phase of a round.
Goal = tuple[ClaimPhase, int]

#: So many questions are spent on leaving parts out one by one.
MOST_TRIALS = 300


class Needed(Struct, frozen=True):
    """The orbits of excluded cubes that are needed, and the places whose ranges count."""

    orbits: tuple[Orbit, ...]
    ranged: tuple[int, ...]


def needed(
    circuit: Circuit,
    table: PlaceTable,
    orbits: Sequence[Orbit],
    claims: Sequence[Claim],
    given: Sequence[Claim],
    deadline: Deadline,
) -> Needed:
    """Reduce an invariant to the parts that the claims need, if ``given`` ones hold.

    Raises UnsaidError if the orbits are no invariant, or time runs out.
    """
    core = _Core(circuit, table, orbits, [*claims, *given], deadline)
    kept = core.of(claims)
    chosen = [orbits[k] for k in sorted(kept)]
    held = circuit.kept_by_states(given)
    # Ranges are what a circuit is made with; to ask of them again costs little.
    question = replace(everything(circuit, claims, held), latches=circuit.latches)
    statements = [table.left_out(orbit) for orbit in chosen]
    statements += circuit.kept_by_states(claims)
    if not keeps(circuit.d.graph, question, [*statements, *facts(table)], deadline):
        raise UnsaidError("robots are not alike in it")
    return Needed(tuple(chosen), tuple(core.ranged([circuit.d.graph.all_of(statements)])))


class _Core:
    """A solver for one round, with each part of an invariant on request."""

    def __init__(
        self,
        circuit: Circuit,
        table: PlaceTable,
        orbits: Sequence[Orbit],
        known: Sequence[Claim],
        deadline: Deadline,
    ) -> None:
        self.circuit = circuit
        self.table = table
        self.orbits = orbits
        self.known = known
        self.deadline = deadline
        g = circuit.d.graph
        self.clauses = Clauses(g, QUICK, deadline)
        for claim in known:
            if claim in circuit.held:
                self.clauses.require(circuit.held[claim])
        for fact in facts(table):
            self.clauses.require(fact)
        self._then = {latch.literal >> 1: latch.next for latch in circuit.latches}
        self._phase = {phase: self._on(g.all_of(x)) for phase, x in self._phases()}
        #: positions of orbits, by what turns them on
        self._parts = {self._on(table.left_out(o)): k for k, o in enumerate(orbits)}
        self._goals: dict[int, Goal] = {}

    def of(self, claims: Sequence[Claim]) -> set[int]:
        """The positions of orbits that the claims need: few, if not the fewest."""
        circuit = self.circuit
        if not self.orbits:
            return set()  # what the claims themselves do is asked by whoever looks again
        goals = [(phase, x) for claim in claims for phase, x in circuit.broken[claim]]
        goals = [(phase, x) for phase, x in (*goals, (ClaimPhase.END, circuit.lost)) if x != FALSE]
        cores = self._closed(goals)
        found = set().union(*cores.values())
        left = MOST_TRIALS
        for k in sorted(found, key=lambda k: complexity(self.orbits[k]), reverse=True):
            others = found - {k}
            asked = dict.fromkeys([*goals, *(self._broken(other) for other in sorted(others))])
            # What does not rest on the part needs no other proof.
            resting = [goal for goal in asked if k in cores[goal]]
            if left > 0 and (proofs := self._proofs(resting, others)) is not None:
                cores |= proofs
                found = others
            left -= len(resting)
        self.clauses.close()
        return found

    def _proofs(self, goals: Sequence[Goal], parts: set[int]) -> dict[Goal, set[int]] | None:
        """For each goal, some of the parts that it follows from; None if one follows from none."""
        on = [x for x, k in self._parts.items() if k in parts]
        proofs: dict[Goal, set[int]] = {}
        for goal in goals:
            if not self._is_kept(goal, on):
                return None
            proofs[goal] = self._core()
        return proofs

    def _core(self) -> set[int]:
        """The parts that the last answer rests on."""
        return {self._parts[x] for x in self.clauses.core() if x in self._parts}

    def _on(self, literal: int) -> int:
        return self.clauses.of(literal, TRUE_SIDE)

    def _closed(self, goals: Sequence[Goal]) -> dict[Goal, set[int]]:
        """The goals, those of the orbits that they need, and so on: each with what it needs."""
        pending, found, cores = list(goals), set[int](), dict[Goal, set[int]]()
        while pending:
            if self.deadline.passed():
                raise UnsaidError("there was no time to say it in Koord")
            goal = pending.pop()
            if not self._is_kept(goal, list(self._parts)):
                raise UnsaidError("what can be said of it is not inductive")
            cores[goal] = self._core()
            new = cores[goal] - found
            found |= new
            pending += map(self._broken, sorted(new))
        return cores

    def _broken(self, k: int) -> Goal:
        """The literal that a round leads into an orbit. By symmetry one cube of it is enough."""
        known = self._goals.get(k)
        if known is None:
            then = self.table.is_in(self.orbits[k].first)
            bad = self.circuit.d.graph.substituted(then, self._then)
            known = self._goals[k] = (ClaimPhase.END, bad)
        return known

    def _is_kept(self, goal: Goal, on: Sequence[int]) -> bool:
        """Return whether no round from states outside some orbits leads to the bad literal."""
        phase, bad = goal
        return not self.clauses.can_hold(bad, [self._phase[phase], *on])

    def _phases(self) -> Iterator[tuple[ClaimPhase, list[int]]]:
        circuit = self.circuit
        for phase, constraints in circuit.needed.items():
            sound = [x ^ 1 for x in circuit.faults] if phase is ClaimPhase.END else []
            yield phase, [*constraints, *sound]

    def ranged(self, statements: Sequence[int]) -> list[int]:
        """The places with numbers that statements and claims depend on, now or later."""
        g, circuit = self.circuit.d.graph, self.circuit
        roots = [*statements, *(x for c in self.known for _, x in circuit.broken.get(c, ()))]
        found: set[int] = set()
        while roots:
            new = {node for node in g.cone(roots) if node in self._then} - found
            found |= new
            roots = [self._then[node] for node in sorted(new)]
        places = self.table.places
        if any(place.written and len(place.values) == 1 for place in places):
            # What always has one value is part of no state, and may hang on any range.
            return [
                k
                for k, place in enumerate(places)
                if isinstance(place.bits, Number) or len(place.values) == 1
            ]
        moving = ((k, p) for k, p in enumerate(places) if isinstance(p.bits, Number))
        return [k for k, place in moving if any(x >> 1 in found for x in place.latches)]
