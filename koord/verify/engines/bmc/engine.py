"""Bounded model checking as an engine, and the enumeration of further counterexamples.

Runs are looked for without some event of each run found so far. The same events later, in one round
or in several, or by other robots of the kind, are no other way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice, permutations, product

from msgspec import Struct

from koord.semantics.domain import conjunction
from koord.semantics.recordings import Recording
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.system import System
from koord.verify.bounded_check import Unroller
from koord.verify.claims import Claim, ClaimPhase
from koord.verify.effort import Effort
from koord.verify.encoding.moments import SymbolicConfiguration, SymbolicRound
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.encoding.terms import Term
from koord.verify.encoding.unrolling import Unrolling, violations
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Task, Tools, Worker
from koord.verify.ledger import Ledger
from koord.verify.verdicts import Counterexample, EnumerationResult, NotReplayedError
from koord.verify.witness import ModelReader, recording_of

#: What may be spent on the search for other ways, when one is known: about so many seconds.
_SECONDS = 60.0

#: So many ways to name the robots of a run anew are taken into account.
_MOST_NAMINGS = 120

#: For robots of a run, who is to do in its place what it does.
Naming = dict[int, int]


def others(
    ledger: Ledger, claim: Claim, first: Counterexample, most: int
) -> tuple[tuple[Counterexample, ...], EnumerationResult]:
    """Further counterexamples, none a variant of ``first`` or of another, the shortest first.

    Each leaves out some event that the others all need: robots that run more besides, other values
    and other orders make no difference. There are ``most`` of them, or the ways say why not.
    """
    found: list[Counterexample] = []
    try:
        for one in _others(ledger, claim, first):
            found.append(one)
            if len(found) == most:
                return tuple(found), EnumerationResult(complete=False)
    except _OpenError as error:
        return tuple(found), EnumerationResult(complete=False, reason=str(error))
    except OutOfBudgetError:
        return tuple(found), EnumerationResult(complete=False, reason=_LATE)
    return tuple(found), EnumerationResult(complete=True)


class _OpenError(Exception):
    """Raised with the reason why further counterexamples may exist."""


_LATE = "the time was up"


def _others(ledger: Ledger, claim: Claim, first: Counterexample) -> Iterator[Counterexample]:
    """Yield all of them within the bound. Raises _OpenError, and OutOfBudgetError."""
    unrolling = Unrolling(ledger.system, ledger.seed)
    solver, effort = unrolling.solver, Effort.of_seconds(_SECONDS)
    known, open_ = [first.recording], list[str]()
    groups = _namesakes(ledger.system)
    for moment in unrolling.moments():
        asked = violations(ledger.system, unrolling.encoder.d, moment, [claim])
        for violated, needed in asked.values():
            solver.add(needed)
            while True:
                different = [_different(unrolling, run, groups) for run in known]
                question = [violated, *different]
                answer = solver.check(question, ledger.deadline, effort)
                if answer is SolverAnswer.UNSAT:
                    break
                if answer is SolverAnswer.UNKNOWN:
                    open_.append("the solver gave up")
                    break
                found = _read(ledger, claim, unrolling, moment)
                if found is None:
                    open_.append("one that the solver suggests did not replay")
                    break
                run = found.recording
                # One has all that the other needs: as where there are too many robots to try
                # everybody in everybody's place, or an event of the other was in vain.
                kinds, events = ledger.system.kinds, ran(run)
                same = any(
                    is_variant(kinds, events, other) or is_variant(kinds, other, events)
                    for other in map(ran, known)
                )
                known.append(run)
                if not same:
                    yield found
            # A run that went on from here would be a longer way to what was found.
            solver.add([unrolling.encoder.d.unary(UnaryOp.NOT, violated)])
        is_end = moment.phase in (ClaimPhase.INIT, ClaimPhase.END)
        if is_end and moment.configuration.round >= ledger.bounds.rounds:
            break
        if ledger.deadline.passed() or effort.left <= 0:
            raise _OpenError(_LATE)
    if open_ or unrolling.unknowns.limits:
        raise _OpenError((open_ or unrolling.unknowns.uncovered)[0])


def _read(
    ledger: Ledger, claim: Claim, unrolling: Unrolling, moment: SymbolicConfiguration
) -> Counterexample | None:
    reader = ModelReader(unrolling.solver.model(), ledger.system)
    recording = recording_of(reader, unrolling.opening, unrolling.rounds, moment.phase)
    try:
        return ledger.problem.judge(recording, claim, moment.phase)
    except NotReplayedError:
        return None


def _namesakes(system: System) -> tuple[tuple[int, ...], ...]:
    """Groups of robots that run the same events: those of a kind."""
    kinds = dict.fromkeys(system.kinds)
    return tuple(tuple(i for i, k in enumerate(system.kinds) if k == kind) for kind in kinds)


def _different(unrolling: Unrolling, recording: Recording, groups: Sequence[Sequence[int]]) -> Term:
    """The constraint that a run lacks some event of a recorded one, however robots are named."""
    d = unrolling.encoder.d
    same = [_contained(unrolling, recording, naming) for naming in _namings(recording, groups)]
    return conjunction(d, [d.unary(UnaryOp.NOT, each) for each in same])


def _namings(recording: Recording, groups: Sequence[Sequence[int]]) -> Iterator[Naming]:
    """Yield the mappings between robots of a kind that run something, the identity first."""
    active = ran(recording).keys()
    placed = []
    for group in groups:
        who = [i for i in group if i in active]
        rest = [i for i in group if i not in active]
        placed.append(
            [dict(zip(who, to, strict=True)) for to in permutations(who + rest, len(who))]
        )
    for parts in islice(product(*placed), _MOST_NAMINGS):
        yield {i: to for part in parts for i, to in part.items()}


def _contained(unrolling: Unrolling, recording: Recording, naming: Naming) -> Term:
    """The condition that each robot runs what its namesake runs in a recorded run, in order.

    When it does so is up to it: whether robots run in one round or wait for each other makes no
    other way.
    """
    d = unrolling.encoder.d
    ended = []
    for robot, wanted in ran(recording).items():
        # By how many of its events were met by now.
        met: list[Term] = [True, *(False for _ in wanted)]
        for taken in unrolling.rounds:
            for n in range(len(wanted), 0, -1):
                runs = _runs(taken, naming[robot], wanted[n - 1])
                now = d.binary(BinaryOp.AND, met[n - 1], runs)
                met[n] = d.binary(BinaryOp.OR, met[n], now)
        ended.append(met[-1])
    return conjunction(d, ended)


def ran(recording: Recording) -> dict[int, list[int]]:
    """The events that each robot runs, in order; robots that run nothing are left out."""
    found: dict[int, list[int]] = {}
    for round_ in recording.rounds:
        for robot, event in enumerate(round_.events):
            if event is not None:
                found.setdefault(robot, []).append(event)
    return found


def is_variant(
    kinds: Sequence[int], having: Mapping[int, Sequence[int]], wanted: Mapping[int, Sequence[int]]
) -> bool:
    """Return whether a run has every event of another, up to renaming of robots and times.

    Of both runs there are the events of each robot, in order.
    """
    standing: dict[int, int] = {}  #: who of the one run stands for whom of the other

    def placed(robot: int, tried: set[int]) -> bool:
        for i, events in having.items():
            if i in tried or kinds[i] != kinds[robot]:
                continue
            if _within(wanted[robot], events):
                tried.add(i)
                if i not in standing or placed(standing[i], tried):
                    standing[i] = robot
                    return True
        return False

    return all(placed(robot, set()) for robot in wanted)


def _within(wanted: Sequence[int], having: Sequence[int]) -> bool:
    """Return whether a sequence is a subsequence of another."""
    left = iter(having)
    return all(event in left for event in wanted)


def _runs(taken: SymbolicRound, robot: int, event: int) -> Term:
    """The condition that a robot runs an event in a round."""
    chosen = [o.chosen for o in taken.options if o.robot == robot and o.position == event]
    return chosen[0] if chosen else False


class BmcEngine(Struct, frozen=True):
    """The engine that unrolls round after round and searches each for violations."""

    unroller: Unroller

    @property
    def name(self) -> str:
        return Engine.BMC.value

    def suits(self, ledger: Ledger, task: Task) -> bool:
        return bool(ledger.wanting())

    def work(self, ledger: Ledger, task: Task) -> None:
        rounds = ledger.bounds.rounds
        rounds = rounds if task.rounds is None else min(rounds, task.rounds)
        effort = None if task.seconds is None else Effort.of_seconds(task.seconds)
        self.unroller.through(ledger, rounds, effort)


def make(engine: Engine, tools: Tools) -> Worker:
    """Make the engine for a problem."""
    return BmcEngine(tools.unroller)
