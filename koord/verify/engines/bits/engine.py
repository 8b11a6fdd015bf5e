"""The engine on circuits: bounded model checking, induction and IC3, all on one circuit."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.every_number import NotFiniteError
from koord.syntax.core import Declaration
from koord.syntax.types import FloatType
from koord.syntax.walk import nodes
from koord.verify.claims import Claim, ClaimPhase
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.engine_names import Engine
from koord.verify.engines.bits import abc, ic3
from koord.verify.engines.bits.circuit import LEVELS, Circuit, circuit_of
from koord.verify.engines.bits.clauses import QUICK, TRUE_SIDE, Clauses, NoAnswerError
from koord.verify.engines.bits.constraint_selection import everything, narrowed
from koord.verify.engines.bits.found_runs import recording
from koord.verify.engines.bits.graph import FALSE
from koord.verify.engines.bits.invariants import Lemmas, lemmas
from koord.verify.engines.bits.legal_choices import choices_of, with_legal_choices
from koord.verify.engines.bits.robot_permutations import images
from koord.verify.engines.bits.unrolling import Copy, UnrolledCircuit, holds_always
from koord.verify.engines.engine import Task, Tools, Worker
from koord.verify.ledger import Ledger, Reach
from koord.verify.obstacles import Lengths, NoInvariant, Obstacle, Unreplayed, Values, gave_up
from koord.verify.verdicts import NotReplayedError, Outcome, Verdict, has_fewest

#: So many rounds are unrolled before IC3 is asked: one, before claims alone are.
FIRST_ROUNDS = 2

#: How many hard questions may be asked where they are counted: for some seconds in all.
FEW_HARD = 40


class BitsEngine(Struct, frozen=True):
    """The engine on circuits; ``engine`` says whether IC3 searches for proofs, or abc's PDR.

    Where a task counts questions, it does only what promises to be quick.
    """

    engine: Engine = Engine.BITS

    @property
    def name(self) -> str:
        return self.engine.value

    def suits(self, ledger: Ledger, task: Task) -> bool:
        if self.engine is Engine.ABC and abc.installed() is None:
            return False
        return task.questions is None or not _has_floats(ledger)

    def work(self, ledger: Ledger, task: Task) -> None:
        started = time.monotonic()
        claims = [c for c in ledger.open() if not task.named or c.name in task.named]
        for level in range(len(LEVELS)):
            try:
                circuit = circuit_of(ledger.system, claims, level)
            except NotFiniteError as error:
                leave(ledger, claims, None, f"bits: {error}", started)
                return
            run = _Run(ledger, circuit, started, self.engine, task)
            run.work()
            again = [claim for claim in run.astray if claim not in ledger.verdicts]
            if not again or not run.strays or ledger.deadline.passed():
                return
            claims = again


def make(engine: Engine, tools: Tools) -> Worker:
    """Make the engine for a problem."""
    return BitsEngine(engine)


def _has_floats(ledger: Ledger) -> bool:
    return any(
        isinstance(node, Declaration) and isinstance(node.variable.type, FloatType)
        for node in nodes(ledger.system.program)
    )


def leave(
    ledger: Ledger,
    claims: Sequence[Claim],
    rounds: int | None,
    reason: str,
    started: float,
    obstacle: Obstacle | None = None,
) -> None:
    """Record how far claims were checked, and why they are open."""
    seconds = time.monotonic() - started
    if reason and obstacle is None:
        obstacle = gave_up(Engine.BITS, ledger.deadline)
    ledger.leave(claims, Reach(Engine.BITS, rounds, reason, seconds, obstacle=obstacle))


class _Run:
    """A run of the engine: one circuit, and the open claims of a ledger."""

    def __init__(
        self,
        ledger: Ledger,
        circuit: Circuit,
        started: float,
        engine: Engine,
        task: Task,
    ) -> None:
        self.ledger = ledger
        self.circuit = circuit
        self.started = started
        self.engine = engine
        self.questions = task.questions  #: so many IC3 may ask; then only what may be quick
        self.frame_questions = task.frame_questions  #: the same until it has another frame
        self.seconds = task.seconds  #: of abc
        self.completed: int | None = None
        self.astray: dict[Claim, str] = {}  #: with a violation that is no run
        self.proved: dict[Claim, None] = {}
        self.no_invariant: NoInvariant | None = None  #: who looked for one was stopped
        self.unrolled = UnrolledCircuit(self.circuit)

    @property
    def strays(self) -> bool:
        """True if tracking more values could decide more."""
        circuit = self.circuit
        return circuit.lost != FALSE or any("strays" in latch.name for latch in circuit.latches)

    @property
    def sparing(self) -> bool:
        return self.questions is not None

    def open(self) -> list[Claim]:
        return [
            claim
            for claim in self.circuit.bad
            if claim not in self.ledger.verdicts and claim not in self.astray
        ]

    def work(self) -> None:
        ledger = self.ledger
        for rounds, prove in ((1, self._induct), (FIRST_ROUNDS, self._search)):
            self._unroll(min(rounds, ledger.bounds.rounds))
            if self.completed is None or not self.open() or self.circuit.limits:
                break
            try:
                prove()
            except NoAnswerError:
                break
        if self.open() and not self.sparing:
            self._unroll(ledger.bounds.rounds)
        reason, through = "", self.completed
        obstacle: Obstacle | None = self.no_invariant
        if self.circuit.limits:
            obstacle = Lengths(self.engine, tuple(self.circuit.limits))
            through = None  # a longer list may break a claim at once
            reason = f"not covered: {'; '.join(self.circuit.limits)}"
        elif ledger.deadline.passed():
            reason, obstacle = "timeout", None
        elif self.completed is None or self.completed < ledger.bounds.rounds:
            reason = "bits: too much to be proved" if self.sparing else "timeout"
        leave(ledger, self.open(), through, reason, self.started, obstacle)
        for claim, why in self.astray.items():
            if claim not in ledger.verdicts:
                names = tuple(loose_variables(self.circuit))
                astray = Values(self.engine, names) if names else Unreplayed(self.engine)
                reason = f"bits: {why}{self._open_values()}"
                leave(ledger, [claim], None, reason, self.started, astray)

    def _open_values(self) -> str:
        names = loose_variables(self.circuit)
        return f"; infinitely many values: {', '.join(names)}" if names else ""

    # --- unrolling ------------------------------------------------------------------------------

    def _unroll(self, rounds: int) -> None:
        """Check INIT and so many rounds, one after the other."""
        unrolled, circuit = self.unrolled, self.circuit
        if self.completed is None:
            at = {claim: ((ClaimPhase.INIT, x),) for claim, x in circuit.bad_start.items()}
            if not self._looked(unrolled.opening, at):
                return
            self.completed = 0
        while self.open() and self.completed < rounds:
            self.ledger.progress(f"bits, round {self.completed + 1} of {rounds}")
            copy = unrolled.begin()
            if not self._looked(copy, circuit.bad):
                return
            if (
                unrolled.asked(copy.of(circuit.lost), self.ledger.deadline)
                is not SolverAnswer.UNSAT
            ):
                self.astray |= dict.fromkeys(self.open(), "lists grow beyond what is followed")
                return
            self.completed += 1

    def _looked(self, copy: Copy, bad: Mapping[Claim, tuple[tuple[ClaimPhase, int], ...]]) -> bool:
        """Settle the claims that break in one step. Return False if time ran out."""
        unrolled, deadline = self.unrolled, self.ledger.deadline
        for claim in self.open():
            for phase, literal in bad.get(claim, ()):
                here = copy.of(literal)
                answer = unrolled.asked(here, deadline)
                if answer is SolverAnswer.UNKNOWN:
                    return False
                if answer is SolverAnswer.SAT:
                    self._found(claim, phase)
                    break
                unrolled.never(here)
        return True

    def _found(self, claim: Claim, phase: ClaimPhase) -> None:
        """Replay the run of the last model, and settle the claim if the run is legal."""
        run = self.unrolled.witnessed()
        ledger = self.ledger
        try:
            shown = recording(self.circuit, ledger.system, run, phase)
            counterexample = ledger.problem.judge(shown, claim, phase)
        except NotReplayedError as error:
            self.astray[claim] = f"a candidate violation did not replay: {error}"
            return
        seconds = time.monotonic() - self.started
        # Circuits allow more than the program, and shorter lists: then a longer one may break it.
        fewest = not self.circuit.limits and has_fewest(counterexample, self.completed)
        verdict = Verdict(
            claim,
            Outcome.VIOLATED,
            self.engine,
            seconds,
            counterexample=counterexample,
            fewest=fewest,
        )
        ledger.settle({claim: verdict})

    # --- proofs ---------------------------------------------------------------------------------

    def _induct(self) -> None:
        """Settle the largest set of claims that is inductive."""
        circuit = self.circuit
        clauses = self._clauses()
        given = circuit.kept_by_states(self.ledger.proved())
        for literal in given:
            clauses.require(literal)
        claims = self.open()
        while claims:
            held = [clauses.of(x, TRUE_SIDE) for x in circuit.kept_by_states(claims)]
            failed = []
            for claim in claims:
                bad = circuit.d.graph.any_of([x for _, x in circuit.bad[claim]])
                broken = circuit.d.graph.either(bad, self._lost())
                if broken != FALSE and clauses.can_hold(broken, held):
                    failed.append(claim)
            if not failed:
                break
            claims = [claim for claim in claims if claim not in failed]
        clauses.close()
        if not claims:
            return
        kept = tuple(circuit.kept_by_states(claims))
        question = replace(everything(circuit, claims, given), kept=kept)
        said = lemmas(self.ledger, circuit, question, (), claims)
        if said.is_checked or self._is_checked(question, ()):
            self._holds(claims, said)

    def _is_checked(self, question: ic3.SafetyQuery, cubes: Sequence[ic3.Cube]) -> bool:
        """Return whether a solver that found none of it says that it is an invariant."""
        return holds_always(self.circuit.d.graph, question, cubes, self.ledger.deadline)

    def _clauses(self) -> Clauses:
        left = FEW_HARD if self.sparing else None
        heard = self.ledger.system.budget.report
        return Clauses(self.circuit.d.graph, QUICK, self.ledger.deadline, left, heard)

    def _lost(self) -> int:
        g, circuit = self.circuit.d.graph, self.circuit
        return g.both(circuit.lost, circuit.steps)

    def _holds(self, claims: Sequence[Claim], found: Lemmas) -> None:
        """Settle claims as holding, with their invariant as lemmas."""
        verdict = Verdict(
            claims[0],
            Outcome.HOLDS,
            self.engine,
            time.monotonic() - self.started,
            lemmas=found.statements,
            unsaid=found.unsaid,
        )
        self.ledger.settle({claim: replace(verdict, claim=claim) for claim in claims})

    def _search(self) -> None:
        """Run IC3 on the remaining claims together, until each is settled or given up."""
        circuit = self.circuit
        narrow = exchange = True
        while claims := self.open():
            given = circuit.kept_by_states(self.ledger.proved())
            question = (
                narrowed(circuit, claims, given, between=self.engine is Engine.ABC)
                if narrow
                else everything(circuit, claims, given)
            )
            found = self._searched(question, claims, exchange=exchange)
            match found:
                case ic3.ClauseInvariant():
                    # Asked with all constraints, whatever the question left out.
                    whole = everything(circuit, claims, given)
                    asked = replace(question, steps=whole.steps, bad=whole.bad)
                    # If it takes too long to say it, there is time left to look at it.
                    with self.ledger.deadline.sharing(1 / 2):
                        said = lemmas(self.ledger, circuit, asked, found.cubes, claims)
                    # What is said was looked at again; what is not is looked at clause by clause.
                    if said.is_checked or self._is_checked(asked, found.cubes):
                        self._holds(claims, said)
                        return
                    if self.engine is Engine.ABC:
                        self.astray |= dict.fromkeys(claims, "abc gave an invariant that is none")
                        return
                    # Robots were exchanged that are not alike in every bit.
                    assert exchange, "an invariant that is none"
                    exchange = False
                case ic3.Reached(rounds=rounds):
                    before = len(claims)
                    self._unroll(rounds)
                    if len(self.open()) == before:
                        if not narrow:
                            return
                        narrow = False
                case ic3.Unfinished():
                    who = "PDR" if self.engine is Engine.ABC else "IC3"
                    self.no_invariant = NoInvariant(self.engine, who)
                    return

    def _searched(
        self, question: ic3.SafetyQuery, claims: Sequence[Claim], *, exchange: bool
    ) -> ic3.ClauseInvariant | ic3.Reached | ic3.Unfinished:
        g, ledger = self.circuit.d.graph, self.ledger
        question = with_legal_choices(g, question, choices_of(self.circuit))
        if self.engine is Engine.ABC:
            ledger.progress("abc, PDR")
            return abc.searched(g, question, ledger.deadline, self.seconds)
        properties = tuple(c.stated for c in claims if c.stated is not None)
        clauses = self._clauses()
        search = ic3.Ic3Run(
            clauses,
            question,
            ledger.deadline,
            images(ledger.system, properties if exchange else None, question.latches),
            lambda frame, cubes: ledger.progress(f"bits, IC3, frame {frame}, {cubes} clauses"),
            limit=self.questions,
            frame_limit=self.frame_questions,
        )
        found = search.run()
        clauses.close()
        return found


def loose_variables(circuit: Circuit) -> list[str]:
    """The variables whose values are not all tracked."""
    return list(dict.fromkeys(map(_plain, circuit.d.looser)))


def _plain(name: str) -> str:
    """A variable's name without robot, element and round."""
    for mark in "@[#":
        name = name.split(mark)[0]
    return name
