"""Lassos of bounded length: unrolled rounds, the last of which returns to an earlier state."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

from msgspec.structs import replace

from koord.semantics.recordings import Answer, Concrete, Recording
from koord.semantics.values import map_atoms
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.system import System
from koord.verify.claims import ClaimPhase
from koord.verify.effort import Deadline
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.engines.bits.circuit import Latch
from koord.verify.engines.bits.clauses import TRUE_SIDE
from koord.verify.engines.bits.domain import Bits, literal
from koord.verify.engines.bits.found_runs import RelationValue, recording
from koord.verify.engines.bits.graph import Graph
from koord.verify.engines.bits.liveness_to_safety import MonitoredCircuit
from koord.verify.engines.bits.unrolling import UnrolledCircuit


def closing(loop: int, standing: list[dict[int, str]]) -> dict[str, str]:
    """A renaming of the values that are new in a loop, to the names that they have at its start."""
    first, last = standing[loop], standing[-1]
    old = {name for names in standing[: loop + 1] for name in names.values()}
    return {last[token]: first[token] for token in last if last[token] not in old}


def tied(lasso: Recording, names: dict[str, str]) -> Recording:
    """The lasso with opaque values that are new in the loop renamed to those at its start.

    Of these nothing is known but what bits say, and they say the same at both ends. Whether any
    values are like that, replay finds out.
    """

    def called(value: Concrete) -> Concrete:
        return map_atoms(value, lambda x: names.get(x, x) if isinstance(x, str) else x)

    def answered(answer: Answer) -> Answer:
        arguments = tuple(map(called, answer.arguments))
        return replace(answer, arguments=arguments, value=called(answer.value))

    rounds = tuple(
        replace(
            round_,
            readings=tuple(replace(r, value=called(r.value)) for r in round_.readings),
            answers=tuple(map(answered, round_.answers)),
        )
        for round_ in lasso.rounds
    )
    return replace(lasso, rounds=rounds)


#: So many lassos of one length are looked at before longer ones are.
_MOST = 8

#: So often a lasso of one length is looked for in which functions keep to what they answered.
_MOST_MENDED = 64


class LassoSearch:
    """The unrolled rounds of a monitored circuit, and the lassos among them. [LASSO]"""

    def __init__(self, watched: MonitoredCircuit, reads_ran: bool) -> None:
        self.watched = watched
        self.reads_ran = reads_ran  #: whether a statement does; no later round depends on it
        self.unrolled = UnrolledCircuit(self.watched.circuit)

    @property
    def rounds(self) -> int:
        """The number of rounds unrolled so far."""
        return len(self.unrolled.rounds)

    def begin(self) -> None:
        """Unroll one more round."""
        self.unrolled.begin()

    def lassos(self, system: System, deadline: Deadline) -> Iterator[Recording]:
        """Yield lassos of all unrolled rounds: each runs other events than those before.

        Raises OutOfBudgetError when the time is up.
        """
        unrolled = self.unrolled
        copy = unrolled.rounds[-1]
        circuit, g = self.watched.circuit, unrolled.graph
        choices = [g.input(f"loop {k} of {self.rounds}") for k in range(self.rounds)]
        wanted = [g.any_of(choices), copy.of(circuit.steps), copy.of(circuit.lost) ^ 1]
        for k, choice in enumerate(choices):
            wanted += [g.both(choice, other) ^ 1 for other in choices[:k]]
            wanted.append(g.both(choice, self._closes(k) ^ 1) ^ 1)
        inside = [g.any_of(choices[: k + 1]) for k in range(self.rounds)]
        wanted += self._fair(g, inside)
        looked_at = 0
        for _ in range(_MOST_MENDED):
            answer = unrolled.asked(g.all_of(wanted), deadline)
            if answer is SolverAnswer.UNKNOWN:
                raise OutOfBudgetError
            if answer is not SolverAnswer.SAT:
                return
            lasso, told = self._witnessed(system, choices)
            changed = self._contradictions(told)
            if changed:
                wanted += changed
                continue
            yield lasso
            looked_at += 1
            if looked_at == _MOST:
                return
            wanted.append(self._runs_as(lasso) ^ 1)

    def _witnessed(
        self, system: System, choices: list[int]
    ) -> tuple[Recording, list[RelationValue]]:
        """A lasso, and its relations of opaque values."""
        unrolled = self.unrolled
        run = unrolled.witnessed()
        model = unrolled.clauses.model()
        numbers = [unrolled.clauses.of(choice, TRUE_SIDE) for choice in choices]
        loop = next(k for k, number in enumerate(numbers) if model[number] > 0)
        standing: list[dict[int, str]] = []
        told: list[RelationValue] = []
        found = recording(
            self.watched.circuit, system, run, ClaimPhase.END, standing.append, told.append
        )
        names = closing(loop, standing)
        lasso = tied(replace(found, loop=loop), names)
        called = [replace(t, names=tuple(names.get(n, n) for n in t.names)) for t in told]
        return lasso, called

    def _contradictions(self, told: list[RelationValue]) -> list[int]:
        """The literals under which functions would give equal answers to equal values. [EXTERNAL]

        Circuits do not know of all values whether they are equal, and a lasso may take them for
        different ones that turn out to be one. To require too much costs lassos, and no proof.
        """
        copies = [self.unrolled.opening, *self.unrolled.rounds]
        first: dict[tuple[str, tuple[str, ...]], RelationValue] = {}
        wanted = []
        for each in told:
            before = first.setdefault((each.relation, each.names), each)
            if before.holds != each.holds:
                one, other = (copies[t.step].of(t.literal) for t in (before, each))
                wanted.append(self.unrolled.graph.differ(one, other) ^ 1)
        return wanted

    def _runs_as(self, lasso: Recording) -> int:
        """The literal that all robots run the same events as in a lasso."""
        return self.unrolled.graph.all_of(
            copy.of(literal(cast(Bits, option.chosen)))
            for copy, round_ in zip(self.unrolled.rounds, lasso.rounds, strict=True)
            for option in self.watched.circuit.round.options
            if round_.events[option.robot] == option.position
        )

    def _closes(self, k: int) -> int:
        """The literal that the state after the last round equals the one before round k.

        They need not agree on what is pending before round k: it is so in every round from there
        on, the first time because the trigger comes then or came before, and ever after all the
        more. Something that is expected may be owed before round k and not in the end: it is done
        in the loop, and the next time there is less to do.
        """
        g, watched = self.unrolled.graph, self.watched
        first, last = self.unrolled.rounds[k], self.unrolled.rounds[-1]

        def agree(latch: Latch) -> int:
            before, after = first.of(latch.literal), last.of(latch.next)
            if latch in watched.owed:
                return g.either(before, after ^ 1)
            return g.differ(before, after) ^ 1

        return g.all_of(
            agree(latch)
            for latch in watched.circuit.latches
            if latch is not watched.waiting
            and (self.reads_ran or not latch.name.startswith("ran@"))
        )

    def _fair(self, g: Graph, inside: list[int]) -> list[int]:
        """The literal that the loop's rounds are pending and satisfy all fairness conditions."""
        watched, copies = self.watched, self.unrolled.rounds

        def some(literal: int) -> int:
            pairs = zip(inside, copies, strict=True)
            return g.any_of(g.both(here, copy.of(literal)) for here, copy in pairs)

        wanted = [some(watched.pending ^ 1) ^ 1]
        wanted += [some(condition.met) for condition in watched.conditions]
        for grant in watched.grants:
            wanted.append(g.either(some(grant.asked) ^ 1, some(grant.granted)))
        return wanted
