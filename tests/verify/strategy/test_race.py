"""Races: what is said hangs neither on who is first, nor on how many processes there are."""

from __future__ import annotations

import os
import signal
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Never, NoReturn

import pytest
from msgspec.structs import replace

from koord.syntax.system import System, dealt
from koord.verify import job_process, processes
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.bits import abc
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.ic3 import SafetyQuery
from koord.verify.job_process import JobChannel
from koord.verify.ledger import Ledger, Reach, VerificationProblem
from koord.verify.obstacles import Failure
from koord.verify.processes import Pool, can_fork
from koord.verify.strategy import race, table, verification
from koord.verify.strategy.race import _HEAD_START, Ahead, RaceTurn, Runner
from koord.verify.strategy.resumption import PastVerification, Steps, StrategyStep
from koord.verify.strategy.table import (
    SAFETY,
    AskAtOnce,
    AskEngine,
    EngineTurn,
    Fleet,
    Patience,
)
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict
from tests.children import forked_children
from tests.loading import program_of, protocol_text
from tests.sampling import first

pytestmark = pytest.mark.skipif(not can_fork(), reason="one process only")

#: With whom the lock is holds of every number of robots with a lemma, and of these without.
LOCK = """
allwrite:
    int owner = -1
local:
    bool inside = false
    int steps = 0
Enter:
    pre: owner == -1
    eff:
        atomic:
            owner = pid
            inside = true
Leave:
    pre: inside
    eff:
        owner = -1
        inside = false
        steps = (steps + 1) % 3
invariant Alone: forall i, j: i != j implies not (inside@i and inside@j)
invariant Few: forall i: 0 <= steps@i and steps@i < 3
invariant Never: forall i: steps@i < 2
"""


@pytest.fixture
def system() -> System:
    return dealt(program_of(LOCK), 2)


def timeless(report: Report) -> Report:
    verdicts = tuple(replace(verdict, seconds=0.0) for verdict in report.verdicts)
    return replace(report, verdicts=verdicts, seconds=0.0)


class Turn:
    """A turn whose work is given."""

    def __init__(self, name: str, work: Callable[[Ledger], None]) -> None:
        self.name = name
        self.work = work


def proving(names: Sequence[str], engine: Engine) -> Callable[[Ledger], None]:
    def work(ledger: Ledger) -> None:
        for claim in ledger.open():
            if claim.name in names:
                ledger.settle({claim: Verdict(claim, Outcome.HOLDS, engine, 0.0)})

    return work


def raced(
    system: System,
    first: Sequence[Callable[[Ledger], None]],
    beside: Sequence[Callable[[Ledger], None]],
    jobs: int = 2,
    steps: Steps | None = None,
    patience: Patience | None = None,
    meanwhile: Callable[[], None] = lambda: None,
    before: Callable[[Ledger], None] | None = None,
    heard: bool = False,
    progress: Callable[[str], None] = lambda text: None,
    apart: bool = False,
) -> Ledger:
    """Race for all claims; if something is done ``before``, who counts first is begun ahead.

    That is in this process, as where there may be another one, or ``apart``.
    ``heard``: these are done, and all that they told is known, when the race begins.
    """
    subject = VerificationProblem(system, lambda *given: pytest.fail("nothing to replay"), system)
    ledger = Ledger(subject, Bounds(8), Deadline.after(None), claims_of(system))
    runners = [
        Runner(n, f"runner {n}", lambda steps, n=n, w=work: Turn(f"runner {n}", w))  # type: ignore[misc]
        for n, work in enumerate([*first, *beside])
    ]
    left = len(first)
    with Pool(jobs, progress) as pool:
        ahead = None
        if before is not None:
            here = jobs > 1 and not apart
            ahead = Ahead.begun(runners[:left], ledger, pool, here=here)
            before(ledger)
            if heard:
                pool.answer(ahead.job)
        turn = RaceTurn(
            runners[:left],
            runners[left:],
            pool,
            steps or Steps(),
            "stage",
            lambda ledger: bool(ledger.open()),
            patience=patience,
            meanwhile=meanwhile,
            ahead=ahead,
        )
        with ledger.stopping():
            turn.work(ledger)
        pool.reap()
        assert forked_children() == set()  # of the race, before the pool ends what is left
    return ledger


def engines(ledger: Ledger) -> dict[str, Engine]:
    return {claim.name: ledger.verdict(claim).engine for claim in ledger.claims}


EVERYTHING = ("Alone", "Few", "Never", "no fault")


