"""The ledger of a verification: settled claims, and how far open ones were checked.

Engines work on a ledger and write down each answer as it comes, so that stopping one loses nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TypeAlias

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.domain import NumberTooLongError
from koord.semantics.every_number import NotFiniteError
from koord.semantics.recordings import Recording
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimPhase
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.job_process import was_interrupted
from koord.verify.obstacles import (
    Beyond,
    Failure,
    Interrupted,
    Obstacle,
    TimeUp,
    TooLong,
    failed_at,
    failure_of,
    gave_up,
)
from koord.verify.verdicts import (
    Bounds,
    BrokenStep,
    Counterexample,
    Outcome,
    Vacuity,
    Verdict,
)

#: How much work goes into proofs for all rounds where every round that was asked about is known.
ANSWERED_ALL_S = 20.0

#: Replays a recording that should break a claim; raises NotReplayedError if it does not.
Judge = Callable[[Recording, Claim, ClaimPhase], Counterexample]


class VerificationProblem(Struct, frozen=True):
    """A verification problem: the system, and the judge that replays counterexamples.

    ``original`` is the system without opaque values: the same as ``system`` if it has none.
    """

    system: System
    judge: Judge
    original: System

    @property
    def is_abstract(self) -> bool:
        return self.system is not self.original


class Reach(Struct, frozen=True):
    """The reach of an engine on an open claim: rounds, the reason to stop, and the obstacle.

    ``rounds`` is the last round through which the claim holds; None: not even INIT is known.
    ``reason`` is empty if it was not asked to go further.
    """

    engine: Engine
    rounds: int | None
    reason: str
    seconds: float
    step: BrokenStep | None = None  #: why an invariant is not inductive
    obstacle: Obstacle | None = None  #: what stood in the way


#: From when to when, as :func:`time.monotonic` counts, which is the same in all processes.
Interval: TypeAlias = "tuple[float, float]"


class Extract(Struct, frozen=True):
    """The results on some claims of one ledger, to be merged into another."""

    verdicts: Mapping[Claim, Verdict]
    reaches: Mapping[Claim, Sequence[Reach]]
    stopped: str
    interrupted: bool
    failures: Mapping[Failure, frozenset[Claim]] = field(default_factory=dict)
    spans: Mapping[Claim, Sequence[Interval]] = field(default_factory=dict)
    vacuities: tuple[Vacuity, ...] = ()

    def moved(self, seconds: float) -> Extract:
        """The same with moments that are so much later: those of another machine's clock."""
        spans = {
            claim: [(first + seconds, last + seconds) for first, last in its]
            for claim, its in self.spans.items()
        }
        return replace(self, spans=spans)


