"""The explicit-state engine: enumerates all configurations where they are few."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from msgspec import Struct

from koord.syntax import core
from koord.syntax.budget import OutOfBudgetError
from koord.verify.claims import Claim
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose, Task, Tools, Worker
from koord.verify.engines.explicit.cost import COMPILED_FROM
from koord.verify.engines.explicit.limits import Limits
from koord.verify.ledger import Ledger, Reach, VerificationProblem
from koord.verify.obstacles import Unreplayed, Values, gave_up
from koord.verify.verdicts import Outcome

if TYPE_CHECKING:
    from koord.syntax.system import System
    from koord.verify.engines.explicit.exhaustive import ClaimSearch, SearchResults

#: With fewer steps of evaluation no machine code is made, as it would have to end once it is there.
_STEPS_TO_COMPILE = 10_000


class ExplicitEngine(Struct, frozen=True):
    """The engine that enumerates reachable configurations, as many states as a task allows.

    Asked to refute, it looks at the first ones, for so many evaluations, and says nothing of what
    holds: others are asked as if nobody had looked. Asked again it goes on where it stopped.
    """

    tools: Tools

    @property
    def name(self) -> str:
        return Engine.SEARCH.value

    def suits(self, ledger: Ledger, task: Task) -> bool:
        if task.purpose is not Purpose.REFUTE:
            return True
        if ledger.problem.is_abstract:
            return False
        from koord.verify.engines.explicit.finiteness import not_finite

        properties = [claim.stated for claim in ledger.open() if claim.stated is not None]
        return not_finite(ledger.system, properties) is None

    def work(self, ledger: Ledger, task: Task) -> None:
        claims = ledger.open()
        if task.purpose is Purpose.REFUTE:
            self._refute(ledger, claims, task)
            return
        if ledger.problem.is_abstract:
            names = _flowing(ledger.problem)
            reason = f"search: {', '.join(names)} may have infinitely many values"
            obstacle = Values(Engine.SEARCH, names)
            ledger.leave(claims, Reach(Engine.SEARCH, None, reason, 0.0, obstacle=obstacle))
            return
        search = self._search(ledger.system, claims, task)
        started, ended = time.monotonic(), False
        few = task.evaluations is not None and task.evaluations < _STEPS_TO_COMPILE
        try:
            self._go_on(search, ledger, task, None if few else COMPILED_FROM)
            ended = True
        finally:
            found = search.said.of(claims)
            _leave(ledger, found, time.monotonic() - started, failed=not ended)

    def _refute(self, ledger: Ledger, claims: Sequence[Claim], task: Task) -> None:
        search = self._search(ledger.system, claims, task)
        with suppress(OutOfBudgetError):  # others find out whether their budget is used up
            # What is looked for soon is found before any machine code could be made.
            self._go_on(search, ledger, task, None)
        found = search.said.of(claims).verdicts
        ledger.settle({c: v for c, v in found.items() if v.outcome is Outcome.VIOLATED})

    def _search(self, system: System, claims: Sequence[Claim], task: Task) -> ClaimSearch:
        """The search for these claims: that which was begun, if there is one."""
        # Seldom needed, and takes a while to load.
        from koord.verify.engines.explicit.exhaustive import ClaimSearch

        found = self.tools.search
        if found is None or not found.has(system, claims):
            found = ClaimSearch(system, tuple(claims))
        found.keep(claims)
        # Where it takes all that there is, nobody asks again.
        self.tools.search = None if task.states is None else found
        return found

    def _go_on(
        self, search: ClaimSearch, ledger: Ledger, task: Task, compiled_from: int | None
    ) -> None:
        search.work(
            ledger.system,
            limits_of(task),
            ledger.deadline,
            ledger.problem.judge,
            ledger.progress,
            compiled_from=compiled_from,
        )


def make(engine: Engine, tools: Tools) -> Worker:
    """Make the engine for a problem."""
    return ExplicitEngine(tools)


def limits_of(task: Task) -> Limits:
    """The limits of a search for a task."""
    return Limits() if task.states is None else Limits(states=task.states)


def _leave(ledger: Ledger, found: SearchResults, seconds: float, *, failed: bool) -> None:
    """Record the results of a search, and its depth for the claims left open."""
    ledger.settle(found.verdicts)
    enough = found.depth is not None and found.depth >= ledger.bounds.rounds
    reason = "" if enough else found.reason
    if failed and reason:
        through = "the start" if found.depth is None else f"round {found.depth}"
        reason = f"search: it came no further than {through}"
    obstacle = None if enough else found.obstacle
    if found.reason and obstacle is None and not enough and not failed:
        obstacle = gave_up(Engine.SEARCH, ledger.deadline)
    reach = Reach(Engine.SEARCH, found.depth, reason, seconds, obstacle=obstacle)
    ledger.leave([c for c in ledger.open() if c not in found.unreplayed], reach)
    for claim, reason in found.unreplayed.items():
        astray = Unreplayed(Engine.SEARCH)
        ledger.leave([claim], Reach(Engine.SEARCH, None, reason, seconds, obstacle=astray))


def _flowing(problem: VerificationProblem) -> tuple[str, ...]:
    """The variables that only pass values along."""
    plain, abstract = problem.original.program, problem.system.program
    pairs: list[tuple[str, core.Declaration, core.Declaration]] = [
        (old.variable.name, old, new)
        for old, new in zip(
            (*plain.allread, *plain.allwrite),
            (*abstract.allread, *abstract.allwrite),
            strict=True,
        )
    ]
    for old_agent, new_agent in zip(plain.agents, abstract.agents, strict=True):
        locals_ = zip(old_agent.locals, new_agent.locals, strict=True)
        pairs += [(old.variable.name, old, new) for old, new in locals_]
        for module in old_agent.modules:
            ports = ((old_agent.ports[k], new_agent.ports[k]) for k in module.ports)
            pairs += [(f"{module.name}.{o.shown}", o.declaration, n.declaration) for o, n in ports]
    named = (name for name, old, new in pairs if old.variable != new.variable)
    return tuple(dict.fromkeys(named)) or ("positions and paths",)