def race_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nothing be settled at a glance, so that there is a race for all that is asked."""
    work = EngineTurn.work

    def late(self: EngineTurn, ledger: Ledger) -> None:
        if not self.quick:
            work(self, ledger)

    monkeypatch.setattr(EngineTurn, "work", late)


@pytest.mark.parametrize("jobs", first(1, [2, 3]))
def test_reports_are_equal_whatever_the_number_of_processes(
    system: System, jobs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    race_for_all(monkeypatch)
    one = timeless(verify(system, Bounds(5), jobs=1))
    assert one == timeless(verify(system, Bounds(5), jobs=jobs))
    outcomes = {verdict.claim.name: verdict.outcome for verdict in one.verdicts}
    assert outcomes["Alone"] is outcomes["Few"] is Outcome.HOLDS
    assert outcomes["Never"] is Outcome.VIOLATED


def test_who_counts_first_is_waited_for(system: System, tmp_path: Path) -> None:
    """The first one ends behind the other, which is done."""
    gate = tmp_path / "gate"
    os.mkfifo(gate)

    def slow(ledger: Ledger) -> None:
        gate.read_bytes()
        proving(EVERYTHING, Engine.EVERY_N)(ledger)

    def quick(ledger: Ledger) -> None:
        proving(EVERYTHING, Engine.SEARCH)(ledger)
        gate.write_bytes(b"")

    found = engines(raced(system, [slow], [quick]))
    assert set(found.values()) == {Engine.EVERY_N}


@pytest.mark.parametrize("jobs", [1, 2, 4])
def test_what_one_leaves_open_is_for_the_next(system: System, jobs: int) -> None:
    found = engines(
        raced(
            system,
            [proving(["Alone"], Engine.EVERY_N)],
            [proving(["Alone", "Few"], Engine.SEARCH), proving(EVERYTHING, Engine.BITS)],
            jobs,
        )
    )
    assert found == {
        "Alone": Engine.EVERY_N,
        "Few": Engine.SEARCH,
        "Never": Engine.BITS,
        "no fault": Engine.BITS,
    }


@pytest.mark.parametrize("jobs", [1, 2])
def test_nobody_knows_what_the_others_found(system: System, jobs: int) -> None:
    """Or it would matter who was first."""

    def telling(ledger: Ledger) -> None:
        count = len(ledger.proved())
        ledger.leave(ledger.open(), Reach(Engine.BMC, count, f"{count} are known", 0.0))

    ledger = raced(system, [proving(["Alone"], Engine.EVERY_N)], [telling], jobs)
    few = next(claim for claim in ledger.claims if claim.name == "Few")
    assert ledger.verdict(few).reason == "0 are known"


@pytest.mark.parametrize("jobs", [2, 3])
def test_losers_are_ended_at_once(system: System, jobs: int, tmp_path: Path) -> None:
    """The loser would hang for ever, and `raced` sees to it that no process is left."""
    gate = tmp_path / "gate"
    os.mkfifo(gate)

    def waiting(ledger: Ledger) -> None:
        gate.read_bytes()
        proving(EVERYTHING, Engine.EVERY_N)(ledger)

    def hanging(ledger: Ledger) -> None:
        gate.write_bytes(b"")
        signal.pause()

    found = engines(raced(system, [waiting], [hanging], jobs))
    assert set(found.values()) == {Engine.EVERY_N}


@pytest.mark.parametrize("jobs", [1, 2])
def test_who_dies_costs_its_own_answer(system: System, jobs: int) -> None:
    def dying(ledger: Ledger) -> None:
        proving(["Alone"], Engine.EVERY_N)(ledger)
        os.kill(os.getpid(), signal.SIGKILL)

    ledger = raced(system, [dying], [proving(EVERYTHING, Engine.SEARCH)], jobs)
    # What it told of before counts.
    assert engines(ledger)["Alone"] is Engine.EVERY_N
    assert engines(ledger)["Few"] is Engine.SEARCH
    why = "its process was ended by SIGKILL, as for want of memory"
    assert list(ledger.failures) == [Failure("runner 0", why)]


@pytest.mark.parametrize("jobs", [1, 2])
def test_on_ctrl_c_what_is_known_counts(system: System, jobs: int) -> None:
    def interrupted(ledger: Ledger) -> None:
        proving(["Alone"], Engine.EVERY_N)(ledger)
        raise KeyboardInterrupt

    def hanging(ledger: Ledger) -> None:
        signal.pause()

    ledger = raced(system, [interrupted], [hanging], jobs)
    assert ledger.interrupted
    assert engines(ledger)["Alone"] is Engine.EVERY_N
    assert not ledger.failures


def test_what_was_asked_in_a_process_that_died_is_not_asked_again(system: System) -> None:
    past = PastVerification(begun=(StrategyStep("stage", 0, "runner 0"),))
    begun: list[object] = []
    steps = Steps(past, begun.append)
    all_ = proving(EVERYTHING, Engine.EVERY_N), proving(EVERYTHING, Engine.SEARCH)
    found = engines(raced(system, all_[:1], all_[1:], steps=steps))
    assert set(found.values()) == {Engine.SEARCH}
    assert begun == [StrategyStep("stage", 1, "runner 1")]


# --- patience -------------------------------------------------------------------------------------

#: Who says more has twice the work of others, and some more.
TWICE = Patience(2.0, 1_000)


def working(*parts: tuple[int, Sequence[str]], engine: Engine) -> Callable[[Ledger], None]:
    """Do so much work before each of some parts of the claims is proved."""

    def work(ledger: Ledger) -> None:
        for steps, names in parts:
            ledger.system.budget.report(steps)
            proving(names, engine)(ledger)

    return work


@pytest.mark.parametrize("jobs", [1, 2, 3])
@pytest.mark.parametrize(
    ("steps", "waited"), [(6_000, True), (6_001, False), (1_000_000, False)], ids=str
)
def test_who_says_more_has_so_much_more_work(
    system: System, steps: int, waited: bool, jobs: int
) -> None:
    """The last of two who have an answer together did 2,500 steps; others are not asked."""
    found = raced(
        system,
        [working((steps, EVERYTHING), engine=Engine.EVERY_N)],
        [
            working((1_000, ["Alone", "Few"]), engine=Engine.INDUCTION),
            working((2_500, EVERYTHING), engine=Engine.SEARCH),
            working((9_000, EVERYTHING), engine=Engine.BITS),
        ],
        jobs,
        patience=TWICE,
    )
    others = {**dict.fromkeys(EVERYTHING, Engine.SEARCH)} | dict.fromkeys(
        ("Alone", "Few"), Engine.INDUCTION
    )
    assert engines(found) == (dict.fromkeys(EVERYTHING, Engine.EVERY_N) if waited else others)


@pytest.mark.parametrize("jobs", [1, 2])
def test_who_says_more_has_the_work_of_all_others(system: System, jobs: int) -> None:
    """They were asked at the same time."""
    found = raced(
        system,
        [working((9_500, EVERYTHING), engine=Engine.EVERY_N)],
        [
            working((9_000, []), engine=Engine.INDUCTION),
            working((1_000, EVERYTHING), engine=Engine.SEARCH),
        ],
        jobs,
        patience=TWICE,
    )
    assert set(engines(found).values()) == {Engine.EVERY_N}


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_was_said_in_time_counts(system: System, jobs: int) -> None:
    found = raced(
        system,
        [
            working((1_500, ["Alone"]), engine=Engine.EVERY_N),
            working((1_000, ["Few"]), (1_000, EVERYTHING), engine=Engine.EVERY_N),
        ],
        [working((1_000, EVERYTHING), engine=Engine.SEARCH)],
        jobs,
        patience=TWICE,
    )
    assert engines(found) == {
        "Alone": Engine.EVERY_N,
        "Few": Engine.EVERY_N,
        "Never": Engine.SEARCH,
        "no fault": Engine.SEARCH,
    }


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_one_proves_in_time_counts_for_others(system: System, jobs: int) -> None:
    """Nobody is asked further where what both sides say is an answer."""
    found = raced(
        system,
        [working((2_000, ["Alone"]), (9_000, EVERYTHING), engine=Engine.EVERY_N)],
        [
            working((1_000, ["Few", "Never", "no fault"]), engine=Engine.INDUCTION),
            working((9_000, EVERYTHING), engine=Engine.SEARCH),
        ],
        jobs,
        patience=TWICE,
    )
    assert Counter(engines(found).values()) == {Engine.EVERY_N: 1, Engine.INDUCTION: 3}


def test_who_says_more_is_ended_once_others_have_answers(system: System) -> None:
    def hanging(ledger: Ledger) -> None:
        ledger.system.budget.report(5_000)
        signal.pause()

    found = raced(
        system, [hanging], [working((1_000, EVERYTHING), engine=Engine.SEARCH)], patience=TWICE
    )
    assert set(engines(found).values()) == {Engine.SEARCH}


@pytest.mark.parametrize("answered", [EVERYTHING, ("Alone", "Few")], ids=["all", "some"])
def test_other_work_is_begun_where_one_alone_is_waited_for(
    system: System, answered: Sequence[str], tmp_path: Path
) -> None:
    """Who says more ends behind the other, of whom all is known by then, or not."""
    gate, end = tmp_path / "gate", tmp_path / "end"
    begun: list[bool] = []
    os.mkfifo(gate)
    is_alone = answered is EVERYTHING

    def first(ledger: Ledger) -> None:
        gate.read_bytes()
        end.touch()

    def beside(ledger: Ledger) -> None:
        working((1_000, answered), engine=Engine.SEARCH)(ledger)
        if not is_alone:
            gate.write_bytes(b"")

    def meanwhile() -> None:
        begun.append(end.exists())
        if is_alone:
            gate.write_bytes(b"")

    raced(system, [first], [beside], patience=TWICE, meanwhile=meanwhile)
    assert begun == [False] if is_alone else all(begun)


def test_other_work_is_begun_where_who_says_more_is_done(system: System, tmp_path: Path) -> None:
    gate, calls = tmp_path / "gate", []
    os.mkfifo(gate)

    def first(ledger: Ledger) -> None:
        pass

    def beside(ledger: Ledger) -> None:
        gate.read_bytes()

    def meanwhile() -> None:
        calls.append(1)
        gate.write_bytes(b"")

    raced(system, [first], [beside], patience=TWICE, meanwhile=meanwhile)
    assert len(calls) == 1


def test_other_work_is_begun_as_soon_as_one_alone_is_waited_for(
    system: System, tmp_path: Path
) -> None:
    """Somebody has all answers, while it is open whether they are needed."""
    gate, calls = tmp_path / "gate", []
    os.mkfifo(gate)

    def first(ledger: Ledger) -> None:
        gate.read_bytes()

    def meanwhile() -> None:
        calls.append(1)
        gate.write_bytes(b"")

    nothing = working((1_000, ()), engine=Engine.INDUCTION)
    everything = working((1_000, EVERYTHING), engine=Engine.SEARCH)
    raced(system, [first], [nothing, everything], patience=TWICE, meanwhile=meanwhile)
    assert len(calls) == 1


def test_behind_all_answers_nobody_is_begun(
    system: System, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whose answers count first is still at work, until the process of the other is gone.

    This process looks at what they said when both are gone, as on a machine with other work.
    """
    gate, begun = tmp_path / "gate", list[int]()
    os.mkfifo(gate)
    begin = processes._begin

    def begins(job: processes.Job[object]) -> None:
        begun.append(1)
        begin(job)
        if len(begun) == 3:
            for child in forked_children():
                os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)

    monkeypatch.setattr(processes, "_begin", begins)
    open_: list[int] = []

    def slow(ledger: Ledger) -> None:
        gate.read_bytes()

    def everything(ledger: Ledger) -> None:
        open_.append(os.open(gate, os.O_WRONLY))
        working((1_000, EVERYTHING), engine=Engine.SEARCH)(ledger)

    found = raced(
        system,
        [lambda ledger: None],
        [slow, everything, lambda ledger: None],
        patience=TWICE,
    )
    assert set(engines(found).values()) == {Engine.SEARCH}
    assert len(begun) == 3


