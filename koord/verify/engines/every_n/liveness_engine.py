"""The engine of progress: liveness for every number of robots. [T-PROGRESS]"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cache

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimKind
from koord.verify.effort import Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose, Task, Tools, Worker
from koord.verify.engines.every_n.progress import ProgressProof, progress
from koord.verify.engines.every_n.progress_parts import HelpKind, lemmas_of
from koord.verify.engines.every_n.proving import prove
from koord.verify.engines.every_n.questions import GENEROUS, SPARING, Means
from koord.verify.ledger import Ledger, Reach
from koord.verify.obstacles import gave_up
from koord.verify.verdicts import Outcome, Verdict


class ProgressEngine(Struct, frozen=True):
    """The engine that proves claims about whole runs for every number of robots.

    It finds no violations. What it is given as lemmas holds in every round, of every number.
    """

    @property
    def name(self) -> str:
        return Engine.EVERY_N.value

    def suits(self, ledger: Ledger, task: Task) -> bool:
        return True

    def work(self, ledger: Ledger, task: Task) -> None:
        thrift = GENEROUS if task.seconds is None else replace(SPARING, seconds=task.seconds)
        system = ledger.system
        known: Sequence[Claim] | None = None

        @cache
        def more() -> Sequence[Claim]:
            own = Means(ledger.deadline, Effort.of_seconds(thrift.seconds), thrift, ledger.seed)
            return _holding(system, task.likely, task.lemmas, own)

        for claim in ledger.open():
            started = time.monotonic()
            ledger.progress("every N, measures that settle and help that is not refused")
            means = Means(ledger.deadline, Effort.of_seconds(thrift.seconds), thrift, ledger.seed)
            if known is None:
                known = [*task.lemmas, *_lemmas(ledger, task.lemmas, means)]
            assert claim.stated is not None
            infer = task.purpose is Purpose.INFER
            # Where no lemmas are looked for, others are asked who seldom take as long as a proof.
            given = more if infer else tuple
            found = progress(system, claim.stated, known, means, more=given, infer=infer)
            seconds = time.monotonic() - started
            if isinstance(found, ProgressProof):
                under = fairness_of(system.program, found)
                verdict = Verdict(
                    claim,
                    Outcome.HOLDS,
                    Engine.EVERY_N,
                    seconds,
                    fairness=under,
                    lemmas=tuple(replace(x, name="") for x in found.lemmas),
                )
                ledger.settle({claim: verdict})
            else:
                obstacle = gave_up(Engine.EVERY_N, ledger.deadline)
                reach = Reach(Engine.EVERY_N, None, found, seconds, obstacle=obstacle)
                ledger.leave([claim], reach)


def make(engine: Engine, tools: Tools) -> Worker:
    """Make the engine for a problem."""
    return ProgressEngine()


def _lemmas(ledger: Ledger, known: Sequence[Claim], means: Means) -> list[Claim]:
    """The likely lemmas that hold of every number of robots, beside those that are known."""
    likely = [
        Claim(f"lemma {k}", ClaimKind.PROPERTY, stated)
        for k, stated in enumerate(lemmas_of(ledger.system.program))
    ]
    return _holding(ledger.system, likely, known, means)


def _holding(
    system: System, likely: Sequence[Claim], known: Sequence[Claim], means: Means
) -> list[Claim]:
    """Those of some statements that are proved of every number of robots, here and now."""
    if not likely:
        return []
    budget = means.deadline, means.effort, means.thrift, means.seed
    shown = prove(system, likely, *budget, known=known)
    return [claim for claim in likely if claim in shown.proved]


#: Help that does not rest on fairness to robots.
_NOT_OF_ROBOTS = (HelpKind.EXPECTED, HelpKind.TIME)


def fairness_of(program: core.Program, proof: ProgressProof) -> tuple[str, ...]:
    """The kinds of fairness, and expectations, that a proof rests on, by name."""
    robots = any(each.kind not in _NOT_OF_ROBOTS for each in proof.help)
    positions = sorted({each.expectation for each in proof.help if each.expectation is not None})
    names = (program.expectations[k].name for k in positions)
    kinds = (("robots", robots), ("locks", bool(proof.locks)))
    return (*(name for name, needed in kinds if needed), *names)