class Ledger(Struct):
    """The state of one verification: verdicts, reaches, budgets and failures."""

    problem: VerificationProblem
    bounds: Bounds
    deadline: Deadline
    claims: tuple[Claim, ...]
    seed: int = 0
    report: Callable[[str], None] = lambda text: None
    verdicts: dict[Claim, Verdict] = field(default_factory=dict)
    stopped: str = ""  #: why all engines were stopped, if they were
    interrupted: bool = False  #: whether that was Ctrl-C
    #: is told of each claim of which more is known than before
    noted: Callable[[Verdict], None] = lambda verdict: None
    #: is told of each engine that failed
    failed: Callable[[Failure], None] = lambda failure: None
    #: what engines ran into, with the claims that were open then
    failures: dict[Failure, frozenset[Claim]] = field(default_factory=dict)
    vacuities: list[Vacuity] = field(default_factory=list)  #: what engines found out besides
    in_the_way: tuple[Obstacle, ...] = ()  #: what stands in the way of all engines
    #: what was spent on claims before, in seconds
    before: Mapping[Claim, float] = field(default_factory=dict)
    shortened: bool = False  #: whether it ends sooner, as all that was asked is answered
    clock: Callable[[], float] = time.monotonic
    _reaches: dict[Claim, dict[Engine, Reach]] = field(default_factory=dict)
    _spans: dict[Claim, list[Interval]] = field(default_factory=dict)
    _since: float | None = None  #: up to when time is put down; None while others work

    def __post_init__(self) -> None:
        self._since = self.clock()

    @property
    def system(self) -> System:
        return self.problem.system

    def progress(self, text: str) -> None:
        """Report which engine works on which claims, and the claims violated so far.

        Once all that was asked is answered, it says what the rest is for.
        """
        if open_ := self.open():
            text = f"{_named(open_)}: {text}"
            if not self.wanting():
                text = f"answered; for all rounds, {text}"
        self.say(text)

    def say(self, text: str) -> None:
        """Report work that is about no claim, and the claims violated so far."""
        violated = [c.name for c, v in self.verdicts.items() if v.outcome is Outcome.VIOLATED]
        self.report(f"{text}; violated: {', '.join(violated)}" if violated else text)

    @contextmanager
    def stopping(self) -> Iterator[None]:
        """Within the context, what stops all engines ends it, and the ledger records the reason."""
        try:
            yield
        except NotFiniteError as error:
            self.stopped = str(error)
            self.in_the_way = (Beyond(Engine.NONE, self.stopped),)
        except NumberTooLongError as error:
            self.stopped = error.diagnostics[0].message
            self.in_the_way = (TooLong(Engine.NONE, error.names),)
        except OutOfBudgetError:
            self.stopped = "timeout"
        except KeyboardInterrupt:
            self.stopped, self.interrupted = "interrupted", True
        except Exception:
            if not was_interrupted():
                raise
            self.stopped, self.interrupted = "interrupted", True

    @contextmanager
    def enduring(self, who: str) -> Iterator[None]:
        """Within the context, an exception ends that engine only, and the ledger records it."""
        try:
            yield
        except NumberTooLongError as error:
            self.fail(Failure(who, error.diagnostics[0].message, names=error.names))
        except (KoordError, NotFiniteError, OutOfBudgetError):
            raise  # nobody's mistake
        except Exception as error:
            if was_interrupted():
                raise KeyboardInterrupt from error
            self.fail(failure_of(who, error))

    @contextmanager
    def rationing(self, steps: int | None) -> Iterator[None]:
        """Within the context, an engine has so many steps of evaluation; then it ends (None: all).

        They are counted alike on every machine. What it found out by then counts.
        """
        given = self.problem
        if steps is None:
            yield
            return
        budget = given.system.budget.rationed(steps)
        system, original = (replace(s, budget=budget) for s in (given.system, given.original))
        original = original if given.is_abstract else system
        self.problem = replace(given, system=system, original=original)
        try:
            yield
        except OutOfBudgetError:
            if given.system.budget.is_over():
                raise
        finally:
            self.problem = given

    def fail(self, failure: Failure) -> None:
        """Record that an engine gives no answer to the open claims."""
        before = self.failures.get(failure, frozenset())
        self.failures[failure] = before.union(self.open())
        self.failed(failure)

    def open(self) -> list[Claim]:
        """The claims that are not settled, in order."""
        return [claim for claim in self.claims if claim not in self.verdicts]

    @property
    def is_violated(self) -> bool:
        """True if some claim is violated, which decides the overall outcome."""
        return any(verdict.outcome is Outcome.VIOLATED for verdict in self.verdicts.values())

    def is_of_all_rounds(self, names: Collection[str]) -> bool:
        """Return whether all named claims (or all) are settled for every round."""
        asked = [self.verdict(c) for c in self.claims if not names or c.name in names]
        return all(
            v.outcome is Outcome.VIOLATED or (v.outcome is Outcome.HOLDS and v.rounds is None)
            for v in asked
        )

    def wanting(self) -> list[Claim]:
        """The open claims that no engine checked through as many rounds as asked for."""
        return [claim for claim in self.open() if self.verdict(claim).outcome is Outcome.UNKNOWN]

    def is_overtime(self) -> bool:
        """Return whether time is up; it is shortened once every claim has an answer."""
        if not self.shortened and self.open() and not self.wanting():
            self.shortened, self.deadline = True, self.deadline.of_work(ANSWERED_ALL_S)
        return self.shortened and self.deadline.passed()

    def proved(self) -> list[Claim]:
        """The claims that hold in all rounds, which may be used as lemmas."""
        settled = [(claim, self.verdicts[claim]) for claim in self.claims if claim in self.verdicts]
        return [c for c, v in settled if v.outcome is Outcome.HOLDS and v.rounds is None]

    def settle(self, verdicts: Mapping[Claim, Verdict]) -> None:
        """Record verdicts, with the time spent on their claims by all engines."""
        timed = {claim: replace(v, seconds=self.spent(claim)) for claim, v in verdicts.items()}
        self.verdicts.update(timed)
        for verdict in timed.values():
            self.noted(verdict)

    def leave(self, claims: Iterable[Claim], reach: Reach) -> None:
        """Record how far an engine checked claims, unless it got farther before."""
        for claim in claims:
            of_engines = self._reaches.setdefault(claim, {})
            before = of_engines.get(reach.engine)
            if before is None or _rounds(before) <= _rounds(reach):
                of_engines[reach.engine] = reach
                if claim not in self.verdicts:
                    self.noted(self.verdict(claim))

    # --- what is spent ---------------------------------------------------------------------------

    def spent(self, claim: Claim) -> float:
        """The seconds spent on a claim, alone or together with others."""
        self._put_down_time()
        return self.before.get(claim, 0.0) + _together(self._spans.get(claim, ()))

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Within the context, others work on claims, on ledgers of their own."""
        self._put_down_time()
        self._since = None
        try:
            yield
        finally:
            self._since = self.clock()

    def _put_down_time(self) -> None:
        if self._since is None:
            return
        now = self.clock()
        for claim in self.open():
            spans = self._spans.setdefault(claim, [])
            if spans and spans[-1][1] == self._since:
                spans[-1] = (spans[-1][0], now)
            else:
                spans.append((self._since, now))
        self._since = now

    # --- ledgers of some claims -----------------------------------------------------------------

    def of(self, claims: Collection[Claim], report: Callable[[str], None]) -> Ledger:
        """A ledger with only these of the open claims; settled ones are known."""
        known = dict(self.verdicts)
        kept = tuple(claim for claim in self.claims if claim in known or claim in claims)
        reaches = {c: dict(r) for c, r in self._reaches.items() if c in claims}
        self._put_down_time()
        spans = {c: list(s) for c, s in self._spans.items()}
        # Nobody hears what is noted elsewhere: it is noted when it is taken.
        return replace(
            self,
            claims=kept,
            report=report,
            verdicts=known,
            noted=lambda verdict: None,
            failed=lambda failure: None,
            failures={},
            vacuities=[],
            _reaches=reaches,
            _spans=spans,
        )

    def detached(self, claims: Collection[Claim]) -> Ledger:
        """As :meth:`of`, to be sent to another machine: it has neither listeners nor moments."""
        spent = {claim: self.spent(claim) for claim in claims}
        own = self.of(claims, _unheard)
        return replace(own, noted=_unheard, failed=_unheard, before=spent, _spans={})

    def about(self, problem: VerificationProblem, claims: tuple[Claim, ...]) -> Ledger:
        """An empty ledger of another problem, whose results are not recorded here."""
        return Ledger(
            problem,
            self.bounds,
            self.deadline,
            claims,
            self.seed,
            self.report,
            stopped=self.stopped,
            interrupted=self.interrupted,
            clock=self.clock,
        )

    def extract(self, claims: Iterable[Claim]) -> Extract:
        """The results on claims so far."""
        asked = list(claims)
        verdicts = {claim: self.verdicts[claim] for claim in asked if claim in self.verdicts}
        reaches = {claim: [*self._reaches.get(claim, {}).values()] for claim in asked}
        self._put_down_time()
        spans = {claim: tuple(self._spans.get(claim, ())) for claim in asked}
        failures = dict(self.failures)
        empty = tuple(self.vacuities)
        return Extract(verdicts, reaches, self.stopped, self.interrupted, failures, spans, empty)

    def take(self, extract: Extract) -> None:
        """Merge results found elsewhere about claims that are open here."""
        self.stopped = self.stopped or extract.stopped
        self.interrupted = self.interrupted or extract.interrupted
        self.vacuities += extract.vacuities
        for failure, claims in extract.failures.items():
            self.failures[failure] = self.failures.get(failure, frozenset()) | claims
            self.failed(failure)
        for claim in self.open():
            self._spans.setdefault(claim, []).extend(extract.spans.get(claim, ()))
            if claim in extract.verdicts:
                self.settle({claim: replace(extract.verdicts[claim], claim=claim)})
            for reach in extract.reaches.get(claim, ()):
                self.leave([claim], reach)

    def verdict(self, claim: Claim) -> Verdict:
        """The verdict on a claim, as far as it is known."""
        if claim in self.verdicts:
            return self.verdicts[claim]
        # Of engines that came equally far the last one knows best why nobody went further.
        reaches = list(self._reaches.get(claim, {}).values())[::-1]
        if not reaches:
            reason = self._why(claim, [self.stopped])
            return Verdict(
                claim,
                Outcome.UNKNOWN,
                Engine.NONE,
                self.spent(claim),
                reason=reason,
                obstacles=self._obstacles(claim, []),
            )
        farthest = max(reaches, key=_rounds)
        engine = Engine.NONE if farthest.rounds is None else farthest.engine
        outcome, reason = Outcome.HOLDS, ""
        if not any(not r.reason and _rounds(r) >= self.bounds.rounds for r in reaches):
            outcome = Outcome.UNKNOWN
            reason = self._why(claim, [self.stopped, farthest.reason, *(r.reason for r in reaches)])
        steps = (r.step for r in reaches if r.step is not None)
        return Verdict(
            claim,
            outcome,
            engine,
            self.spent(claim),
            farthest.rounds,
            reason=reason,
            step=next(steps, None),
            obstacles=_found(reaches[::-1])
            if outcome is Outcome.HOLDS
            else self._obstacles(claim, reaches[::-1]),
        )

    def _why(self, claim: Claim, reasons: Sequence[str]) -> str:
        """The reason why a claim is open: the first of some reasons, and each failed engine."""
        failed = [str(failure) for failure, of in self.failures.items() if claim in of]
        first = next(filter(None, reasons), "")
        told = [text for text in failed if text not in first]
        return "; ".join(filter(None, [first, *told])) or "not decided"

    def _obstacles(self, claim: Claim, reaches: Sequence[Reach]) -> tuple[Obstacle, ...]:
        """The obstacles of all engines that worked on a claim; at least one."""
        found = [*_found(reaches)]
        if self.deadline.passed() and not any(isinstance(each, TimeUp) for each in found):
            found.append(TimeUp(Engine.NONE))
        failed = (f for f, of in self.failures.items() if claim in of)
        found += [failed_at(failure) for failure in failed]
        found += self.in_the_way
        if self.interrupted:
            found.append(Interrupted())
        return tuple(dict.fromkeys(found)) or (gave_up(Engine.NONE, self.deadline),)


def _unheard(what: object) -> None:
    """Hear of something, and ignore it."""


def _found(reaches: Iterable[Reach]) -> tuple[Obstacle, ...]:
    return tuple(dict.fromkeys(r.obstacle for r in reaches if r.obstacle is not None))


def _named(claims: Sequence[Claim]) -> str:
    """Name the first two claims, and the number of others."""
    names = ", ".join(claim.name for claim in claims[:2])
    return f"{names} and {len(claims) - 2} more" if len(claims) > 2 else names


def reach_of(verdict: Verdict) -> Reach:
    """The reach that an unknown verdict records."""
    first = next(iter(verdict.obstacles), None)
    return Reach(verdict.engine, verdict.rounds, verdict.reason, verdict.seconds, obstacle=first)


def _rounds(reach: Reach) -> int:
    return -1 if reach.rounds is None else reach.rounds


def _together(spans: Iterable[Interval]) -> float:
    """The total length of intervals; overlaps count once."""
    total, end = 0.0, float("-inf")
    for first, last in sorted(spans):
        total += max(0.0, last - max(first, end))
        end = max(end, last)
    return total
