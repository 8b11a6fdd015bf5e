"""The Horn engine (Spacer): all rounds of a fixed number of robots. [T-PREFIX]

The state is what a configuration at the end of a round consists of. INIT and a round, as bounded
model checking and induction have them, give the clauses; claims that were proved are added to what
is known of a state. Nothing is taken on trust: an invariant is asked of another solver, and a run
is made concrete, state by state, and replayed.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct, field

from koord.semantics.configurations import Configuration
from koord.semantics.every_number import NotFiniteError
from koord.syntax.core import UnaryOp
from koord.syntax.source import NOWHERE
from koord.syntax.system import System
from koord.verify.bounded_check import BoundedCheck
from koord.verify.claims import Claim, ClaimPhase, StepFindings
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.moments import SymbolicConfiguration
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.terms import Term, Terms
from koord.verify.encoding.unrolling import Unrolling, assumed, violations
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose, Task, Tools, Worker
from koord.verify.engines.horn.clauses import Clauses, Reached, Safe, constants, scalars
from koord.verify.ledger import Ledger, Reach
from koord.verify.obstacles import Beyond, Obstacle, Unreplayed, gave_up
from koord.verify.verdicts import Counterexample, NotReplayedError, Outcome, Verdict, has_fewest
from koord.verify.witness import ModelReader, recording_of

#: What takes longer, about so many seconds, is not looked for where all that was asked is answered.
HASTY_S = 3.0

#: What proofs may cost there, where only one for all rounds is left to find:
#: in units of which Spacer does a fifth as many in a second as other solvers.
ANSWERED_S = 0.8

#: What proofs may cost where nobody else is asked.
GENEROUS_S = 600.0

#: What each question about an invariant that was found may cost.
CHECKING_S = 20.0

#: What it may cost to see whether a violation can be had in fewer rounds, and in how many.
SOONER_S, SOONER_ROUNDS = 5.0, 40


class HornEngine(Struct):
    """The engine that finds invariants of reals and integers, and long counterexamples.

    Asked to hold proofs back, it keeps them for others to say more than that, until they are to be
    released.
    """

    proved: dict[Claim, Verdict] = field(default_factory=dict)
    unreplayed: set[Claim] = field(default_factory=set)

    @property
    def name(self) -> str:
        return Engine.SPACER.value

    def suits(self, ledger: Ledger, task: Task) -> bool:
        if task.purpose is not Purpose.HOLD_BACK or ledger.wanting():
            return True
        # Of the rest, the rounds that were looked at are enough, if something is violated.
        return not ledger.is_violated and (task.seconds or GENEROUS_S) <= HASTY_S

    def work(self, ledger: Ledger, task: Task) -> None:
        if task.purpose is Purpose.RELEASE:
            ledger.settle({c: v for c, v in self.proved.items() if c not in ledger.verdicts})
            return
        started = time.monotonic()
        holds_back = task.purpose is Purpose.HOLD_BACK
        seconds = GENEROUS_S if task.seconds is None else task.seconds
        is_answered = holds_back and not ledger.wanting()
        effort = Effort.of_seconds(ANSWERED_S if is_answered else seconds)
        reason = ""
        obstacle: Obstacle = Unreplayed(Engine.SPACER)
        self.unreplayed.clear()
        while not reason and (claims := self._pending(ledger)):
            ledger.progress("Spacer looks for a proof for all rounds")
            try:
                question = HornQuery.of(ledger.system, claims, ledger.proved(), ledger.seed)
                found = question.clauses.solved(ledger.deadline, effort, ledger.seed)
            except NotFiniteError as error:
                reason = f"Spacer: {error}"
                obstacle = Beyond(Engine.SPACER, str(error))
                break
            match found:
                case Safe() if question.is_kept(found, ledger.deadline):
                    seconds = time.monotonic() - started
                    self.proved = {
                        c: Verdict(c, Outcome.HOLDS, Engine.SPACER, seconds) for c in claims
                    }
                    if holds_back:
                        return
                    ledger.settle(self.proved)
                case Reached():
                    self._show(ledger, claims, found, question, started)
                case _:
                    reason = "timeout" if ledger.deadline.is_near() else "Spacer gave up"
                    obstacle = gave_up(Engine.SPACER, ledger.deadline)
        seconds = time.monotonic() - started
        reason = reason or "Spacer: a candidate violation did not replay"
        reach = Reach(Engine.SPACER, None, reason, seconds, obstacle=obstacle)
        ledger.leave(ledger.open(), reach)

    def _pending(self, ledger: Ledger) -> list[Claim]:
        return [claim for claim in ledger.open() if claim not in self.unreplayed]

    def _show(
        self,
        ledger: Ledger,
        claims: Sequence[Claim],
        found: Reached,
        question: HornQuery,
        started: float,
    ) -> None:
        """Settle the claims that a run violates; what cannot be replayed is not tried again."""
        settled = False
        for claim, moment, unrolling in _followed(ledger, claims, found, question):
            reader = ModelReader(unrolling.solver.model(), ledger.system)
            recording = recording_of(reader, unrolling.opening, unrolling.rounds, moment.phase)
            try:
                shown = ledger.problem.judge(recording, claim, moment.phase)
            except NotReplayedError:
                continue
            seconds = time.monotonic() - started
            first = _first(ledger, claim, shown)
            verdict = Verdict(
                claim,
                Outcome.VIOLATED,
                Engine.SPACER,
                seconds,
                counterexample=first.counterexample,
                fewest=first.fewest,
            )
            ledger.settle({claim: verdict})
            settled = True
            break
        if not settled:
            self.unreplayed.update(claims)


def make(engine: Engine, tools: Tools) -> Worker:
    """Make the engine for a problem."""
    return HornEngine()


class HornQuery(Struct, frozen=True):
    """The query whether some claims hold in all rounds.

    ``opens`` holds of INIT, one of ``false_starts`` of one that breaks a claim; ``goes`` holds of a
    state and a round from it, one of ``spoils`` of a state and a round that breaks a claim.
    ``first`` and ``then`` are the state's unknowns after each.
    """

    unrolling: Unrolling
    clauses: Clauses
    opens: list[Term]
    false_starts: list[list[Term]]
    goes: list[Term]
    spoils: list[list[Term]]
    first: list[Term]
    then: list[Term]
    moving: list[
        int
    ]  #: where the unknowns stand among the scalars of a configuration, the first ones

    @staticmethod
    def of(system: System, claims: Sequence[Claim], given: Sequence[Claim], seed: int) -> HornQuery:
        """Build the query. Raises NotFiniteError if the system is beyond Spacer."""
        unrolling = Unrolling(system, seed)
        unknowns, d = unrolling.unknowns, unrolling.encoder.d
        opening = unrolling.opening.moment
        begins = [*opening.constraints, *assumed(system, d, opening)]
        broken = violations(system, d, opening, claims).values()
        begins += unknowns.constraints
        begun = len(unknowns.constraints)
        opens = [*begins, d.unary(UnaryOp.NOT, opening.findings.fault)]
        false_starts = [[*begins, *needed, violated] for violated, needed in broken]
        start = unrolling.encoder.arbitrary(opening.configuration, "#")
        taken = unrolling.encoder.round(start, "round")
        known, turns = _held(system, unrolling, start, given), taken.middle.constraints
        breaks = [
            [*turns, *taken.until(d, moment), *needed, violated]
            for moment in taken.moments
            for violated, needed in violations(system, d, moment, claims).values()
        ]
        if unknowns.limits:
            raise NotFiniteError(NOWHERE, "; ".join(unknowns.uncovered))
        always = [*known, *unknowns.constraints[begun:]]
        calm = d.unary(UnaryOp.NOT, taken.end.findings.fault)
        goes = [*always, *turns, *taken.until(d, taken.end), calm]
        spoils = [[*always, *body] for body in breaks]
        before, first, then = (
            scalars(c) for c in (start, opening.configuration, taken.end.configuration)
        )
        if not len(before) == len(first) == len(then):
            raise NotFiniteError(NOWHERE, "a list may have any length")
        ours = {x.get_id() for x in constants([*opens, *first])}
        rigid = {
            x.get_id(): x
            for x in constants([*before, *goes, *then, *(t for body in spoils for t in body)])
            if x.get_id() in ours or _is_symbol(x)
        }
        moving = [k for k, x in enumerate(before) if _is_free(d, x, rigid)]
        if (
            {x.get_id() for x in constants(before)}
            - rigid.keys()
            - {d.key(before[k]) for k in moving}
        ):
            raise NotFiniteError(NOWHERE, "a variable starts in a way of its own")
        fixed = list(rigid.values())
        clauses = Clauses(d, [*(before[k] for k in moving), *fixed])
        made = HornQuery(
            unrolling,
            clauses,
            opens,
            false_starts,
            goes,
            spoils,
            [*(first[k] for k in moving), *fixed],
            [*(then[k] for k in moving), *fixed],
            moving,
        )
        clauses.reach(opens, made.first)
        clauses.reach([clauses.here, *goes], made.then)
        for body in false_starts:
            clauses.spoil(body)
        for body in spoils:
            clauses.spoil([clauses.here, *body])
        return made

    def is_kept(self, found: Safe, deadline: Deadline) -> bool:
        """Return whether a result is an inductive invariant that implies the claims."""
        d, effort = self.clauses.d, Effort.of_seconds(CHECKING_S)

        def left_by(values: Sequence[Term]) -> Term:
            pairs = list(zip(self.clauses.unknowns, values, strict=True))
            return d.unary(UnaryOp.NOT, d.with_values(found.kept, pairs))

        bodies = [
            [*self.opens, left_by(self.first)],
            [found.kept, *self.goes, left_by(self.then)],
            *self.false_starts,
            *([found.kept, *body] for body in self.spoils),
        ]
        return all(self.clauses.impossible(body, deadline, effort) for body in bodies)


class _First(Struct, frozen=True):
    """A violation, and whether none with fewer rounds exists."""

    counterexample: Counterexample
    fewest: bool


def _first(ledger: Ledger, claim: Claim, shown: Counterexample) -> _First:
    """The violation with the fewest rounds, as far as a cheap search finds one.

    Rounds through which the claim was seen to hold by others are not looked at again.
    """
    before, seen = shown.round - 1, ledger.verdict(claim).rounds
    fewest = has_fewest(shown, seen)
    if fewest or before > SOONER_ROUNDS:
        return _First(shown, fewest)
    bounded = BoundedCheck(ledger.system, ledger.problem.judge, ledger.seed)
    effort = Effort.of_seconds(SOONER_S)
    found = bounded.check([claim], ledger.proved(), before, ledger.deadline, effort).get(claim)
    if found is None or found.counterexample is None:
        is_whole = claim not in bounded.unreplayed
        return _First(shown, is_whole and has_fewest(shown, bounded.covered))
    return _First(found.counterexample, found.fewest)


def _held(
    system: System, unrolling: Unrolling, start: Configuration[Term], given: Sequence[Claim]
) -> list[Term]:
    """The condition that proved claims hold of the state at a round's start."""
    d = unrolling.encoder.d
    checks = SymbolicInputs(unrolling.unknowns, "start")
    moment = SymbolicConfiguration(ClaimPhase.INIT, start, [], StepFindings(False), checks)
    state = [claim for claim in given if claim.is_state_property]
    found = []
    for violated, needed in violations(system, d, moment, state).values():
        found += [*needed, d.unary(UnaryOp.NOT, violated)]
    return found