def test_of_what_is_violated_nobody_is_waited_for(system: System) -> None:
    def hanging(ledger: Ledger) -> None:
        working((10, ["Alone", "Few", "no fault"]), engine=Engine.EVERY_N)(ledger)
        signal.pause()

    def violating(ledger: Ledger) -> None:
        never = next(claim for claim in ledger.open() if claim.name == "Never")
        ledger.settle({never: Verdict(never, Outcome.VIOLATED, Engine.BMC, 0.0)})

    found = engines(raced(system, [hanging], [violating], patience=TWICE))
    assert found.pop("Never") is Engine.BMC
    assert set(found.values()) == {Engine.EVERY_N}


def test_nobody_waits_for_proofs_of_what_is_violated(system: System) -> None:
    """Who says nothing is done first; whoever would prove the rest has done no work by then."""

    def violating(ledger: Ledger) -> None:
        for claim in ledger.open():
            ledger.settle({claim: Verdict(claim, Outcome.VIOLATED, Engine.BMC, 0.0)})

    found = raced(
        system,
        [lambda ledger: signal.pause()],
        [lambda ledger: None, violating],
        jobs=3,
        patience=TWICE,
    )
    assert set(engines(found).values()) == {Engine.BMC}


@pytest.mark.parametrize("jobs", [1, 2])
def test_where_others_have_none_it_is_waited_for(system: System, jobs: int) -> None:
    found = raced(
        system,
        [working((90_000, EVERYTHING), engine=Engine.EVERY_N)],
        [working((10, ["Few"]), engine=Engine.SEARCH)],
        jobs,
        patience=TWICE,
    )
    assert set(engines(found).values()) == {Engine.EVERY_N}


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_holds_as_far_as_was_asked_is_open_for_all_rounds(system: System, jobs: int) -> None:
    """A search has seen that all claims hold for eight rounds; that proves none."""

    def looking(ledger: Ledger) -> None:
        ledger.leave(ledger.open(), Reach(Engine.SEARCH, 8, "", 0.0))

    found = raced(
        system,
        [looking, working((9_000, EVERYTHING), engine=Engine.EVERY_N)],
        [working((9_000, []), engine=Engine.INDUCTION)],
        jobs,
        patience=TWICE,
    )
    assert engines(found) == dict.fromkeys(EVERYTHING, Engine.EVERY_N)
    assert found.open() == []


