"""The engines on the words of Z3 and on explicit states, as workers on a ledger."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.every_number import NotFiniteError
from koord.syntax import core
from koord.syntax.budget import OutOfPatienceError
from koord.verify.bounded_check import AFTERWARDS_S, ByUnrolling
from koord.verify.claims import Claim
from koord.verify.effort import Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.explicit.limits import HANDFUL, Limits
from koord.verify.engines.induction.engine import prove
from koord.verify.ledger import Ledger, Reach, Subject
from koord.verify.obstacles import (
    Beyond,
    NotInductive,
    Obstacle,
    Unreplayed,
    Values,
    gave_up,
)
from koord.verify.verdicts import BrokenStep, Outcome

if TYPE_CHECKING:
    from koord.verify.engines.explicit.engine import Searching

#: How many rounds an inductive step may span.
MAX_DEPTH = 3

#: What inductive attempts may cost before other engines get their turn: about so many seconds.
PROOF_S = 30.0

#: What a look at the first configurations may cost, in what evaluation counts: about 0.1 s.
FIRST_LOOK = 3_000

#: The same where claims are not proved in no time: about a second.
SECOND_LOOK = 30_000

#: What one of all claims together may cost before single ones are asked of less of the program.
HASTY_S = 0.1

#: What a look at the rounds may cost before claims are tried to be proved from further off.
GLANCE_S = 3.0

#: The same where nothing longer was tried yet, with the rounds that it is about.
FIRST_GLANCE_S, FIRST_ROUNDS = 0.5, 1


#: What a proof for all rounds may cost where all claims were seen to hold as far as was asked.
ANSWERED_S = 5.0


class ByGlance(Struct):
    """The rounds that bounded model checking gets through quickly: most violations are there.

    There are ``most`` of them, if that is said.
    """

    unrolling: ByUnrolling
    effort: Effort = field(default_factory=lambda: Effort.of_seconds(GLANCE_S))
    most: int | None = None

    @property
    def name(self) -> str:
        return Engine.BMC.value

    def work(self, ledger: Ledger) -> None:
        if ledger.wanting():
            rounds = ledger.bounds.rounds
            rounds = rounds if self.most is None else min(rounds, self.most)
            self.unrolling.through(ledger, rounds, self.effort)


class ByInduction(Struct):
    """Inductive proofs over one round, then two, …: for every number of rounds.

    A step of k rounds proves what holds in the first k - 1 rounds too, which is unrolled for it.
    """

    unrolling: ByUnrolling
    effort: Effort = field(default_factory=lambda: Effort.of_seconds(PROOF_S))
    afterwards: Effort = field(default_factory=lambda: Effort.of_seconds(AFTERWARDS_S))
    answered: Effort = field(default_factory=lambda: Effort.of_seconds(ANSWERED_S))
    _done: int = 0
    _shortest: dict[Claim, BrokenStep] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return Engine.INDUCTION.value

    def work(self, ledger: Ledger) -> None:
        self.over(MAX_DEPTH, ledger)

    def over(self, rounds: int, ledger: Ledger) -> None:
        """Go on from where it stopped, up to steps of so many rounds."""
        started = time.monotonic()
        while self._done < rounds:
            if self._done > 0 and (ledger.deadline.passed() or self._effort(ledger).left <= 0):
                return
            self._done = depth = self._done + 1
            self.unrolling.through(ledger, depth - 1, self._effort(ledger))
            bounded = self.unrolling.of(ledger)
            # What is not known to hold in those rounds is neither to be proved nor to be assumed.
            claims = [c for c in ledger.open() if c not in bounded.unreplayed]
            if not claims or bounded.completed is None or bounded.completed < depth - 1:
                return
            ledger.progress(f"induction over {depth} round{'s' if depth > 1 else ''}")
            try:
                result = prove(
                    ledger.system,
                    claims,
                    ledger.proved(),
                    ledger.deadline,
                    self._effort(ledger),
                    depth=depth,
                    seed=ledger.seed,
                )
            except NotFiniteError as error:
                self._done = MAX_DEPTH  # longer steps have the same rounds in them
                seconds, why = time.monotonic() - started, str(error)
                beyond = Beyond(Engine.INDUCTION, why)
                ledger.leave(claims, Reach(Engine.INDUCTION, None, why, seconds, obstacle=beyond))
                return
            ledger.settle(result.proved)
            for claim, reason in result.reasons.items():
                seconds = time.monotonic() - started
                if claim in result.steps:
                    self._shortest.setdefault(claim, result.steps[claim])
                step = self._shortest.get(claim)
                obstacle: Obstacle = gave_up(Engine.INDUCTION, ledger.deadline)
                if claim in result.steps:
                    obstacle = NotInductive(Engine.INDUCTION)
                ledger.leave(
                    [claim], Reach(Engine.INDUCTION, None, reason, seconds, step, obstacle)
                )

    def hastily(self, ledger: Ledger) -> None:
        """Try one round, with little effort; if that is not enough, it is tried again later."""
        patient, self.effort = self.effort, Effort.of_seconds(HASTY_S)
        self.over(1, ledger)
        self._done = 0 if self.effort.left <= 0 else self._done
        self.effort = patient

    def _effort(self, ledger: Ledger) -> Effort:
        if not ledger.wanting():
            return self.answered
        return self.afterwards if ledger.is_violated else self.effort


class ByStep(Struct, frozen=True):
    """Inductive proofs over one round, which cost little; the others may follow."""

    induction: ByInduction
    hasty: bool = False  #: what takes longer is left for later

    @property
    def name(self) -> str:
        return Engine.INDUCTION.value

    def work(self, ledger: Ledger) -> None:
        if self.hasty:
            self.induction.hastily(ledger)
        else:
            self.induction.over(1, ledger)


class BySearch(Struct, frozen=True):
    """All configurations one by one, where they are few."""

    limits: Limits

    @property
    def name(self) -> str:
        return Engine.SEARCH.value

    def work(self, ledger: Ledger) -> None:
        # Seldom needed, and takes a while to load.
        from koord.verify.engines.explicit.engine import Searching, exhaust

        claims = ledger.open()
        if ledger.subject.is_abstract:
            names = _flowing(ledger.subject)
            reason = f"search: {', '.join(names)} may have infinitely many values"
            obstacle = Values(Engine.SEARCH, names)
            ledger.leave(claims, Reach(Engine.SEARCH, None, reason, 0.0, obstacle=obstacle))
            return
        found = Searching()
        started = time.monotonic()
        judge = ledger.subject.judge
        try:
            exhaust(
                ledger.system, claims, self.limits, ledger.deadline, judge, ledger.progress, found
            )
        except BaseException:
            self._leave(ledger, found, time.monotonic() - started, failed=True)
            raise
        self._leave(ledger, found, time.monotonic() - started, failed=False)

    def _leave(self, ledger: Ledger, found: Searching, seconds: float, *, failed: bool) -> None:
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


class ByShallowSearch(Struct, frozen=True):
    """What is violated in the first configurations, and no more: most that is violated is there.

    It says nothing of what holds, so that others are asked as if nobody had looked. ``steps`` is
    what it may cost, in what evaluation counts.
    """

    steps: int

    @property
    def name(self) -> str:
        return Engine.SEARCH.value

    def work(self, ledger: Ledger) -> None:
        if ledger.subject.is_abstract:
            return
        from koord.verify.engines.explicit.finiteness import not_finite

        claims = ledger.open()
        properties = [claim.stated for claim in claims if claim.stated is not None]
        if not_finite(ledger.system, properties) is not None:
            return
        from koord.verify.engines.explicit.engine import Searching, exhaust

        patience = ledger.system.patience.rationed(self.steps)
        system, judge = replace(ledger.system, patience=patience), ledger.subject.judge
        found = Searching()
        limits = Limits(states=HANDFUL)
        with suppress(OutOfPatienceError):  # whoever has no patience for others finds that out
            exhaust(system, claims, limits, ledger.deadline, judge, ledger.progress, found)
        ledger.settle({c: v for c, v in found.verdicts.items() if v.outcome is Outcome.VIOLATED})


def _flowing(subject: Subject) -> tuple[str, ...]:
    """The variables whose values merely flow."""
    plain, abstract = subject.original.program, subject.system.program
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
