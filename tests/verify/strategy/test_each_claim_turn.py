"""Claims in processes of their own: what is said of them does not hang on how many there are."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest
from msgspec.structs import replace

from koord.syntax.system import System, dealt
from koord.verify import each_claim, processes
from koord.verify.claims import Claim, claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.bits import liveness_engine
from koord.verify.engines.bmc.engine import BmcEngine
from koord.verify.engines.engine import Task
from koord.verify.ledger import Ledger, Reach, VerificationProblem
from koord.verify.processes import Pool, can_fork
from koord.verify.strategy import each_claim_turn, race, verification
from koord.verify.strategy.each_claim_turn import EachClaimTurn
from koord.verify.strategy.table import AnyTurn
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict
from tests.loading import program_of
from tests.sampling import first

pytestmark = pytest.mark.skipif(not can_fork(), reason="one process only")

TEXT = """
local:
    int steps = 0
allwrite:
    int sum = 0
Step:
    pre: steps < 3
    eff:
        atomic:
            steps = steps + 1
            sum = sum + 1
Rest:
    pre: steps >= 3
    eff: stop
Never:
    pre: steps > 3
    eff: stop
invariant Within: forall i: steps@i <= 3
invariant Few: sum < 4
invariant Uneven: forall i, j: steps@i <= steps@j + 1
invariant Rare: sum == 9 implies steps@0 == 4
eventually Done: forall i: steps@i == 3
eventually Half: sum >= 3
"""


@pytest.fixture
def system() -> System:
    return dealt(program_of(TEXT), 2)


def timeless(report: Report) -> Report:
    verdicts = tuple(replace(verdict, seconds=0.0) for verdict in report.verdicts)
    return replace(report, verdicts=verdicts, seconds=0.0)


def asked(system: System, choice: Engine | None, jobs: int, **more: int) -> Report:
    return timeless(verify(system, Bounds(5, **more), choice, jobs=jobs))


def look_at_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """All claims together are looked at for one round at most before single ones are."""
    work = BmcEngine.work

    def little(self: BmcEngine, ledger: Ledger, task: Task) -> None:
        work(self, ledger, task if task.rounds is not None else replace(task, seconds=0.0))

    monkeypatch.setattr(BmcEngine, "work", little)


@pytest.mark.parametrize("choice", first(1, [Engine.BMC, None, Engine.BITS]))
@pytest.mark.parametrize("jobs", first(1, [2, 4]))
def test_reports_are_equal_whatever_the_number_of_processes(
    system: System, choice: Engine | None, jobs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is settled together, so that all is asked claim by claim."""
    look_at_little(monkeypatch)
    one = asked(system, choice, 1, violations=2)
    assert one == asked(system, choice, jobs, violations=2)
    outcomes = {verdict.claim.name: verdict.outcome for verdict in one.verdicts}
    assert outcomes["Few"] is outcomes["Uneven"] is Outcome.VIOLATED
    assert outcomes["Within"] is Outcome.HOLDS
    assert {v.subject for v in one.vacuities} >= {"Never"}


