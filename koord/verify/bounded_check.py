"""Bounded model checking: rounds unrolled one by one on one incremental solver.

What was shown of a round is required of it from then on, so each round is asked about what is new.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from msgspec import Struct, field

from koord.semantics.domain import disjunction
from koord.semantics.every_number import NotFiniteError
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.core import UnaryOp
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimPhase
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.cubes import Cube
from koord.verify.encoding.moments import SymbolicConfiguration
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.encoding.unrolling import Unrolling, violations
from koord.verify.engine_names import Engine
from koord.verify.ledger import Judge, Ledger, Reach
from koord.verify.obstacles import Beyond, Elsewhere, GaveUp, Lengths, Obstacle, Unreplayed, gave_up
from koord.verify.verdicts import Counterexample, NotReplayedError, Outcome, Verdict, has_fewest

#: What other claims may cost where one is violated, so that nobody waits long to see it.
AFTERWARDS_S = 10.0


class BoundedCheck:
    """The bounded check of one system, resumable from where it stopped.

    ``completed`` is the last round through which all claims that are still open hold (None: not
    even INIT is known to satisfy them), and ``covered`` the last one through which they do for
    lists and maps of any length. ``unreplayed`` are claims with a candidate violation that is no
    run, each with the reason and with what was completed before it. ``tired``: the last check
    ended because its effort was used up, and can be gone on with. ``beyond`` is what formulas
    cannot say of the next round, if there is something: then that is the end.

    With a ``cube`` all this is of its runs alone. Through ``known`` rounds the claims hold, which
    is not asked again.
    """

    def __init__(
        self,
        system: System,
        judge: Judge,
        seed: int = 0,
        cube: Cube | None = None,
        known: int | None = None,
    ) -> None:
        self._unrolling = Unrolling(system, seed, cube=cube)
        self._known = -1 if known is None else known
        self._judge = judge
        self._started = time.monotonic()
        self._moments = self._unrolling.moments()
        self._moment: SymbolicConfiguration | None = None
        self.unreplayed: dict[Claim, tuple[str, int | None]] = {}
        self.completed: int | None = None
        self.covered: int | None = None
        self.reason = ""
        self.beyond = ""
        self.tired = False

    def check(
        self,
        claims: Sequence[Claim],
        proved: Sequence[Claim],
        rounds: int,
        deadline: Deadline,
        effort: Effort | None = None,
    ) -> dict[Claim, Verdict]:
        """Find the claims that are violated within ``rounds`` rounds, each in its first one.

        ``proved`` are taken for granted. Claims that are not in the answer hold through round
        ``completed``; that is less than ``rounds`` if the deadline passed or the solver gave up,
        and then ``reason`` says so, or if it is ``tired``. Those in ``unreplayed`` are exceptions.
        """
        self.tired = False
        pending = [claim for claim in claims if claim not in self.unreplayed]
        verdicts: dict[Claim, Verdict] = {}
        while pending and not self.reason and not self.tired:
            if self.completed is not None and self.completed >= rounds:
                break
            try:
                moment = self._moment = self._moment or next(self._moments)
                self._take_for_granted(moment, [c for c in proved if c.is_state_property])
                if len(self._unrolling.rounds) <= self._known:
                    self._take_for_granted(moment, pending)
                    found = dict[Claim, tuple[Counterexample, float]]()
                    unreplayed = dict[Claim, str]()
                else:
                    found, unreplayed, self.reason = _look(
                        self._unrolling,
                        moment,
                        pending,
                        deadline,
                        effort,
                        self._started,
                        self._judge,
                    )
            except OutOfBudgetError:
                self.reason = "timeout"
                break
            for claim, (shown, seconds) in found.items():
                verdicts[claim] = Verdict(
                    claim,
                    Outcome.VIOLATED,
                    Engine.BMC,
                    seconds,
                    counterexample=shown,
                    fewest=has_fewest(shown, self.covered),
                )
            self.unreplayed |= {c: (why, self.completed) for c, why in unreplayed.items()}
            pending = [c for c in pending if c not in verdicts and c not in self.unreplayed]
            self.tired = bool(self.reason) and effort is not None and effort.left <= 0
            if self.tired:
                self.reason = ""  # the moment is looked at again
                break
            self._moment = None
            if not self.reason and moment.phase in (ClaimPhase.INIT, ClaimPhase.END):
                self.completed = moment.configuration.round
                if not self._unrolling.unknowns.limits:
                    self.covered = self.completed
        return verdicts

    @property
    def seconds(self) -> float:
        """The seconds since the check began."""
        return time.monotonic() - self._started

    @property
    def limits(self) -> list[str]:
        """Descriptions of the values that the unrolling does not cover."""
        return self._unrolling.unknowns.uncovered

    def _take_for_granted(self, moment: SymbolicConfiguration, claims: Sequence[Claim]) -> None:
        d, solver = self._unrolling.encoder.d, self._unrolling.solver
        for violated, needed in violations(self._unrolling.system, d, moment, claims).values():
            solver.add([*needed, d.unary(UnaryOp.NOT, violated)])


def _look(
    unrolling: Unrolling,
    moment: SymbolicConfiguration,
    claims: Sequence[Claim],
    deadline: Deadline,
    effort: Effort | None,
    started: float,
    judge: Judge,
) -> tuple[dict[Claim, tuple[Counterexample, float]], dict[Claim, str], str]:
    """Find the claims that a configuration can break.

    Three things are returned: the claims, each with a run and the seconds that it took to find;
    those with only a candidate that did not replay, with the reason; and why the search was cut
    short, if it was.
    """
    from koord.verify.witness import ModelReader, recording_of

    d, solver = unrolling.encoder.d, unrolling.solver
    asked = violations(unrolling.system, d, moment, claims)
    for _, needed in asked.values():
        solver.add(needed)
    found: dict[Claim, tuple[Counterexample, float]] = {}
    unreplayed: dict[Claim, str] = {}
    pending = {claim: violated for claim, (violated, _) in asked.items()}
    while pending:
        answer = solver.check([disjunction(d, list(pending.values()))], deadline, effort)
        if answer is SolverAnswer.UNKNOWN:
            why = "timeout" if deadline.is_near() else "the solver gave up"
            return found, unreplayed, why
        if answer is SolverAnswer.UNSAT:
            break
        model = solver.model()
        broken_here = [claim for claim, violated in pending.items() if model.truth(violated)]
        # A fault ends the run, so a run that breaks another claim is preferred to show it.
        claim = broken_here[0]
        reader = ModelReader(model, unrolling.system)
        recording = recording_of(reader, unrolling.opening, unrolling.rounds, moment.phase)
        try:
            counterexample = judge(recording, claim, moment.phase)
        except NotReplayedError as error:
            unreplayed[claim] = f"a candidate violation did not replay: {error}"
            del pending[claim]
            continue
        found[claim] = (counterexample, time.monotonic() - started)
        del pending[claim]
    never = [d.unary(UnaryOp.NOT, violated) for violated in pending.values()]
    solver.add(never)
    return found, unreplayed, ""


class Unroller(Struct):
    """The bounded model checking engine, resumable from where it stopped."""

    bounded: BoundedCheck | None = None
    cube: Cube | None = None  #: only its runs are looked at
    known: int | None = None  #: the rounds through which all claims hold
    relying: bool = True  #: takes for granted what is proved
    late: bool = False  #: it was stopped by the clock, and not by what there is to be done
    afterwards: Effort = field(default_factory=lambda: Effort.of_seconds(AFTERWARDS_S))

    @property
    def name(self) -> str:
        return Engine.BMC.value

    def work(self, ledger: Ledger) -> None:
        if ledger.wanting():
            self.through(ledger, ledger.bounds.rounds)

    def of(self, ledger: Ledger) -> BoundedCheck:
        if self.late and not ledger.deadline.is_near():  # there is time again
            self.bounded, self.late = None, False
        if self.bounded is None:
            self.bounded = BoundedCheck(
                ledger.system, ledger.problem.judge, ledger.seed, self.cube, self.known
            )
        return self.bounded

    @property
    def suspected(self) -> int | None:
        """The last round with a candidate violation that did not replay; None without one."""
        completed = self.bounded.unreplayed.values() if self.bounded is not None else ()
        return max((0 if last is None else last + 1 for _, last in completed), default=None)

    def through(self, ledger: Ledger, rounds: int, effort: Effort | None = None) -> None:
        """Settle the claims that are violated within so many rounds, as far as the effort goes."""
        bounded = self.of(ledger)
        try:
            self._through(bounded, ledger, rounds, effort)
        except NotFiniteError as error:
            bounded.beyond = str(error)
        except (KoordError, OutOfBudgetError):
            raise
        except Exception:
            self.bounded = None  # it may be half done: nobody relies on it any more
            raise
        finally:
            self.late = bool(bounded.reason) and ledger.deadline.is_near()
            self._leave(bounded, ledger)

    def _through(
        self, bounded: BoundedCheck, ledger: Ledger, rounds: int, effort: Effort | None
    ) -> None:
        while not (bounded.reason or bounded.beyond) and (claims := self._pending(bounded, ledger)):
            number = 0 if bounded.completed is None else bounded.completed + 1
            if number > rounds:
                return
            ledger.progress(f"bmc, round {number} of {ledger.bounds.rounds}")
            most = effort or (self.afterwards if ledger.is_violated else None)
            proved = ledger.proved() if self.relying else []
            ledger.settle(bounded.check(claims, proved, number, ledger.deadline, most))
            self._leave(bounded, ledger)  # known from now on, however this ends
            if bounded.tired:
                return

    def _pending(self, bounded: BoundedCheck, ledger: Ledger) -> list[Claim]:
        return [claim for claim in ledger.open() if claim not in bounded.unreplayed]

    def _leave(self, bounded: BoundedCheck, ledger: Ledger) -> None:
        reason = bounded.reason
        obstacle: Obstacle | None = None
        if bounded.tired:
            reason = "another claim is violated, and this one takes long"
            obstacle = Elsewhere(Engine.BMC) if ledger.is_violated else GaveUp(Engine.BMC)
        elif bounded.beyond:
            reason, obstacle = bounded.beyond, Beyond(Engine.BMC, bounded.beyond)
        elif reason:
            obstacle = gave_up(Engine.BMC, ledger.deadline)
        if not reason and bounded.limits:
            reason = f"not covered: {'; '.join(bounded.limits)}"
            obstacle = Lengths(Engine.BMC, tuple(bounded.limits))
        reach = Reach(Engine.BMC, bounded.covered, reason, bounded.seconds, obstacle=obstacle)
        ledger.leave(self._pending(bounded, ledger), reach)
        for claim, (why, rounds) in bounded.unreplayed.items():
            through = bounded.covered if bounded.limits else rounds
            astray = Unreplayed(Engine.BMC)
            ledger.leave([claim], Reach(Engine.BMC, through, why, bounded.seconds, obstacle=astray))
