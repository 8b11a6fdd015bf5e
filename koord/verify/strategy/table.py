"""The table of the strategy: engines, budgets, order and scope. Cheapest first.

The order is data: to add an engine, write its folder, its name in :class:`Engine`, and its rows
here.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import TYPE_CHECKING, Protocol, TypeAlias

from msgspec import Struct

from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose, Task, Workers
from koord.verify.engines.every_n.candidates import FEW
from koord.verify.engines.explicit.limits import FEW_EDGES, FEW_STATES, HANDFUL
from koord.verify.ledger import Ledger

if TYPE_CHECKING:
    from koord.syntax.system import System

#: How many questions IC3 may ask where other engines wait for their turn.
FEW_QUESTIONS = 30_000

#: The same for about a second.
QUESTIONS_OF_A_SECOND = 3_000

#: With more robots engines that look at each of them have no answer in some tenths of a second.
FEW_ROBOTS = 8


class Fleet(Enum):
    """The fleets that a row is for."""

    ANY = "any"
    FEW = "few"  #: up to ``FEW_ROBOTS``
    MANY = "many"  #: more

    def has(self, robots: int) -> bool:
        """Return whether so many robots are such a fleet."""
        return self is Fleet.ANY or (self is Fleet.FEW) == (robots <= FEW_ROBOTS)


class AskEngine(Struct, frozen=True):
    """A row: run an engine on all open claims together."""

    engine: Engine
    task: Task = Task()
    quick: bool = False  #: it seldom takes longer than a process takes to start
    fleet: Fleet = Fleet.ANY  #: of what the system has to be for it
    endless: bool = False  #: only where inputs have infinitely many values, as no search is there
    named: bool = False  #: only where claims are named, and about those alone
    ended: bool = False  #: only where a search of all configurations has come to its end before
    again: bool = False  #: only where it proved the same of a program like this one
    #: values that merely flow are left out for it, and lemmas are given (of whole runs)
    opaque: bool = False

    def suits(self, system: System) -> bool:
        """Return whether the row is for such a system."""
        if not self.fleet.has(system.robots):
            return False
        if not self.endless:
            return True
        from koord.verify.engines.explicit.finiteness import not_finite

        return not_finite(system, ()) is not None


class AskOnSlices(Struct, frozen=True):
    """A row: run engines on single claims, on their slices, where these are smaller.

    ``rows`` are for claims that no invariant about more than their slice can help to prove, and
    ``shared`` for the others. ``alone``: these are all one engine, which has all the time.
    ``ends``: what ``rows`` leave open stays so.
    """

    rows: Rows
    shared: Rows = ()
    alone: bool = False
    ends: bool = True


class AskEachClaim(Struct, frozen=True):
    """A row: bounded model checking claim by claim in processes, with proofs in parallel.

    What the ``beside`` engines say, which are asked in turn, counts first.
    """

    beside: Rows = ()


class Patience(Struct, frozen=True):
    """How long those are waited for who say more, where others have answers.

    They have as much work as all of these did, who were asked at the same time, or so many
    ``times`` that of the last one alone, and so many ``steps`` of evaluation more.
    """

    times: float
    steps: int

    def of(self, others: int, last: int) -> int:
        """The work that is waited for where others did so much, and the last of them some of it."""
        return max(others, int(self.times * last) + self.steps)


class AskAtOnce(Struct, frozen=True):
    """A row: engines at the same time, each on what was known when they were started.

    The answers of ``first`` count first, then those of ``beside``. Who is asked ``first`` says
    more: these are asked in turn, in one process, and waited for with ``patience`` once others have
    answers (None: to the end); what the first of them did at a glance ahead is not counted.
    """

    first: Rows
    beside: Rows
    quick: bool = False  #: it seldom takes longer than a second
    patience: Patience | None = None
    #: the fleets for which those who are asked first are begun before all rows, on another core
    ahead: Fleet | None = None


Row: TypeAlias = "AskEngine | AskOnSlices | AskEachClaim | AskAtOnce"
Rows: TypeAlias = "tuple[Row, ...]"

#: A row about whole runs; those that race are engines.
LivenessRow: TypeAlias = "AskEngine | AskAtOnce"

#: What proofs for every number of robots may cost where others are asked afterwards.
SPARING_S = 3.0

#: With many robots whoever proves it has no rival: to fork processes for others would take as long.
_OF_MANY = Task(seconds=1.0, evaluations=16_000)

#: The same where it had too little of that: what is not inductive is not asked again.
_MORE_OF_MANY = Task(seconds=SPARING_S, evaluations=200_000)

#: What has proved all claims about a program like this one needs some tenths of a second again, and
#: has them before others are asked.
_ONCE_MORE = Task(seconds=0.3, evaluations=40_000)

#: What proofs and lemmas for every number of robots may cost where others have an answer already:
#: some tenths of a second, as they say more. What is settled in less is told before anybody else is
#: asked. With many robots they are the only ones.
_A_LITTLE = Task(seconds=0.08, evaluations=15_000)
_LEMMAS_SOON = Task(Purpose.INFER, seconds=0.05, evaluations=10_000, candidates=FEW)

#: All of that is waited for only as long as it may be seen in the end: `auto` is to take at most so
#: many times what an engine alone takes, and some tenths of a second.
_RULE = Patience(times=1.3, steps=5_500)

#: What takes some seconds: lemmas of some ten questions.
_OF_SOME_SECONDS = 200_000

#: A search that ends in about a second, be it with all configurations or not.
_SHORT_SEARCH = Task(states=FEW_STATES, evaluations=50_000)

#: Circuits that are small, and have an invariant in about a second: what a search of some seconds
#: would find behind them. Those that have one need up to 1,680 questions a frame (`german`):
#: where more are not enough, IC3 makes no progress, and the search behind it is waited for.
_SHORT_CIRCUITS = Task(questions=6_000, frame_questions=2_000, evaluations=4_000)

#: The first rounds, where no search has looked at them.
_SHORT_ROUNDS = Task(seconds=0.2, rounds=4, evaluations=6_000)

#: What is left then. Rounds of many robots take long to write down, which no solver's limit counts.
_MORE_ROUNDS = Task(seconds=0.5, rounds=8)
_MORE_ROUNDS_OF_MANY = Task(seconds=0.5, rounds=8, evaluations=6_000)

#: Bounded model checking, as far as it gets in so many seconds.
_FIRST_ROUNDS = AskEngine(Engine.BMC, Task(seconds=3.0))

#: What is asked about claims that are neither proved nor refuted in no time, and takes some seconds
#: at most. Finitely many configurations are most often few, and looked at in no time.
_SOME_SECONDS: Rows = (
    AskEngine(Engine.SEARCH, Task(states=HANDFUL)),
    AskEngine(Engine.INDUCTION),
    AskEngine(Engine.SEARCH, Task(states=FEW_STATES)),
    AskEngine(Engine.BITS, Task(questions=FEW_QUESTIONS)),
)

#: All that is asked about what is open then. Of what holds, invariants for every number of robots
#: say more than Spacer's, which wait for them.
_TO_THE_END: Rows = (
    _FIRST_ROUNDS,
    AskEachClaim(
        beside=(
            AskEngine(Engine.SPACER, Task(Purpose.HOLD_BACK, seconds=3.0)),
            AskEngine(Engine.EVERY_N, Task(Purpose.INFER, seconds=SPARING_S)),
            AskEngine(Engine.SPACER, Task(Purpose.RELEASE)),
            AskEngine(Engine.ABC, Task(questions=FEW_QUESTIONS, seconds=20.0)),
            AskEngine(Engine.SPACER, Task(Purpose.HOLD_BACK, seconds=7.0)),
            AskEngine(Engine.SPACER, Task(Purpose.RELEASE)),
        )
    ),
)

#: Most violations are in the first configurations, and a proof for every number of robots is one
#: for this number. What neither shows in no time is raced for: first by what is done in some tenths
#: of a second, then by what takes some seconds. Whoever has seen all configurations by then says so
#: before anything else is tried.
_ALL_ENGINES: Rows = (
    AskEngine(Engine.SEARCH, Task(Purpose.REFUTE, states=HANDFUL, evaluations=3_000), quick=True),
    AskEngine(Engine.EVERY_N, _ONCE_MORE, quick=True, fleet=Fleet.FEW, again=True),
    AskEngine(Engine.EVERY_N, _OF_MANY, quick=True, fleet=Fleet.MANY),
    AskAtOnce(
        first=(
            AskEngine(Engine.EVERY_N, _A_LITTLE, fleet=Fleet.FEW),
            AskEngine(Engine.EVERY_N, _MORE_OF_MANY, fleet=Fleet.MANY),
            AskEngine(Engine.EVERY_N, _LEMMAS_SOON),
        ),
        beside=(
            AskEngine(Engine.SEARCH, Task(states=HANDFUL), ended=True),
            AskEngine(Engine.INDUCTION, Task(seconds=0.5, rounds=1)),
            AskEngine(Engine.SEARCH, Task(states=HANDFUL, evaluations=6_000)),
            AskEngine(Engine.BMC, _SHORT_ROUNDS, endless=True),
            AskEngine(Engine.BITS, _SHORT_CIRCUITS, fleet=Fleet.FEW),
            AskEngine(Engine.SEARCH, _SHORT_SEARCH, fleet=Fleet.FEW),
            AskEngine(Engine.BMC, _MORE_ROUNDS, fleet=Fleet.FEW),
            AskEngine(Engine.BMC, _MORE_ROUNDS_OF_MANY, fleet=Fleet.MANY),
        ),
        quick=True,
        patience=_RULE,
        ahead=Fleet.FEW,
    ),
    AskAtOnce(
        first=(
            AskEngine(Engine.EVERY_N, Task(seconds=SPARING_S)),
            AskEngine(Engine.EVERY_N, Task(Purpose.INFER, seconds=1.0, candidates=FEW)),
        ),
        beside=(
            AskEngine(Engine.INDUCTION),
            AskOnSlices(
                (AskEngine(Engine.SEARCH, _SHORT_SEARCH), AskEngine(Engine.INDUCTION)),
                (AskEngine(Engine.SEARCH, _SHORT_SEARCH), AskEngine(Engine.INDUCTION)),
                ends=False,
            ),
            AskEngine(Engine.SEARCH, Task(states=FEW_STATES)),
            AskEngine(Engine.ABC, Task(questions=FEW_QUESTIONS, seconds=3.0)),
            AskEngine(Engine.BITS, Task(questions=FEW_QUESTIONS)),
            AskOnSlices(_SOME_SECONDS, _SOME_SECONDS, ends=False),
        ),
        patience=_RULE,
    ),
    AskOnSlices(_TO_THE_END),
    *_TO_THE_END,
)


def _by_slices_first(*rows: Row, first: Rows = ()) -> Rows:
    """Rows that run one engine on slices and then on the whole; ``first`` is the slices' task."""
    return (AskOnSlices((*first, *rows), alone=True), *rows)