@pytest.mark.parametrize("has_answers", [False, True])
def test_contexts_are_made_for_who_asks_solvers(
    system: System, has_answers: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not for a search that only has to say what it has seen: behind that nobody is begun."""
    made: list[object] = []
    monkeypatch.setattr(race, "make_ahead", made.append)
    everything = proving(EVERYTHING, Engine.SEARCH)
    runner = Runner(0, "search", lambda steps: Turn("search", everything), has_answers)
    ledger = Ledger(
        VerificationProblem(system, lambda *given: pytest.fail("nothing to replay"), system),
        Bounds(8),
        Deadline.after(None),
        claims_of(system),
    )
    with Pool(2) as pool:
        RaceTurn([], [runner], pool, Steps(), "stage", lambda ledger: True).work(ledger)
    assert set(engines(ledger).values()) == {Engine.SEARCH}
    assert len(made) == (0 if has_answers else 1)


# --- begun ahead ----------------------------------------------------------------------------------


def nothing(ledger: Ledger) -> None:
    """Do nothing before a race."""


@pytest.mark.parametrize("jobs", [1, 2, 3])
def test_what_those_who_were_begun_ahead_have_at_a_glance_needs_no_race(
    system: System, jobs: int
) -> None:
    """Nobody else is begun, or the process would not be the only one."""

    def forbidden(ledger: Ledger) -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    found = raced(
        system,
        [working((_HEAD_START, EVERYTHING), engine=Engine.EVERY_N)],
        [forbidden],
        jobs,
        patience=TWICE,
        before=nothing,
    )
    assert set(engines(found).values()) == {Engine.EVERY_N}
    assert not found.failures


@pytest.mark.parametrize("heard", [False, True])
@pytest.mark.parametrize("jobs", [1, 2, 3])
def test_others_know_what_those_who_were_begun_ahead_have_at_a_glance(
    system: System, jobs: int, heard: bool
) -> None:
    """And nothing that these found later, be it before the race was begun."""

    def telling(ledger: Ledger) -> None:
        known = ", ".join(claim.name for claim in ledger.proved())
        ledger.leave(ledger.open(), Reach(Engine.BMC, 1, f"known: {known}", 0.0))

    ledger = raced(
        system,
        [working((_HEAD_START, ["Alone"]), (1, ["Few"]), (90_000, []), engine=Engine.EVERY_N)],
        [telling],
        jobs,
        patience=TWICE,
        before=nothing,
        heard=heard,
    )
    (never,) = (claim for claim in ledger.claims if claim.name == "Never")
    assert ledger.verdict(never).reason == "known: Alone"
    assert engines(ledger)["Few"] is Engine.EVERY_N


@pytest.mark.parametrize("heard", [False, True])
@pytest.mark.parametrize("jobs", [1, 2, 3])
@pytest.mark.parametrize(("steps", "waited"), [(6_000, True), (6_001, False)], ids=str)
def test_those_who_were_begun_ahead_have_so_much_work_from_there_on(
    system: System, steps: int, waited: bool, jobs: int, heard: bool
) -> None:
    found = raced(
        system,
        [working((steps, EVERYTHING), engine=Engine.EVERY_N)],
        [working((2_500, EVERYTHING), engine=Engine.SEARCH)],
        jobs,
        patience=TWICE,
        before=nothing,
        heard=heard,
    )
    assert set(engines(found).values()) == {Engine.EVERY_N if waited else Engine.SEARCH}


@pytest.mark.parametrize("jobs", [1, 2, 3])
@pytest.mark.parametrize(
    ("glance", "waited"), [(_HEAD_START, True), (_HEAD_START + 1, False)], ids=str
)
def test_what_was_done_at_a_glance_is_not_counted(
    system: System, glance: int, waited: bool, jobs: int
) -> None:
    """With it, it is more than 6,000 steps; what takes longer than a glance counts."""
    found = raced(
        system,
        [
            working((glance, ["Few"]), engine=Engine.EVERY_N),
            working((6_000, EVERYTHING), engine=Engine.EVERY_N),
        ],
        [working((2_500, EVERYTHING), engine=Engine.SEARCH)],
        jobs,
        patience=TWICE,
        before=nothing,
    )
    assert engines(found)["Alone"] is (Engine.EVERY_N if waited else Engine.SEARCH)


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_was_settled_before_the_race_stays(system: System, jobs: int) -> None:
    """Those who were begun ahead do not know of it, and ask about all claims."""
    found = raced(
        system,
        [working((1_000, EVERYTHING), engine=Engine.EVERY_N)],
        [],
        jobs,
        before=proving(["Few"], Engine.SEARCH),
    )
    assert engines(found) == {**dict.fromkeys(EVERYTHING, Engine.EVERY_N), "Few": Engine.SEARCH}


@pytest.mark.parametrize("jobs", [1, 2, 3])
def test_who_was_begun_ahead_begins_anew_without_what_is_violated(
    system: System, jobs: int
) -> None:
    """To look for a proof of it would take longer than it is waited for; so long has the new one.

    What the first one has at a glance is known to all by then.
    """

    def before(ledger: Ledger) -> None:
        never = next(claim for claim in ledger.open() if claim.name == "Never")
        ledger.settle({never: Verdict(never, Outcome.VIOLATED, Engine.SEARCH, 0.0)})

    def proof(ledger: Ledger) -> None:
        is_hopeless = "Never" in [claim.name for claim in ledger.open()]
        working((1_000, ["Alone"]), engine=Engine.EVERY_N)(ledger)
        working((90_000 if is_hopeless else 4_999, ["Few"]), engine=Engine.EVERY_N)(ledger)

    found = raced(
        system,
        [proof],
        [working((2_500, EVERYTHING), engine=Engine.SEARCH)],
        jobs,
        patience=TWICE,
        before=before,
    )
    assert engines(found) == {
        "Alone": Engine.EVERY_N,
        "Few": Engine.EVERY_N,
        "Never": Engine.SEARCH,
        "no fault": Engine.SEARCH,
    }


@pytest.mark.parametrize("jobs", [1, 2])
def test_who_was_begun_ahead_and_died_is_followed_by_others(system: System, jobs: int) -> None:
    def dying(ledger: Ledger) -> None:
        working((1_000, ["Alone"]), engine=Engine.EVERY_N)(ledger)
        os.kill(os.getpid(), signal.SIGKILL)

    later = working((1_000, ["Few"]), engine=Engine.EVERY_N)
    everything = proving(EVERYTHING, Engine.SEARCH)
    found = raced(system, [dying, later], [everything], jobs, before=nothing, apart=True)
    assert Counter(engines(found).values()) == {Engine.EVERY_N: 2, Engine.SEARCH: 2}
    assert [failure.who for failure in found.failures] == ["runner 0"]


@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_while_those_who_were_begun_ahead_are_heard_is_not_forgotten(
    system: System, jobs: int
) -> None:
    """What they have found by then is known, also where that is all that was asked of them."""
    pressed: list[str] = []

    def press(text: str) -> None:
        pressed.append(text)
        if len(pressed) == 1:
            raise KeyboardInterrupt

    def telling(ledger: Ledger) -> None:
        ledger.report("at it")
        proving(EVERYTHING, Engine.EVERY_N)(ledger)

    found = raced(system, [telling], [], jobs, before=nothing, progress=press, apart=True)
    assert pressed
    assert found.interrupted
    assert set(engines(found).values()) == {Engine.EVERY_N}


@pytest.mark.parametrize("jobs", [1, 2])
def test_whoever_was_begun_ahead_is_ended_where_there_is_no_race(system: System, jobs: int) -> None:
    """A search at a glance sees that all claims are violated: what is begun would never end."""
    ledger = Ledger(
        VerificationProblem(system, lambda *given: pytest.fail("nothing to replay"), system),
        Bounds(8),
        Deadline.after(None),
        claims_of(system),
    )
    hangs = Runner(0, "hangs", lambda steps: Turn("hangs", lambda ledger: signal.pause()))
    with Pool(jobs) as pool:
        with Ahead.begun([hangs], ledger, pool).ending(ledger, pool):
            assert len(forked_children()) == jobs - 1
        pool.reap()
        assert forked_children() == set()


# --- at a glance ----------------------------------------------------------------------------------


def ledger_of(system: System) -> Ledger:
    subject = VerificationProblem(system, lambda *given: pytest.fail("nothing to replay"), system)
    return Ledger(subject, Bounds(8), Deadline.after(None), claims_of(system))


def runner(work: Callable[[Ledger], None]) -> Runner:
    return Runner(0, "runner", lambda steps: Turn("runner", work))


def something_open(ledger: Ledger) -> bool:
    return bool(ledger.open())


def at_it(*stretches: tuple[int, Sequence[str]]) -> Callable[[Ledger], None]:
    """Work that proves claims, and says in which process it does."""

    def work(ledger: Ledger) -> None:
        for steps, names in stretches:
            working((steps, names), engine=Engine.EVERY_N)(ledger)
        ledger.fail(Failure(str(os.getpid()), "is where it ended"))

    return work


@pytest.mark.parametrize(("steps", "apart"), [(_HEAD_START, False), (_HEAD_START + 1, True)])
def test_what_takes_longer_than_a_glance_goes_on_in_another_process(
    system: System, steps: int, apart: bool
) -> None:
    """Once, and with all that it has by then."""
    ledger = ledger_of(system)
    with Pool(2) as pool:
        begun = Ahead.begun(
            [runner(at_it((1_000, ["Few"]), (steps - 1_000, EVERYTHING)))], ledger, pool, here=True
        )
        assert begun.job.is_done is not apart
        assert len(forked_children()) == apart
        noted = [note.claim.name for note in begun.job.noted if isinstance(note, Verdict)]
        assert noted[:1] == ["Few"]
        found = pool.answer(begun.job)
        assert found is not None
        ledger.take(found)
        pool.reap()
        assert forked_children() == set()
    assert set(engines(ledger).values()) == {Engine.EVERY_N}
    (failure,) = ledger.failures
    assert (failure.who != str(os.getpid())) is apart


def test_who_has_its_turn_behind_one_that_leaves_claims_open_has_another_process(
    system: System,
) -> None:
    """Of what is still open others look for violations meanwhile."""
    ledger = ledger_of(system)
    turns = [at_it((10, ["Few"])), at_it((10, EVERYTHING))]
    runners = [replace(runner(work), number=n) for n, work in enumerate(turns)]
    with Pool(2) as pool:
        begun = Ahead.begun(runners, ledger, pool, here=True)
        assert not begun.job.is_done
        assert [x.claim.name for x in begun.job.noted if isinstance(x, Verdict)] == ["Few"]
        found = pool.answer(begun.job)
        assert found is not None
        ledger.take(found)
    assert [noted.steps for noted in begun.job.noted if isinstance(noted, race.Worked)][-1] == 20
    here, there = (failure.who for failure in ledger.failures)
    assert here == str(os.getpid()) != there


def test_work_is_told_of_now_and_then_wherever_it_goes_on(system: System) -> None:
    """Who waits with patience knows how much of it there was before there is an answer."""

    def work(ledger: Ledger) -> None:
        for _ in range(3 * _HEAD_START // 100):
            ledger.system.budget.report(100)

    ledger = ledger_of(system)
    with Pool(2) as pool:
        begun = Ahead.begun([runner(work)], ledger, pool, here=True)
        assert not begun.job.is_done
        pool.answer(begun.job)
    told = [noted.steps for noted in begun.job.noted if isinstance(noted, race.Worked)]
    assert told[-1] == 3 * _HEAD_START
    steps = [after - before for before, after in pairwise(told)]
    assert max(steps) <= 2 * race._HEARD


@pytest.mark.parametrize(
    ("names", "steps", "taken"),
    [
        (EVERYTHING, 10, True),
        (EVERYTHING[1:], 10, False),  # something is open: others are asked
        (EVERYTHING, 3 * _HEAD_START, False),  # it takes longer
    ],
)
def test_all_or_nothing_is_taken_at_a_glance(
    system: System, names: Sequence[str], steps: int, taken: bool
) -> None:
    ledger = ledger_of(system)
    with Pool(2) as pool:
        begun = Ahead.begun([runner(at_it((steps, names)))], ledger, pool, here=True)
        with begun.ending(ledger, pool):
            assert begun.settles(ledger, something_open) is taken
        pool.reap()
        assert forked_children() == set()
    assert (set(engines(ledger).values()) == {Engine.EVERY_N}) is taken
    assert bool(ledger.open()) is not taken


def test_ctrl_c_at_a_glance_leaves_what_is_known(system: System) -> None:
    def pressed(ledger: Ledger) -> None:
        working((10, ["Few"]), engine=Engine.EVERY_N)(ledger)
        raise KeyboardInterrupt

    ledger = ledger_of(system)
    with Pool(2) as pool, ledger.stopping():
        Ahead.begun([runner(pressed)], ledger, pool, here=True).settles(ledger, something_open)
    assert ledger.interrupted
    assert engines(ledger)["Few"] is Engine.EVERY_N
    assert engines(ledger)["Alone"] is Engine.NONE


@pytest.mark.parametrize("steps", [10, 3 * _HEAD_START], ids=["glance", "longer"])
def test_mistakes_of_those_who_were_begun_here_are_told_where_they_are_heard(
    system: System, steps: int
) -> None:
    def wrong(tell: JobChannel) -> Never:
        for done in range(0, steps, 200):
            tell.note(race.Worked(done))
        raise LookupError("wrong")

    with Pool(2) as pool:
        job = pool.begin_here("", wrong, is_long=race._Glance().is_over)
        with pytest.raises(LookupError, match="wrong"):
            pool.answer(job)
        assert forked_children() == set()


def test_where_there_can_be_no_more_processes_it_goes_on_in_this_one(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none() -> NoReturn:
        raise OSError("none left")

    monkeypatch.setattr(job_process, "part", none)
    ledger = ledger_of(system)
    with Pool(2) as pool:
        begun = Ahead.begun([runner(at_it((9_000, EVERYTHING)))], ledger, pool, here=True)
        assert begun.job.is_done
        assert begun.settles(ledger, something_open)


@pytest.mark.parametrize(("jobs", "asked"), [(1, ["search", "every N"]), (2, ["every N"])])
def test_nobody_looks_for_violations_of_what_is_proved_at_a_glance(
    jobs: int, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one process that is looked for first, and told sooner."""
    system = dealt(program_of(LOCK.split("invariant")[0] + KEPT), 2)
    begun: list[str] = []
    begin = Steps.begin

    def begins(steps: Steps, stage: str, turn: int, who: str) -> bool:
        if stage == "slice":
            begun.append(who)
        return begin(steps, stage, turn, who)

    monkeypatch.setattr(Steps, "begin", begins)
    report = verify(system, Bounds(5), jobs=jobs)
    assert {verdict.engine for verdict in report.verdicts} == {Engine.EVERY_N}
    assert [who for who in dict.fromkeys(begun) if who in ("search", "every N")] == asked


KEPT = "invariant Few: forall i: 0 <= steps@i and steps@i < 3\n"


def test_what_a_process_died_of_at_a_glance_is_begun_in_another_one(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def begun(*given: object, here: bool = False) -> NoReturn:
        done.append("here" if here else "apart")
        raise KeyboardInterrupt

    monkeypatch.setattr(Ahead, "begun", begun)
    told: list[object] = []
    verify(system, Bounds(5), jobs=2, noted=told.append)
    verify(system, Bounds(5), jobs=2, past=PastVerification().told(told))
    verify(system, Bounds(5), jobs=1)
    assert done == ["here", "apart", "apart"]


# --- the table ------------------------------------------------------------------------------------


def test_races_have_an_end() -> None:
    """Who is asked while others wait has a budget: that of induction is its own."""
    races = [row for row in SAFETY[None] if isinstance(row, AskAtOnce)]
    assert len(races) > 1
    for contest in races:
        for row in (*contest.first, *contest.beside):
            if isinstance(row, AskEngine) and row.engine is not Engine.INDUCTION:
                task = row.task
                assert {task.seconds, task.states, task.evaluations, task.questions} != {None}


def test_who_has_seen_all_configurations_says_so_first(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before an inductive step; who has seen some of them is asked to go on behind it."""
    begun: list[list[str]] = []
    answers: list[list[bool]] = []

    def ended(turn: RaceTurn, ledger: Ledger) -> None:
        begun.append([runner.name for runner in turn.beside])
        answers.append([runner.has_answers for runner in turn.beside])
        raise KeyboardInterrupt

    monkeypatch.setattr(RaceTurn, "work", ended)
    verify(system, Bounds(5))
    monkeypatch.setattr(EngineTurn, "work", lambda turn, ledger: None)
    verify(system, Bounds(5))
    assert [names[:2] for names in begun] == [["search", "induction"], ["induction", "search"]]
    assert [which.index(True) if any(which) else None for which in answers] == [0, None]


def test_rows_are_for_fleets() -> None:
    few, many = table.FEW_ROBOTS, table.FEW_ROBOTS + 1
    assert (Fleet.FEW.has(few), Fleet.FEW.has(many)) == (True, False)
    assert (Fleet.MANY.has(few), Fleet.MANY.has(many)) == (False, True)
    assert Fleet.ANY.has(few)
    assert Fleet.ANY.has(many)


def test_rows_are_for_inputs_without_end(system: System) -> None:
    row = AskEngine(Engine.BMC, endless=True)
    sensed = "using Motion:\n    sensors:\n        float level\nRead:\n    eff: pass\n"
    assert not row.suits(system)
    assert row.suits(dealt(program_of(sensed), 2))
    assert AskEngine(Engine.BMC).suits(system)


def test_circuits_are_asked_to_the_end_before_a_long_search() -> None:
    """Two thousand questions are enough where a search goes through thousands of configurations."""
    (agree, *_) = verify(
        dealt(program_of(protocol_text("consensus_epr")), 3), Bounds(4), names=("Agree",)
    ).verdicts
    assert (agree.outcome, agree.engine) == (Outcome.HOLDS, Engine.BITS)


# --- programs of others ---------------------------------------------------------------------------


def test_abc_ends_with_whoever_asks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of abc, something that never ends: it holds a pipe, whose end is read here."""
    alive = tmp_path / "alive"
    os.mkfifo(alive)
    program = tmp_path / "abc"
    program.write_text(f"#!/bin/sh\nexec 3> {alive}\necho begun >&3\nexec sleep 100000\n")
    program.chmod(0o755)
    monkeypatch.setattr(abc, "installed", lambda: str(program))
    question = SafetyQuery((), TRUE, TRUE, FALSE)

    def work(tell: JobChannel) -> None:
        abc.searched(Graph(), question, Deadline())

    with Pool(2) as pool:
        job = pool.submit("", work)
        with alive.open() as pipe:
            assert pipe.readline() == "begun\n"
            pool.drop(job)
            assert pipe.read() == ""  # it is gone, or this would never end


def test_engines_that_race_are_loaded_by_who_starts_them(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Most are asked again after a race, or about a slice: each process would load them anew."""
    loaded: list[tuple[int, Engine]] = []
    monkeypatch.setattr(verification, "load", lambda it: loaded.append((os.getpid(), it)))
    race_for_all(monkeypatch)
    verify(system, Bounds(4), jobs=2)
    assert {pid for pid, _ in loaded} == {os.getpid()}
    assert Engine.SEARCH in {engine for _, engine in loaded}
