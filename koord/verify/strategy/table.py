"""The table of the strategy: engines, budgets, order and scope. Cheapest first.

The order is data: to add an engine, write its folder, its name in :class:`Engine`, and its rows
here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, TypeAlias

from msgspec import Struct

from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose, Task, Workers
from koord.verify.engines.every_n.candidates import FEW
from koord.verify.engines.explicit.limits import FEW_EDGES, FEW_STATES, HANDFUL
from koord.verify.ledger import Ledger


class AskEngine(Struct, frozen=True):
    """A row: run an engine on all open claims together."""

    engine: Engine
    task: Task = Task()
    quick: bool = False  #: it seldom takes longer than a process takes to start
    named: bool = False  #: only where claims are named, and about those alone
    #: values that merely flow are left out for it, and lemmas are given (of whole runs)
    opaque: bool = False


class AskOnSlices(Struct, frozen=True):
    """A row: run engines on single claims, on their slices, where these are smaller.

    ``rows`` are for claims that no invariant about more than their slice can help to prove, and
    ``shared`` for the others. ``alone``: these are all one engine, which has all the time.
    """

    rows: Rows
    shared: Rows = ()
    alone: bool = False


class AskEachClaim(Struct, frozen=True):
    """A row: bounded model checking claim by claim in processes, with proofs in parallel.

    What the ``beside`` engines say, which are asked in turn, counts first.
    """

    beside: Rows = ()


Row: TypeAlias = "AskEngine | AskOnSlices | AskEachClaim"
Rows: TypeAlias = "tuple[Row, ...]"

#: How many questions IC3 may ask where other engines wait for their turn.
FEW_QUESTIONS = 30_000

#: What proofs for every number of robots may cost where others are asked afterwards.
SPARING_S = 3.0

#: Bounded model checking, as far as it gets in so many seconds.
_FIRST_ROUNDS = AskEngine(Engine.BMC, Task(seconds=3.0))

#: What is asked about claims that are neither proved nor refuted in no time, and takes some seconds
#: at most. Finitely many configurations are most often few, and looked at in no time.
_SOME_SECONDS: Rows = (
    AskEngine(Engine.SEARCH, Task(states=HANDFUL)),
    AskEngine(Engine.INDUCTION),
    AskEngine(Engine.SEARCH, Task(states=FEW_STATES)),
    AskEngine(Engine.BITS, Task(questions=FEW_QUESTIONS)),
    _FIRST_ROUNDS,
)

#: All that is asked about them. Of what holds, invariants for every number of robots say more than
#: Spacer's, which wait for them.
_THOROUGH: Rows = (
    *_SOME_SECONDS,
    AskEachClaim(
        beside=(
            AskEngine(Engine.SPACER, Task(Purpose.HOLD_BACK, seconds=3.0)),
            AskEngine(Engine.EVERY_N, Task(Purpose.INFER, seconds=SPARING_S)),
            AskEngine(Engine.SPACER, Task(Purpose.RELEASE)),
            AskEngine(Engine.SPACER, Task(Purpose.HOLD_BACK, seconds=7.0)),
            AskEngine(Engine.SPACER, Task(Purpose.RELEASE)),
        )
    ),
)

#: Most violations are in the first configurations, and a proof for every number of robots is one
#: for this number. What is violated is told before invariants are looked for that cannot be found.
_ALL_ENGINES: Rows = (
    AskEngine(Engine.SEARCH, Task(Purpose.REFUTE, states=HANDFUL, evaluations=3_000), quick=True),
    AskEngine(Engine.EVERY_N, Task(seconds=SPARING_S), quick=True),
    AskEngine(Engine.INDUCTION, Task(rounds=1), quick=True),
    AskEngine(Engine.SEARCH, Task(Purpose.REFUTE, states=HANDFUL, evaluations=30_000), quick=True),
    AskEngine(Engine.BMC, Task(seconds=0.5, rounds=1)),
    AskEngine(Engine.EVERY_N, Task(Purpose.INFER, seconds=1.0, candidates=FEW)),
    AskOnSlices(_THOROUGH, _SOME_SECONDS),
    *_THOROUGH,
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
#: robots is one for this number; what it may cost is known, unlike what a search may.
LIVENESS: Mapping[Engine | None, tuple[AskEngine, ...]] = {
    None: (
        AskEngine(Engine.EVERY_N, Task(seconds=0.2), opaque=True),
        AskEngine(Engine.SEARCH, Task(states=FEW_STATES, edges=FEW_EDGES)),
        AskEngine(Engine.BITS, Task(questions=FEW_QUESTIONS), opaque=True),
    ),
    Engine.EVERY_N: (AskEngine(Engine.EVERY_N, opaque=True),),
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
            worker.work(ledger, self.task)