def _on_bits(engine: Engine) -> Rows:
    few = Task(questions=FEW_QUESTIONS)
    # Alone, claims often make a much smaller circuit, and need no lemmas.
    of_named = AskEngine(engine, few, named=True)
    return _by_slices_first(of_named, AskEngine(engine), first=(AskEngine(engine, few),))


#: A quick step, which is not asked again of every slice where it proves all claims together.
_QUICK_STEP = AskEngine(Engine.INDUCTION, Task(seconds=0.1, rounds=1), quick=True)

#: Whom a choice of an engine asks about configurations, in turn; None: all engines.
SAFETY: Mapping[Engine | None, Rows] = {
    None: _ALL_ENGINES,
    Engine.EVERY_N: (
        AskEngine(Engine.EVERY_N, quick=True),
        AskEngine(Engine.EVERY_N, Task(Purpose.INFER)),
    ),
    Engine.INDUCTION: (
        _QUICK_STEP,
        AskOnSlices((_QUICK_STEP, AskEngine(Engine.INDUCTION)), alone=True),
        AskEngine(Engine.INDUCTION),
    ),
    Engine.SEARCH: _by_slices_first(
        AskEngine(Engine.SEARCH), first=(AskEngine(Engine.SEARCH, Task(states=FEW_STATES)),)
    ),
    Engine.BITS: _on_bits(Engine.BITS),
    Engine.ABC: _on_bits(Engine.ABC),
    Engine.SPACER: _by_slices_first(AskEngine(Engine.SPACER)),
    Engine.BMC: _by_slices_first(_FIRST_ROUNDS, AskEachClaim()),
}

