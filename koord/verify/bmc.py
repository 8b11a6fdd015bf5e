"""Bounded model checking: rounds unrolled one by one on one incremental solver.

What was shown of a round is required of it from then on, so each round is asked about what is new.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from koord.semantics.configurations import System
from koord.semantics.domain import disjunction
from koord.semantics.turns import holds_in
from koord.syntax.core import BinaryOp, UnaryOp
from koord.verify.claims import Claim, Phase, broken
from koord.verify.rounds import Encoder, Moment, Opening, SymbolicRound
from koord.verify.solving import Answer, Deadline, Solver
from koord.verify.symbols import Unknowns
from koord.verify.terms import Term, Terms
from koord.verify.verdicts import Counterexample, Engine, Outcome, Verdict
from koord.verify.witness import NotReplayedError, Reader, recording_of, replayed

#: Called with the number of the round that is being looked at.
Progress = Callable[[int], None]


@dataclass(slots=True)
class Unrolling:
    """A system unrolled so far: the solver knows INIT and some rounds."""

    system: System
    seed: int = 0
    unknowns: Unknowns = field(init=False)
    encoder: Encoder = field(init=False)
    solver: Solver = field(init=False)
    opening: Opening = field(init=False)
    rounds: list[SymbolicRound] = field(default_factory=list)

    def __post_init__(self) -> None:
        d = Terms()
        self.unknowns = Unknowns(d, self.system.robots)
        self.encoder = Encoder(self.system, self.unknowns)
        self.solver = Solver(d, self.unknowns, self.seed)
        self.opening = self.encoder.initial()
        self.solver.add(self.opening.moment.constraints)
        self.solver.add(assumed(self.system, self.encoder.d, self.opening.moment))

    def moments(self, rounds: int) -> Iterator[Moment]:
        """The configurations to look at, in order, up to so many rounds. Unrolls as it goes."""
        yield self.opening.moment
        self._sound(self.opening.moment)
        start = self.opening.moment.configuration
        for number in range(rounds):
            taken = self.encoder.round(start, str(number))
            self.rounds.append(taken)
            self.solver.add(taken.middle.constraints)
            if taken.inside is not None:
                yield taken.inside
                self._sound(taken.inside)
            self.solver.add(taken.urgency)
            yield taken.middle
            self._sound(taken.middle)
            self.solver.add(taken.end.constraints)
            yield taken.end
            self._sound(taken.end)
            start = taken.end.configuration

    def _sound(self, moment: Moment) -> None:
        """A faulted configuration has no successors. [FAULT]"""
        self.solver.add([self.encoder.d.unary(UnaryOp.NOT, moment.findings.fault)])


def assumed(system: System, d: Terms, moment: Moment) -> list[Term]:
    """The assumptions about the configuration after INIT. [PROP-ASSUME]"""
    needed: list[Term] = []
    for assumption in system.program.assumptions:
        holds, legality = holds_in(
            d, system, moment.configuration, assumption.condition, assumption.bound, moment.checks
        )
        needed += [holds, *(x.condition for x in legality)]
    return needed


def check_bounded(
    system: System,
    claims: Sequence[Claim],
    rounds: int,
    deadline: Deadline,
    *,
    seed: int = 0,
    progress: Progress = lambda round_: None,
) -> dict[Claim, Verdict]:
    """Verdicts on the claims for runs of up to ``rounds`` rounds.

    A claim that is violated is so in the first round in which one can be. After ``deadline`` the
    claims still open are *unknown*, through the last round that was looked at in full.
    """
    started = time.monotonic()
    unrolling = Unrolling(system, seed)
    open_claims = list(claims)
    verdicts: dict[Claim, Verdict] = {}
    completed: int | None = None
    reason = ""
    for moment in unrolling.moments(rounds):
        progress(moment.configuration.round if moment.phase is Phase.END else completed or 0)
        try:
            found, reason = _look(unrolling, moment, open_claims, deadline, started)
        except NotReplayedError as error:
            found, reason = {}, f"a candidate violation did not replay: {error}"
        verdicts |= found
        open_claims = [claim for claim in open_claims if claim not in verdicts]
        if reason or not open_claims:
            break
        if moment.phase in (Phase.INIT, Phase.END):
            completed = moment.configuration.round
    seconds = time.monotonic() - started
    limits = sorted(set(unrolling.unknowns.limits))
    if not reason and limits:
        reason = f"not covered: {'; '.join(limits)}"
    outcome = Outcome.UNKNOWN if reason else Outcome.HOLDS
    for claim in open_claims:
        verdicts[claim] = Verdict(
            claim, outcome, Engine.BMC, seconds, rounds=completed, reason=reason
        )
    return verdicts


def _look(
    unrolling: Unrolling,
    moment: Moment,
    claims: Sequence[Claim],
    deadline: Deadline,
    started: float,
) -> tuple[dict[Claim, Verdict], str]:
    """The claims that this configuration can break; and why the look was cut short, if it was."""
    d, solver = unrolling.encoder.d, unrolling.solver
    asked = violations(unrolling.system, d, moment, claims)
    for _, needed in asked.values():
        solver.add(needed)
    verdicts: dict[Claim, Verdict] = {}
    pending = {claim: violated for claim, (violated, _) in asked.items()}
    while pending:
        answer = solver.check([disjunction(d, list(pending.values()))], deadline)
        if answer is Answer.UNKNOWN:
            return verdicts, "timeout" if deadline.passed() else "the solver gave up"
        if answer is Answer.UNSAT:
            break
        model = solver.model()
        broken_here = [claim for claim, violated in pending.items() if model.truth(violated)]
        # A fault ends the run, so a run that breaks another claim is preferred to show it.
        claim = broken_here[0]
        reader = Reader(model, unrolling.system)
        recording = recording_of(reader, unrolling.opening, unrolling.rounds, moment.phase)
        counterexample: Counterexample = replayed(unrolling.system, recording, claim, moment.phase)
        verdicts[claim] = Verdict(
            claim,
            Outcome.VIOLATED,
            Engine.BMC,
            time.monotonic() - started,
            counterexample=counterexample,
        )
        del pending[claim]
    never = [d.unary(UnaryOp.NOT, violated) for violated in pending.values()]
    solver.add(never)
    return verdicts, ""


def violations(
    system: System, d: Terms, moment: Moment, claims: Sequence[Claim]
) -> dict[Claim, tuple[Term, list[Term]]]:
    """For each claim that this configuration can break: when it does, and what that needs."""
    found: dict[Claim, tuple[Term, list[Term]]] = {}
    sound = d.unary(UnaryOp.NOT, moment.findings.fault)
    for claim in claims:
        if not claim.looked_at(moment.phase):
            continue
        violated, legality = broken(
            d, system, claim, moment.configuration, moment.findings, moment.checks
        )
        if claim.is_state_property:
            violated = d.binary(BinaryOp.AND, sound, violated)
        violated = d.binary(BinaryOp.AND, moment.real, violated)
        if d.known(violated) is not False:
            found[claim] = (violated, [x.condition for x in legality])
    return found
