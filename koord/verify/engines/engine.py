"""The interface of engines: workers that settle the open claims of a ledger.

An engine is a folder here with an ``engine.py`` in it, which has a function ``make``; its name is a
member of :class:`Engine`, and the table of the strategy says when it is asked. What it claims of
whole runs, if it can, is in its ``liveness_engine.py``.
"""

from __future__ import annotations

from enum import Enum
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct, field

from koord.verify.bounded_check import Unroller
from koord.verify.claims import Claim
from koord.verify.engine_names import Engine
from koord.verify.ledger import Ledger
from koord.verify.processes import Pool
from koord.verify.verdicts import Vacuity

if TYPE_CHECKING:
    from koord.verify.engines.explicit.exhaustive import ClaimSearch


class Purpose(Enum):
    """The purpose for which an engine is called."""

    SETTLE = "settle"  #: proofs and violations
    REFUTE = "refute"  #: violations; it says nothing of what holds
    INFER = "infer"  #: proofs with invariants that nobody gave
    HOLD_BACK = "hold back"  #: as SETTLE, but its proofs wait, as others may say more
    RELEASE = "release"  #: the proofs that it held back


class Task(Struct, frozen=True):
    """A task for an engine: its purpose and its budgets (None: unlimited).

    Each engine counts some of these: the comments say which.
    """

    purpose: Purpose = Purpose.SETTLE
    #: about so many of a solver's work: every_n, induction, horn, bmc, abc
    seconds: float | None = None
    rounds: int | None = (
        None  #: of an inductive step, unrolled, or of a lasso: induction, bmc, bits
    )
    states: int | None = None  #: explicit
    edges: int | None = None  #: from one state to another: explicit, of whole runs
    evaluations: int | None = None  #: in the units of a program's budget: all
    questions: int | None = None  #: to a SAT solver; only what promises to be quick: bits
    frame_questions: int | None = None  #: the same until IC3 has another frame: bits
    candidates: int | None = None  #: likely invariants, the simplest ones: every_n
    named: frozenset[str] = frozenset()  #: only these claims; none: all that are open
    lemmas: tuple[Claim, ...] = ()  #: that hold in every round: bits, of whole runs
    #: invariants that were found of other slices; to be proved before they count: every_n, of whole
    #: runs
    likely: tuple[Claim, ...] = ()


class Tools(Struct):
    """Resources that the engines of one problem share."""

    pool: Pool  #: where claims are asked each by itself
    unroller: Unroller = field(default_factory=Unroller)  #: what is known of the first rounds
    vacuities: list[Vacuity] = field(default_factory=list)  #: what is found out besides
    search: ClaimSearch | None = None  #: of all configurations, which goes on where it stopped


class Worker(Protocol):
    """An engine at work on one problem, resumable from where it stopped."""

    @property
    def name(self) -> str:
        """The engine's name in reports of failures."""

    def suits(self, ledger: Ledger, task: Task) -> bool:
        """Return whether the engine is able to do a task: its dependencies are there."""

    def work(self, ledger: Ledger, task: Task) -> None:
        """Settle open claims, or record how far they were checked."""


#: What else an engine loads when it begins to work.
_AT_WORK = {
    Engine.SEARCH: ("koord.verify.engines.explicit.exhaustive", "koord.verify.witness"),
}


def load(engine: Engine, *, of_runs: bool = False) -> None:
    """Load an engine with what it begins to work with, if it is asked about configurations."""
    _module(engine, of_runs=of_runs)
    if not of_runs:
        for name in _AT_WORK.get(engine, ()):
            import_module(name)


def _module(engine: Engine, *, of_runs: bool) -> ModuleType:
    file = "liveness_engine" if of_runs else "engine"
    return import_module(f"koord.verify.engines.{engine.folder}.{file}")


class Workers:
    """The engines of one problem, each loaded on first use."""

    def __init__(self, pool: Pool, *, of_runs: bool = False) -> None:
        self.tools = Tools(pool)
        self.of_runs = of_runs  #: whether they are asked about whole runs
        self._loaded: dict[Engine, Worker] = {}

    def of(self, engine: Engine) -> Worker:
        """The engine of a name."""
        if engine not in self._loaded:
            module = _module(engine, of_runs=self.of_runs)
            worker: Worker = module.make(engine, self.tools)
            self._loaded[engine] = worker
        return self._loaded[engine]