#: What is asked without lemmas before they are given.
FIRST_LASSOS = Task(rounds=4)

_BITS_OF_RUNS = AskEngine(Engine.BITS, opaque=True)

#: The same about whole runs: the other engines know nothing of them. A proof for every number of
#: robots is one for this number; what it may cost is known, unlike what a search may. Lemmas for it
#: are looked for beside a search and circuits: for some seconds they are waited for, as they say
#: more and with the same patience, and then only where nobody else has an answer.
#: What circuits take for what never comes back to itself has no end in sight.
LIVENESS: Mapping[Engine | None, tuple[LivenessRow, ...]] = {
    None: (
        AskEngine(Engine.EVERY_N, Task(seconds=0.2, evaluations=30_000), opaque=True),
        AskEngine(Engine.SEARCH, Task(states=HANDFUL, edges=FEW_EDGES, evaluations=12_500)),
        AskAtOnce(
            first=(
                AskEngine(
                    Engine.EVERY_N,
                    Task(Purpose.INFER, seconds=SPARING_S, evaluations=_OF_SOME_SECONDS),
                    opaque=True,
                ),
            ),
            beside=(
                AskEngine(Engine.SEARCH, Task(states=FEW_STATES, edges=FEW_EDGES)),
                AskEngine(
                    Engine.BITS, Task(rounds=4, questions=QUESTIONS_OF_A_SECOND), opaque=True
                ),
            ),
            patience=_RULE,
        ),
        AskEngine(Engine.EVERY_N, Task(Purpose.INFER, seconds=SPARING_S), opaque=True),
        AskEngine(Engine.BITS, Task(questions=FEW_QUESTIONS), opaque=True),
    ),
    Engine.EVERY_N: (
        AskEngine(Engine.EVERY_N, Task(seconds=SPARING_S), opaque=True),
        AskEngine(Engine.EVERY_N, Task(Purpose.INFER), opaque=True),
    ),
    Engine.SEARCH: (AskEngine(Engine.SEARCH),),
    Engine.BITS: (_BITS_OF_RUNS,),
    Engine.ABC: (_BITS_OF_RUNS,),
}