def _is_free(d: Terms, scalar: Term, rigid: Mapping[int, Term]) -> bool:
    """Return whether a scalar of a state is an unconstrained unknown."""
    return d.known(scalar) is None and d.is_constant(scalar) and d.key(scalar) not in rigid


def _is_symbol(constant: Term) -> bool:
    """Return whether a constant is rigid: fresh ones have a number behind their name."""
    return "!" not in str(constant)


def _followed(
    ledger: Ledger, claims: Sequence[Claim], found: Reached, question: HornQuery
) -> Iterator[tuple[Claim, SymbolicConfiguration, Unrolling]]:
    """The claims that some run through the states violates, and where.

    The solver of the unrolling has just answered with such a run.
    """
    unrolling, last = question.unrolling, len(found.states)
    for moment in unrolling.moments():
        configuration = moment.configuration
        if moment.phase in (ClaimPhase.INIT, ClaimPhase.END) and configuration.round < last:
            values = scalars(configuration)
            moving = [values[k] for k in question.moving]
            state = found.states[configuration.round]
            unrolling.solver.add(question.clauses.equations(moving, state))
        if len(unrolling.rounds) == last:
            asked = violations(ledger.system, unrolling.encoder.d, moment, claims)
            for claim, (violated, needed) in asked.items():
                unrolling.solver.add(needed)
                if unrolling.solver.check([violated], ledger.deadline) is SolverAnswer.SAT:
                    yield claim, moment, unrolling
        if moment.phase is ClaimPhase.END and configuration.round >= last:
            return
