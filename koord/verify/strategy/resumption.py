"""Resumption: a verification continues after the step that killed its process."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

from msgspec import Struct, field
from msgspec.structs import replace

from koord.syntax.budget import OutOfBudgetError
from koord.verify.engine_names import Engine, engine_named
from koord.verify.ledger import Ledger, Reach, reach_of
from koord.verify.obstacles import Failure, TimeUp
from koord.verify.verdicts import NOTHING_KNOWN, Outcome, ReachingRun, Substance, Verdict


class StrategyStep(Struct, frozen=True):
    """A step of the strategy: an engine's turn. No two steps of a verification are equal."""

    stage: str
    turn: int
    who: str


class PastVerification(Struct, frozen=True):
    """The state of a verification whose process died, from which the next one continues.

    ``begun`` are the steps that are not taken again, be they done or not. ``reaching`` are runs
    that once reached what should be possible, perhaps of another program. ``likely`` are verdicts
    on the same claims about another one, by which engines are asked in another order: nothing of
    them is taken to be true. ``keeps_runs``: somebody keeps further runs that reach it.
    """

    verdicts: tuple[Verdict, ...] = ()
    begun: tuple[StrategyStep, ...] = ()
    failures: tuple[Failure, ...] = ()
    reaching: tuple[ReachingRun, ...] = ()
    substance: Substance = NOTHING_KNOWN
    likely: tuple[Verdict, ...] = ()
    keeps_runs: bool = False

    def was_for_every_n(self, names: Collection[str]) -> bool:
        """Return whether claims hold for every number of robots, here or where they are likely."""
        found = {v.claim.name: v for v in (*self.likely, *self.verdicts)}
        of_all = {n for n, v in found.items() if v.outcome is Outcome.HOLDS and _is_of_all(v)}
        return of_all.issuperset(names)

    def speaks_for_every_n(self, names: Collection[str]) -> bool:
        """Return whether those of some claims that anything was found of do; others are new."""
        found = {v.claim.name for v in (*self.likely, *self.verdicts)} & set(names)
        return bool(found) and self.was_for_every_n(found)

    def told(self, noted: Iterable[object]) -> PastVerification:
        """The state with the messages of a further process added."""
        verdicts = {v.claim: v for v in self.verdicts}
        begun, failures = list(self.begun), list(self.failures)
        for value in noted:
            match value:
                case Verdict():
                    before = verdicts.get(value.claim)
                    if before is None or before.outcome is Outcome.UNKNOWN:
                        verdicts[value.claim] = value
                case StrategyStep():
                    begun.append(value)
                case Failure():
                    failures.append(value)
                case _:
                    raise AssertionError(value)
        return replace(
            self,
            verdicts=tuple(verdicts.values()),
            begun=tuple(begun),
            failures=tuple(dict.fromkeys(failures)),
        )

    def ended(self, what: str) -> PastVerification:
        """The state if the last step ended its process."""
        return replace(self, failures=(*self.failures, Failure(self.who, what)))

    @property
    def who(self) -> str:
        """The engine of the last turn."""
        return self.begun[-1].who if self.begun else "koord"

    def verdict(self, name: str) -> Verdict | None:
        """The last known verdict on a claim, or None."""
        return next((v for v in self.verdicts if v.claim.name == name), None)


def _is_of_all(verdict: Verdict) -> bool:
    """Return whether a proof is for every number of robots, and none but claims helped it."""
    return verdict.engine is Engine.EVERY_N and not verdict.lemmas


#: Who is asked while others wait behind it has this part of the time that is left.
SHARE = 0.5


class Steps(Struct):
    """The steps of a verification; each is taken once, even if its process does not survive.

    Whoever looks on is told with ``lasting`` when a step is over, be it that it does not end.
    """

    past: PastVerification = field(default_factory=PastVerification)
    noted: Callable[[object], None] = lambda value: None
    lasting: Callable[[float | None], None] = lambda until: None

    def is_open(self, stage: str, turn: int, who: str) -> bool:
        """Return whether a step is still to be taken."""
        return StrategyStep(stage, turn, who) not in self.past.begun

    def begin(self, stage: str, turn: int, who: str) -> bool:
        """Return whether a step is to be taken; if so, announce it."""
        if not self.is_open(stage, turn, who):
            return False
        self.noted(StrategyStep(stage, turn, who))
        return True

    def take(
        self,
        stage: str,
        turn: int,
        who: str,
        work: Callable[[Ledger], None],
        ledger: Ledger,
        *,
        is_last: bool = False,
    ) -> None:
        """Run an engine unless its step was taken; it has a share of the time if others wait."""
        if not self.begin(stage, turn, who):
            return
        late = False
        with ledger.deadline.sharing(1.0 if is_last else SHARE) as ended:
            self.lasting(None if is_last else ended)
            try:
                with ledger.enduring(who):
                    work(ledger)
            except OutOfBudgetError:
                late = True
        self.lasting(None)
        if late and ledger.deadline.passed():
            raise OutOfBudgetError
        if late:
            engine = engine_named(who)
            over = Reach(engine, None, "timeout", 0.0, obstacle=TimeUp(engine))
            ledger.leave(ledger.open(), over)

    def follow(self, ledger: Ledger, original: Callable[[Verdict], Verdict] | None = None) -> None:
        """Record the known results, and follow those to come.

        ``original`` is for verdicts on a problem with opaque values.
        """
        for claim in ledger.open():
            verdict = self.past.verdict(claim.name)
            if verdict is None:
                continue
            ledger.before = {**ledger.before, claim: verdict.seconds}
            if verdict.outcome is Outcome.UNKNOWN:
                ledger.leave([claim], reach_of(verdict))
            else:
                ledger.settle({claim: replace(verdict, claim=claim)})
        for failure in self.past.failures:
            ledger.fail(failure)
        ledger.noted = self.noted if original is None else lambda v: self.noted(original(v))
        ledger.failed = self.noted