#: Who proves once more what an engine proved, with fewer premises.
PROVING_AGAIN: Mapping[Engine, AskEngine] = {
    Engine.EVERY_N: AskEngine(Engine.EVERY_N, Task(seconds=SPARING_S)),
    Engine.INDUCTION: AskEngine(Engine.INDUCTION),
    Engine.SEARCH: AskEngine(Engine.SEARCH),
    Engine.BITS: AskEngine(Engine.BITS),
}

#: The same where invariants were found for every number of robots.
INFERRING_AGAIN = AskEngine(Engine.EVERY_N, Task(Purpose.INFER, seconds=SPARING_S))


class AnyTurn(Protocol):
    """A turn of the strategy: it settles open claims of a ledger, or records how far it got."""

    @property
    def name(self) -> str:
        """The turn's name in reports of failures."""

    def work(self, ledger: Ledger) -> None: ...


class EngineTurn(Struct, frozen=True):
    """A turn of one engine on a task; the engine is loaded when its turn comes."""

    engine: Engine
    task: Task
    workers: Workers
    quick: bool = False

    @property
    def name(self) -> str:
        return self.engine.value

    def work(self, ledger: Ledger) -> None:
        worker = self.workers.of(self.engine)
        if worker.suits(ledger, self.task):
            with ledger.rationing(self.task.evaluations):
                worker.work(ledger, self.task)
