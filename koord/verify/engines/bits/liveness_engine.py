"""The liveness engine on circuits: bounded lassos, and proofs by counting. [T-COUNT] [LASSO]"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.every_number import NotFiniteError
from koord.semantics.liveness import Response, expected, reads_ran
from koord.semantics.recordings import Recording
from koord.syntax import core
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.system import System
from koord.syntax.walk import asks
from koord.verify.claims import Claim, ClaimPhase
from koord.verify.different_responses import different_responses, sides
from koord.verify.each_claim import Alone, alone, each_alone
from koord.verify.engine_names import Engine
from koord.verify.engines.bits import ic3
from koord.verify.engines.bits.circuit import LEVELS
from koord.verify.engines.bits.clauses import QUICK, Clauses, NoAnswerError
from koord.verify.engines.bits.engine import leave, loose_variables
from koord.verify.engines.bits.lasso_unrolling import LassoSearch
from koord.verify.engines.bits.liveness_to_safety import (
    NOTHING,
    Counting,
    MonitoredCircuit,
    Watching,
    counted,
    counting,
    settles,
)
from koord.verify.engines.bits.robot_permutations import images, speaking_last
from koord.verify.engines.bits.unrolling import holds_always
from koord.verify.engines.engine import Task, Tools, Worker
from koord.verify.helpers import PortableWork
from koord.verify.job_process import JobChannel
from koord.verify.ledger import Ledger
from koord.verify.obstacles import Beyond, Lengths, Obstacle, Unreplayed, Values, gave_up
from koord.verify.processes import Pool
from koord.verify.verdicts import (
    NotReplayedError,
    OnlyOfSliceError,
    Outcome,
    Vacuity,
    Verdict,
    no_fair_run,
)

#: Lassos with so many rounds are looked for before a proof is tried.
FIRST_ROUNDS = 4


class _Try(Struct, frozen=True):
    """A way to search for a proof; fairness is counted up to ``most``, in a number of queries."""

    locks: bool
    lemmas: bool
    narrow: bool
    most: int
    questions: int | None


#: What is tried before longer lassos are looked for, and what after that.
QUICKLY = (_Try(False, False, True, 6, 100_000), _Try(True, False, True, 6, 20_000))
#: What is tried instead where others wait, and how long lassos then are at most.
AGAIN = (_Try(True, True, True, 2, 50_000),)
FEW_ROUNDS = 12
#: What is tried to show that no run is fair at all.
IN_VAIN = (_Try(True, False, True, 2, 2_000),)
AT_LENGTH = (
    _Try(True, False, True, 8, 100_000),
    _Try(True, True, True, 8, 100_000),
    _Try(True, True, False, 64, None),
)


class BitsLivenessEngine(Struct, frozen=True):
    """The engine that decides liveness claims on circuits.

    Where a task counts questions, it does only what promises to end soon, and where it counts
    rounds, only what is tried first: where it counts both, with so many questions a try. The lemmas
    of a task are claims that hold in every round.
    """

    pool: Pool  #: where claims are asked each by itself
    vacuities: list[Vacuity]  #: what is found out besides

    @property
    def name(self) -> str:
        return Engine.BITS.value

    def suits(self, ledger: Ledger, task: Task) -> bool:
        return True

    def work(self, ledger: Ledger, task: Task) -> None:
        started = time.monotonic()
        open_ = [claim for claim in ledger.open() if _leaves_open(ledger.system, claim)]
        asks_ = "a statement asks what an external function gives"
        leave(ledger, open_, None, f"bits: {asks_}", started, Beyond(Engine.BITS, asks_))
        claims = [claim for claim in ledger.open() if claim not in open_]
        stated = [claim.stated for claim in claims if claim.stated is not None]
        for level in range(len(LEVELS)):
            try:
                watching = Watching.of(ledger.system, stated, task.lemmas, level)
            except NotFiniteError as error:
                why = str(error)
                leave(ledger, claims, None, f"bits: {why}", started, Beyond(Engine.BITS, why))
                return
            work = partial(_work, task, watching, started)
            left = [claim for claim in claims if claim not in ledger.verdicts]
            question = partial(LassoQuestion, task, level, tuple(stated))
            each_alone(ledger, left, self.pool, work, self.name, question)
            circuit = watching.circuit
            held = [c for c in claims if c in ledger.verdicts]
            if held and expected(ledger.system) and not self.vacuities:
                run = _Run(ledger, watching, held[0], task.lemmas, started)
                if run.is_impossible():
                    self.vacuities.append(no_fair_run(ledger.system))
            strays = any("strays" in latch.name for latch in circuit.latches)
            if (
                task.questions is not None
                or task.rounds is not None
                or not ledger.open()
                or not strays
                or ledger.deadline.passed()
            ):
                return


class LassoQuestion(PortableWork, frozen=True):
    """A claim about whole runs to decide on another machine, with a circuit of its own."""

    task: Task
    level: int
    stated: tuple[core.Property, ...]  #: all that the circuit is made for
    ledger: Ledger  #: of the claim, detached
    claim: Claim

    def __call__(self, tell: JobChannel) -> Alone:
        own = self.ledger.of([self.claim], tell)
        watching = Watching.of(own.system, self.stated, self.task.lemmas, self.level)
        work = partial(_work, self.task, watching, time.monotonic())
        return alone(own, self.claim, work, Engine.BITS.value)


def make(engine: Engine, tools: Tools) -> Worker:
    """Make the engine for a problem."""
    return BitsLivenessEngine(tools.pool, tools.vacuities)


def _work(task: Task, watching: Watching, started: float, ledger: Ledger, claim: Claim) -> None:
    run = _Run(ledger, watching, claim, task.lemmas, started)
    run.work(_most_rounds(ledger, task), *_tries(task))


def _most_rounds(ledger: Ledger, task: Task) -> int:
    """The greatest length of lassos that are looked for."""
    if task.rounds is not None:
        return task.rounds
    most = ledger.bounds.rounds
    return min(most, FEW_ROUNDS) if task.questions is not None else most


def _tries(task: Task) -> tuple[tuple[_Try, ...], tuple[_Try, ...]]:
    """The proofs to try before longer lassos are looked for, and after that."""
    match task.rounds, task.questions:
        case None, None:
            return QUICKLY, AT_LENGTH
        case None, _:
            return QUICKLY, AGAIN
        case _, None:
            return QUICKLY, ()
        case _, few:
            return tuple(replace(each, questions=few) for each in QUICKLY), ()


def _leaves_open(system: System, claim: Claim) -> bool:
    assert claim.stated is not None
    parts = [claim.stated, *system.program.expectations]
    sides = [side for p in parts for side in (p.condition, p.trigger) if side is not None]
    return any(asks(system.program, side) for side in sides)


class _Run(Struct):
    """A run of the engine: one claim on one circuit."""

    ledger: Ledger
    watching: Watching
    claim: Claim
    lemmas: tuple[Claim, ...]
    started: float
    astray: str = ""
    only_of_slice: bool = False  #: whether what went astray is a lasso of the slice all the same
    used: dict[str, None] = field(default_factory=dict)

    def work(self, most: int, quickly: tuple[_Try, ...], more: tuple[_Try, ...]) -> None:
        """Settle the claim, or give the reason why not."""
        assert self.claim.stated is not None
        rounds = 0
        system = speaking_last(self.watching.system)
        for response in different_responses(system, self.claim.stated):
            watched = self.watching.watched(response)
            loops = LassoSearch(watched, reads_ran(self.watching.system, self.claim.stated))
            quick = [each for each in quickly if watched.grants or not each.locks]
            proved = self._looked(loops, FIRST_ROUNDS) and self._proved(response, watched, quick)
            if not proved and self._goes_on() and self._looked(loops, most):
                proved = self._proved(response, watched, more)
            if not proved:
                rounds = loops.rounds
                break
        else:
            fairness = tuple(name for name in self._names() if name in self.used)
            verdict = Verdict(
                self.claim, Outcome.HOLDS, Engine.BITS, self._seconds(), fairness=fairness
            )
            self.ledger.settle({self.claim: verdict})
        if self.claim in self.ledger.verdicts:
            return
        limits = self.watching.circuit.limits
        obstacle: Obstacle = gave_up(Engine.BITS, self.ledger.deadline)
        reason = f"no lasso of up to {rounds} rounds breaks it, and no proof was found"
        if limits and not self.only_of_slice:
            reason = f"not covered: {'; '.join(limits)}"
            obstacle = Lengths(Engine.BITS, tuple(limits))
        elif self.astray:
            reason = self.astray
            obstacle = Unreplayed(Engine.BITS)
        elif self.ledger.deadline.passed():
            reason = f"timeout; {reason}"
        loose = loose_variables(self.watching.circuit)
        if loose:
            reason += f"; infinitely many values: {', '.join(loose)}"
            if not limits and not self.only_of_slice:
                obstacle = Values(Engine.BITS, tuple(loose))
        leave(self.ledger, [self.claim], None, f"bits: {reason}", self.started, obstacle)

    def is_impossible(self) -> bool:
        """Return whether a quick proof shows that no run is fair at all."""
        watched = self.watching.watched(NOTHING)
        return self._proved(NOTHING, watched, IN_VAIN, anew=True)

    def _goes_on(self) -> bool:
        settled = self.claim in self.ledger.verdicts
        return not settled and not self.astray and not self.ledger.deadline.passed()

    def _seconds(self) -> float:
        return time.monotonic() - self.started

    def _names(self) -> list[str]:
        names = [response.name for response in expected(self.watching.system)]
        return ["robots", "locks", *dict.fromkeys(names)]

    # --- lassos ---------------------------------------------------------------------------------

    def _looked(self, loops: LassoSearch, rounds: int) -> bool:
        """Search for lassos of up to so many rounds. Return whether there is reason to go on.

        Where one does not replay another one may: circuits allow more than programs do.
        """
        ledger = self.ledger
        while loops.rounds < rounds and not ledger.deadline.passed():
            self._tell(f"lassos of {loops.rounds + 1} rounds")
            loops.begin()
            try:
                for lasso in loops.lassos(ledger.system, ledger.deadline):
                    if self._is_violated_by(lasso):
                        return False
            except OutOfBudgetError:
                return False
        return not ledger.deadline.passed()

    def _is_violated_by(self, lasso: Recording) -> bool:
        """Settle the claim if the lasso replays; return whether its slice needs no more lassos."""
        try:
            shown = self.ledger.problem.judge(lasso, self.claim, ClaimPhase.END)
        except NotReplayedError as error:
            self.astray = f"a candidate violation did not replay: {error}"
            self.only_of_slice = isinstance(error, OnlyOfSliceError)
            return self.only_of_slice
        verdict = Verdict(
            self.claim, Outcome.VIOLATED, Engine.BITS, self._seconds(), counterexample=shown
        )
        self.ledger.settle({self.claim: verdict})
        return True

    # --- proofs ---------------------------------------------------------------------------------

    def _proved(
        self,
        response: Response,
        watched: MonitoredCircuit,
        tries: Sequence[_Try],
        *,
        anew: bool = False,
    ) -> bool:
        settled = self.claim in self.ledger.verdicts and not anew
        if self.watching.circuit.limits or settled:
            return False
        try:
            return self._tried(response, watched, tries, anew=anew)
        except NoAnswerError:
            return False

    def _tried(
        self, response: Response, watched: MonitoredCircuit, tries: Sequence[_Try], *, anew: bool
    ) -> bool:
        for each in tries:
            given = self._given() if each.lemmas else []
            if each.lemmas and not given:
                continue
            of = counting(watched, given, locks=each.locks, narrow=each.narrow)
            for times in range(1, each.most + 1):
                if self.ledger.deadline.passed():
                    return False
                found = self._counted(response, of, times, each.questions)
                if found:
                    if not anew:
                        self._rests_on(response, watched, each, times)
                    return True
                if found is None:
                    break
        return False

    def _given(self) -> list[int]:
        held = self.watching.circuit.held
        return [held[lemma] for lemma in self.lemmas if lemma in held]

    def _counted(
        self, response: Response, of: Counting, times: int, questions: int | None
    ) -> bool | None:
        """Return whether fairness is never met so many times; None if that is unknown."""
        for exchange in (True, False):
            question = counted(of, times)
            clauses = Clauses(of.graph, QUICK, self.ledger.deadline)
            alike = self._symmetric(response) if exchange else None
            search = ic3.Ic3Run(
                clauses,
                question,
                self.ledger.deadline,
                images(self.ledger.system, alike, question.latches),
                lambda frame, cubes: self._tell(f"frame {frame}, {cubes} clauses"),
                limit=questions,
            )
            found = search.run()
            clauses.close()
            match found:
                case ic3.Reached():
                    return False
                case ic3.Unfinished():
                    return None
                case ic3.ClauseInvariant():
                    # Asked with all constraints, whatever was left out.
                    asked = replace(question, steps=of.whole)
                    if self._is_kept(of, asked, found):
                        return True
                    # Robots were exchanged that are not alike in every bit.
                    assert exchange, "an invariant that is none"
        return None

    def _is_kept(self, of: Counting, asked: ic3.SafetyQuery, found: ic3.ClauseInvariant) -> bool:
        """Return whether an invariant is inductive, by another solver."""
        deadline = self.ledger.deadline
        return holds_always(of.graph, asked, found.cubes, deadline) and settles(of, deadline)

    def _tell(self, text: str) -> None:
        self.ledger.progress(f"bits, {text}")

    def _symmetric(self, response: Response) -> tuple[core.Property, ...]:
        """The statements that symmetry must preserve: the response, and robots' expectations."""
        return (*response.statements, *sides(self.watching.system, ()))

    def _rests_on(
        self, response: Response, watched: MonitoredCircuit, how: _Try, times: int
    ) -> None:
        """Note which fairness the proof needs, as far as a quick check tells."""
        locks = how.locks and bool(watched.grants)
        needed = [name for name in self._names() if name != "locks" or locks]
        given = self._given() if how.lemmas else []
        for name in list(needed):
            rest = [other for other in needed if other != name]
            of = counting(watched.resting_on(rest), given, locks="locks" in rest, narrow=how.narrow)
            more = (self._counted(response, of, times + k, FEW_QUESTIONS) for k in range(3))
            if any(more):
                needed = rest
        self.used |= dict.fromkeys(needed)


#: So many questions may be asked to do without some fairness.
FEW_QUESTIONS = 1_000
