"""The engine of fair cycles: liveness for all rounds, or a lasso. [T-FAIR-CYCLE]"""

from __future__ import annotations

import time
from collections.abc import Sequence

from msgspec import Struct

from koord.verify.claims import Claim, ClaimPhase
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Task, Tools, Worker
from koord.verify.engines.explicit.engine import limits_of
from koord.verify.engines.explicit.exhaustive import in_the_way
from koord.verify.engines.explicit.fair_answers import FairCycleReport, Fairness
from koord.verify.engines.explicit.fair_search import lively
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, OutOfBounds
from koord.verify.ledger import Ledger, Reach
from koord.verify.obstacles import Obstacle, Unreplayed, gave_up
from koord.verify.verdicts import NotReplayedError, Outcome, Vacuity, Verdict, no_fair_run


class ExplicitLivenessEngine(Struct, frozen=True):
    """The engine that searches all reachable configurations for fair cycles, where they are few."""

    vacuities: list[Vacuity]  #: what is found out besides

    @property
    def name(self) -> str:
        return Engine.SEARCH.value

    def suits(self, ledger: Ledger, task: Task) -> bool:
        return True

    def work(self, ledger: Ledger, task: Task) -> None:
        started = time.monotonic()
        claims = ledger.open()
        limits = limits_of(task)
        found = lively(
            ledger.system,
            [claim.stated for claim in claims if claim.stated is not None],
            Limits(limits.states, limits.memory_mb, limits.rounds, ledger.deadline.at),
            most_edges=task.edges,
            progress=lambda states, rounds: ledger.progress(
                f"search for lassos, round {rounds}, {states} states"
            ),
        )
        seconds = time.monotonic() - started
        unreplayed = _settled(ledger, claims, found, seconds)
        reason = f"search: {_why(found)}"
        for claim in ledger.open():
            why = unreplayed.get(claim, reason)
            obstacle: Obstacle = gave_up(Engine.SEARCH, ledger.deadline)
            if claim in unreplayed:
                obstacle = Unreplayed(Engine.SEARCH)
            elif isinstance(found.end, NotFinite):
                obstacle = in_the_way(found.end)
            ledger.leave([claim], Reach(Engine.SEARCH, None, why, seconds, obstacle=obstacle))
        if found.is_empty:
            self.vacuities.append(no_fair_run(ledger.system))


def make(engine: Engine, tools: Tools) -> Worker:
    """Make the engine for a problem."""
    return ExplicitLivenessEngine(tools.vacuities)


def _settled(
    ledger: Ledger, claims: Sequence[Claim], found: FairCycleReport, seconds: float
) -> dict[Claim, str]:
    """Settle the claims that were decided; return why lassos did not replay, if some did not."""
    unreplayed: dict[Claim, str] = {}
    for claim in claims:
        lasso = found.violated.get(claim.name)
        if lasso is not None:
            try:
                shown = ledger.problem.judge(lasso, claim, ClaimPhase.END)
            except NotReplayedError as error:
                unreplayed[claim] = f"search: a candidate violation did not replay: {error}"
                continue
            verdict = Verdict(claim, Outcome.VIOLATED, Engine.SEARCH, seconds, counterexample=shown)
            ledger.settle({claim: verdict})
        elif claim.name in found.needs:
            under = named(found.needs[claim.name])
            verdict = Verdict(claim, Outcome.HOLDS, Engine.SEARCH, seconds, fairness=under)
            ledger.settle({claim: verdict})
    return unreplayed


def named(fairness: Fairness) -> tuple[str, ...]:
    """The kinds of fairness, and expectations, by name."""
    kinds = (("robots", fairness.robots), ("locks", fairness.locks))
    return (*(name for name, needed in kinds if needed), *fairness.expectations)


def _why(found: FairCycleReport) -> str:
    match found.end:
        case Exhausted():
            return "not decided"
        case OutOfBounds(reason=reason, depth=depth):
            return f"{reason} through round {depth}"
        case NotFinite(reason=reason, span=span):
            return f"{reason} ({span})"
