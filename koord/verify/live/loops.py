"""Lassos of bounded length: rounds unrolled, the last of which leads back to an earlier state."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from koord.semantics.configurations import System
from koord.semantics.traces.recording import Recording
from koord.verify.bits.clauses import TRUE_SIDE
from koord.verify.bits.graph import Graph
from koord.verify.bits.runs import recording
from koord.verify.bits.unrolling import Unrolled
from koord.verify.claims import Phase
from koord.verify.live.monitors import Watched
from koord.verify.live.tying import tied
from koord.verify.solving import Answer, Deadline


@dataclass(slots=True)
class Loops:
    """The rounds of a watched circuit, unrolled so far, and the lassos among them. [LASSO]"""

    watched: Watched
    reads_ran: bool  #: whether a statement does; no later round depends on it
    unrolled: Unrolled = field(init=False)

    def __post_init__(self) -> None:
        self.unrolled = Unrolled(self.watched.circuit)

    @property
    def rounds(self) -> int:
        """How many rounds have been looked at."""
        return len(self.unrolled.rounds)

    def one_more(self, system: System, deadline: Deadline) -> tuple[Answer, Recording | None]:
        """Whether a lasso has one round more than those looked at, and which."""
        unrolled = self.unrolled
        copy = unrolled.begin()
        circuit, g = self.watched.circuit, unrolled.graph
        choices = [g.input(f"loop {k} of {self.rounds}") for k in range(self.rounds)]
        wanted = [g.any_of(choices), copy.of(circuit.steps), copy.of(circuit.lost) ^ 1]
        for k, choice in enumerate(choices):
            wanted += [g.both(choice, other) ^ 1 for other in choices[:k]]
            wanted.append(g.both(choice, self._closes(k) ^ 1) ^ 1)
        inside = [g.any_of(choices[: k + 1]) for k in range(self.rounds)]
        answer = unrolled.asked(g.all_of([*wanted, *self._fair(g, inside)]), deadline)
        if answer is not Answer.SAT:
            return answer, None
        run = unrolled.witnessed()
        model = unrolled.clauses.model()
        numbers = [unrolled.clauses.of(choice, TRUE_SIDE) for choice in choices]
        loop = next(k for k, number in enumerate(numbers) if model[number] > 0)
        standing: list[dict[int, str]] = []
        found = recording(circuit, system, run, Phase.END, standing.append)
        return answer, tied(replace(found, loop=loop), standing)

    def _closes(self, k: int) -> int:
        """Whether the state after the last round is the one before round k."""
        g, last = self.unrolled.graph, self.unrolled.rounds[-1]
        first = self.unrolled.rounds[k]
        same = [
            g.differ(first.of(latch.literal), last.of(latch.next)) ^ 1
            for latch in self.watched.circuit.latches
            if self.reads_ran or not latch.name.startswith("ran@")
        ]
        return g.all_of(same)

    def _fair(self, g: Graph, inside: list[int]) -> list[int]:
        """That rounds inside the loop are pending, and do all that fairness asks for."""
        watched, copies = self.watched, self.unrolled.rounds

        def some(literal: int) -> int:
            pairs = zip(inside, copies, strict=True)
            return g.any_of(g.both(here, copy.of(literal)) for here, copy in pairs)

        wanted = [some(watched.pending ^ 1) ^ 1]
        wanted += [some(condition.met) for condition in watched.conditions]
        for grant in watched.grants:
            wanted.append(g.either(some(grant.asked) ^ 1, some(grant.granted)))
        return wanted