def test_what_was_not_enough_is_followed_by_more(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Slices in which nothing can be done are as if they were not there."""
    whole = asked(system, Engine.BMC, 1)
    look_at_little(monkeypatch)
    nothing = (each_claim_turn._Slice(0, False), each_claim_turn._Slice(0, True))
    monkeypatch.setattr(each_claim_turn, "SLICES", nothing)
    told = asked(system, Engine.BMC, 2)
    violated = {v.claim.name for v in told.verdicts if v.outcome is Outcome.VIOLATED}
    assert violated == {v.claim.name for v in whole.verdicts if v.outcome is Outcome.VIOLATED}
    assert [v.rounds for v in told.verdicts] == [v.rounds for v in whole.verdicts]


@pytest.mark.parametrize("choice", first(1, [Engine.BMC, None, Engine.BITS]))
def test_where_nothing_can_be_forked_all_is_done_in_turn(
    system: System, choice: Engine | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    forked = asked(system, choice, 2, violations=2)
    for module in (processes, each_claim, each_claim_turn, race, verification):
        monkeypatch.setattr(module, "can_fork", lambda: False)
    monkeypatch.setattr("os.fork", lambda: pytest.fail("it forks"))
    in_turn = asked(system, choice, 2, violations=2)
    assert [(v.claim.name, v.outcome, v.rounds, v.engine) for v in in_turn.verdicts] == [
        (v.claim.name, v.outcome, v.rounds, v.engine) for v in forked.verdicts
    ]
    assert in_turn.vacuities == forked.vacuities


@pytest.mark.parametrize("quick", first(1, [True, False]))
@pytest.mark.slow
def test_with_lemmas_and_without_at_the_same_time_is_one_after_the_other(
    system: System, quick: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not quick:
        monkeypatch.setattr(liveness_engine, "QUICKLY", ())
    told = [
        timeless(verify(system, Bounds(8), Engine.BITS, names=["Within", "Done"], jobs=jobs))
        for jobs in (1, 2)
    ]
    assert told[0] == told[1]
    assert [v.outcome for v in told[0].verdicts] == [Outcome.HOLDS, Outcome.HOLDS]


# --- with an engine whose answers are known -------------------------------------------------------


@dataclass
class Looks:
    """In place of bounded model checking: what it says of each claim, by name.

    ``violated``, ``tired`` (for a while), ``dies``; of others, how much was proved before.
    """

    says: dict[str, str]
    tired: bool = False
    unreplayed: dict[Claim, tuple[str, int | None]] = field(default_factory=dict)

    def through(self, ledger: Ledger, rounds: int, effort: Effort | None = None) -> None:
        (claim,) = ledger.open()
        said = self.says.get(claim.name, "")
        if said == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        if said == "violated":
            ledger.settle({claim: Verdict(claim, Outcome.VIOLATED, Engine.BMC, 0.0)})
        if said == "astray":
            self.unreplayed[claim] = ("no run", 1)
        self.tired = said == "tired" and effort is not None
        reason = "tired" if self.tired else "looked at"
        ledger.leave([claim], Reach(Engine.BMC, len(ledger.proved()), reason, 0.0))

    def of(self, ledger: Ledger) -> Looks:
        return self


@dataclass
class Proves:
    """An engine that proves one claim."""

    name: str

    def work(self, ledger: Ledger) -> None:
        for claim in ledger.open():
            if claim.name == self.name:
                ledger.settle({claim: Verdict(claim, Outcome.HOLDS, Engine.SPACER, 0.0)})


def looked(
    system: System, says: dict[str, str], jobs: int, proofs: Sequence[AnyTurn] = ()
) -> tuple[Ledger, Looks]:
    subject = VerificationProblem(system, lambda *given: pytest.fail("nothing to replay"), system)
    ledger = Ledger(subject, Bounds(8), Deadline.after(None), claims_of(system))
    looks = Looks(says)
    with Pool(jobs) as of:
        EachClaimTurn(looks, of, proofs).work(ledger)  # type: ignore[arg-type]
    return ledger, looks


def told(ledger: Ledger) -> dict[str, tuple[Outcome, int | None, str]]:
    verdicts = {claim.name: ledger.verdict(claim) for claim in ledger.claims}
    return {name: (v.outcome, v.rounds, v.reason) for name, v in verdicts.items()}


UNKNOWN = Outcome.UNKNOWN


@pytest.mark.parametrize("jobs", [1, 3])
def test_what_is_proved_meanwhile_counts_first_and_helps(system: System, jobs: int) -> None:
    """Rounds that were looked at without it are looked at again."""
    ledger, _ = looked(system, {"Few": "violated"}, jobs, [Proves("Few")])
    assert told(ledger) == {
        "Within": (UNKNOWN, 1, "looked at"),
        "Few": (Outcome.HOLDS, None, ""),
        "Uneven": (UNKNOWN, 1, "looked at"),
        "Rare": (UNKNOWN, 1, "looked at"),
        "no fault": (UNKNOWN, 1, "looked at"),
    }


@pytest.mark.parametrize("jobs", [1, 3])
def test_where_one_is_violated_nobody_waits_for_the_others(system: System, jobs: int) -> None:
    with_it, _ = looked(system, {"Within": "tired", "Few": "violated"}, jobs)
    assert told(with_it)["Within"] == (UNKNOWN, 0, "tired")
    # Asked afresh, it is asked of the engine itself.
    without, _ = looked(system, {"Within": "tired"}, jobs)
    assert told(without)["Within"] == (Outcome.HOLDS, 8, "")


def test_a_process_that_dies_takes_one_claim_with_it(system: System) -> None:
    ledger, _ = looked(system, {"Within": "dies"}, 2)
    failed = "bmc failed: its process was ended by SIGKILL, as for want of memory"
    assert told(ledger)["Within"] == (UNKNOWN, None, failed)
    assert told(ledger)["Few"] == (UNKNOWN, 0, "looked at")


def test_candidates_that_are_no_runs_are_known_to_whoever_asks_again(system: System) -> None:
    _, looks = looked(system, {"Few": "astray"}, 2)
    assert [claim.name for claim in looks.unreplayed] == ["Few"]
