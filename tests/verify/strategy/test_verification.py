"""What ``koord verify`` says in the end: scopes, reasons, what was left out, and what is empty."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import pytest

from koord.sampling import initial_state_search
from koord.semantics.domain import EXACT
from koord.semantics.recordings import Recording, execute
from koord.syntax import core
from koord.syntax.printing.quoting import Quoting
from koord.syntax.system import dealt
from koord.syntax.types import BOOL, FLOAT, INT, ListType
from koord.verify.claims import Claim, ClaimKind, ClaimPhase, claims_of
from koord.verify.effort import Deadline
from koord.verify.encoding.unknowns import LIST_CAPACITY
from koord.verify.engine_names import Engine
from koord.verify.engines.bmc import engine
from koord.verify.engines.engine import Purpose, Task
from koord.verify.engines.explicit import engine as explicit
from koord.verify.engines.explicit.limits import FEW_STATES, HANDFUL, Limits
from koord.verify.ledger import Ledger, Reach, VerificationProblem, reach_of
from koord.verify.obstacles import GaveUp, WholeRuns
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import (
    Bounds,
    Counterexample,
    Emptiness,
    EnumerationResult,
    Outcome,
    Report,
    Vacuity,
    Verdict,
)
from tests.sampling import first
from tests.semantics import programs
from tests.semantics.building import (
    PID,
    STOP,
    TRUE,
    Build,
    E,
    I,
    J,
    bound,
    contract,
    e,
    for_range,
    forall,
    length,
    lst,
)
from tests.verify.asking import ask, of_text


@pytest.fixture(autouse=True)
def _small_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs here are small, or infinite: a short search tells them apart as well.

    What is not hit upon soon is not hit upon at all.
    """
    monkeypatch.setattr(initial_state_search, "START_TRIES", 100)
    search_through(monkeypatch, handful=5)


def search_through(monkeypatch: pytest.MonkeyPatch, *, handful: int) -> None:
    """Let searches for proofs end after so few states, where others are asked behind them."""
    few = {HANDFUL: handful, FEW_STATES: 300}
    of = explicit.limits_of

    def limits(task: Task) -> Limits:
        if task.purpose is not Purpose.SETTLE or task.states is None:
            return of(task)
        return Limits(states=few[task.states])

    monkeypatch.setattr(explicit, "limits_of", limits)


def test_a_handful_of_states_is_looked_at_before_long_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three spots in a map: solvers take half a minute over steps of three rounds."""
    search_through(monkeypatch, handful=500)
    told: list[str] = []
    system = of_text(
        """allwrite:
    Map<int, int> owner = {}

local:
    int mine = -1

Claim:
    pre: mine == -1
    eff:
        atomic:
            for k = 0, 3:
                if mine == -1 and not contains(owner, k):
                    owner[k] = pid
                    mine = k

invariant Apart: forall i, j: i != j and mine@i != -1 implies mine@i != mine@j
""",
        3,
    )
    report = verify(system, Bounds(), progress=told.append)
    assert {(v.outcome, v.engine, v.rounds) for v in report.verdicts} == {
        (Outcome.HOLDS, Engine.SEARCH, None)
    }
    assert not [text for text in told if "over 2 rounds" in text]


def late(rounds: int, states: int = 6) -> core.Program:
    """An invariant that breaks in a round; robots have so many states."""
    b = Build("late")
    n = b.local("n", INT, 0)
    b.event("Count", n < states - 1, n.set(n + 1))
    b.invariant("Small", forall(I, n.at(I) < rounds))
    return b.program()


def growing() -> Build:
    """Infinitely many configurations, and an invariant that no induction here proves."""
    b = Build("growing")
    x, y = b.local("x", INT, 0), b.local("y", INT, 0)
    b.event("Go", TRUE, y.set(y + x * x), x.set(x + 1))
    b.invariant("NotSeven", forall(I, y.at(I).ne(7)))
    return b


def climbing() -> Build:
    """Infinitely many configurations, and an invariant that is proved in no time."""
    b = Build("climbing")
    x = b.local("x", INT, 0)
    b.event("Go", TRUE, x.set(x + 1))
    b.invariant("Positive", forall(I, x.at(I) >= 0))
    return b


# --- scopes ---------------------------------------------------------------------------------------


def test_a_proof_says_for_all_rounds() -> None:
    for verdict in ask(programs.sum_of_ids(), robots=3):
        assert (verdict.outcome, verdict.rounds) == (Outcome.HOLDS, None)
        assert verdict.engine in (Engine.EVERY_N, Engine.INDUCTION, Engine.SEARCH, Engine.BITS)


def test_bounded_model_checking_says_through_which_round() -> None:
    verdict = ask(growing().program(), robots=1, rounds=4, choice=Engine.BMC)["NotSeven"]
    assert (verdict.outcome, verdict.engine, verdict.rounds) == (Outcome.HOLDS, Engine.BMC, 4)
    asked = ask(programs.sum_of_ids(), rounds=2, choice=Engine.BMC)
    assert all((v.engine, v.rounds) == (Engine.BMC, 2) for v in asked)


def test_a_search_that_came_far_enough_answers_too() -> None:
    b = Build()
    x = b.local("x", INT, 2)
    b.event("Square", TRUE, x.set(x * x))
    b.invariant("NotSeven", forall(I, x.at(I).ne(7)))
    verdict = ask(b.program(), robots=1, rounds=4, choice=Engine.SEARCH)["NotSeven"]
    assert (verdict.outcome, verdict.engine) == (Outcome.HOLDS, Engine.SEARCH)
    assert verdict.rounds is not None
    assert verdict.rounds >= 4


@pytest.mark.slow
def test_what_grows_for_ever_is_proved_all_the_same() -> None:
    verdict = ask(growing().program(), robots=1, rounds=4)["NotSeven"]
    assert (verdict.outcome, verdict.engine) == (Outcome.HOLDS, Engine.SPACER)
    assert verdict.rounds is None


def test_a_violation_says_in_which_round_and_is_shortest() -> None:
    for choice in (None, Engine.BMC, Engine.SEARCH):
        verdict = ask(late(4), rounds=9, choice=choice)["Small"]
        assert verdict.outcome is Outcome.VIOLATED
        shown = verdict.counterexample
        assert shown is not None
        assert shown.round == len(shown.recording.rounds) == 4


@pytest.mark.parametrize("choice", [None, Engine.BMC, Engine.SEARCH])
@pytest.mark.parametrize("program", [programs.counter_race(), late(3)], ids=lambda p: p.name)
def test_every_violation_replays(program: core.Program, choice: Engine | None) -> None:
    """What is shown is a legal run of the exact semantics, to the step that breaks the claim."""
    system = dealt(program, 3)
    shown = [v for v in ask(system, rounds=5, choice=choice) if v.counterexample is not None]
    for verdict in shown:
        assert verdict.counterexample is not None
        steps = list(execute(EXACT, system, verdict.counterexample.recording))
        assert steps[-1].configuration.round <= verdict.counterexample.round


def test_what_is_shown_has_no_event_that_need_not_be() -> None:
    """Three robots could count, and one is enough."""
    shown = ask(late(3), robots=3, rounds=4, choice=Engine.BMC)["Small"].counterexample
    assert shown is not None
    ran = [e for round_ in shown.recording.rounds for e in round_.events if e is not None]
    assert len(ran) == 3


def test_what_shows_a_lost_update_keeps_the_update() -> None:
    """[LOST-UPDATE]: leaving out events must not leave out the one that loses or is lost."""
    for updater in range(3):
        b = Build()
        x = b.allwrite("x", INT, 0)
        b.event("Set", PID.ne(updater), x.set(5))
        b.event("Up", PID.eq(updater) & (x < 9), x.set(x + 1))
        for choice in (Engine.BMC, Engine.SEARCH):
            asked = ask(b.program(), robots=3, rounds=1, choice=choice)
            shown = asked["no lost update of x"].counterexample
            assert shown is not None
            assert shown.recording.rounds[-1].events[updater] == 1
            assert sum(e is not None for e in shown.recording.rounds[-1].events) == 2


def test_different_violations_differ_in_what_they_need() -> None:
    """Each leaves out something that every other one needs; who does it, and when, is no matter."""
    b = Build("pairs")
    x = b.local("x", INT, 0)
    b.event("Go", x < 2, x.set(x + 1))
    b.invariant("Few", forall(I, forall(J, (I.ne(J) & x.at(I).eq(1)) >> x.at(J).eq(0))))
    system = dealt(b.program(), 3)
    for choice in (Engine.BMC, Engine.SEARCH):
        report = verify(system, Bounds(2, violations=9), choice)
        (verdict,) = [v for v in report.verdicts if v.claim.name == "Few"]
        assert verdict.counterexample is not None
        shown = [verdict.counterexample, *verdict.others]
        # Two of three robots, whichever: in one round, which is one way with one after the other.
        assert [ran(c.recording) for c in shown] == [[1, 1]]
        assert verdict.ways == EnumerationResult(complete=True)


def early_and_late() -> core.Program:
    """A variable is broken in the first round, or by another event in the third."""
    b = Build("twice")
    x, y = b.local("x", INT, 0), b.local("y", INT, 0)
    b.event("Break", y.eq(0), x.set(1))
    b.event("Wait", y < 2, y.set(y + 1))
    b.event("Ruin", y.eq(2), x.set(2))
    b.invariant("Whole", forall(I, x.at(I).eq(0)))
    return b.program()


@pytest.mark.parametrize(
    ("rounds", "most", "found", "ways"),
    [
        (2, 5, 1, EnumerationResult(complete=True)),
        (3, 5, 2, EnumerationResult(complete=True)),
        (3, 2, 2, EnumerationResult(complete=False)),
    ],
)
def test_it_is_told_whether_there_are_more_ways(
    rounds: int, most: int, found: int, ways: EnumerationResult
) -> None:
    """Within the bound, that is; and none beyond the bound is found."""
    report = verify(dealt(early_and_late(), 1), Bounds(rounds, violations=most), Engine.BMC)
    verdict = report.verdicts[0]
    assert 1 + len(verdict.others) == found
    assert verdict.ways == ways


def test_ways_that_were_not_looked_for_to_the_end_are_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(engine, "_SECONDS", 0.0)
    report = verify(dealt(early_and_late(), 1), Bounds(3, violations=5), Engine.BMC)
    verdict = report.verdicts[0]
    assert verdict.counterexample is not None
    assert verdict.ways is not None
    assert verdict.ways.reason
    assert not verdict.ways.complete
    assert verify(dealt(early_and_late(), 1), Bounds(3), Engine.BMC).verdicts[0].ways is None


def ran(recording: Recording) -> list[int]:
    """How many events each robot runs that runs any."""
    events = zip(*(round_.events for round_ in recording.rounds), strict=True)
    return [count for each in events if (count := sum(e is not None for e in each))]


def test_one_violation_is_enough_if_no_more_are_asked_for() -> None:
    assert all(v.others == () for v in ask(late(2)))


def test_the_outcome_of_a_report_is_its_worst() -> None:
    assert ask(programs.sum_of_ids()).report.outcome is Outcome.HOLDS
    assert ask(late(2)).report.outcome is Outcome.VIOLATED
    assert ask(growing().program(), choice=Engine.INDUCTION).report.outcome is Outcome.UNKNOWN


def test_one_claim_can_be_asked_for_and_the_others_still_help() -> None:
    b = Build()
    x, y = b.local("x", INT, 0), b.local("y", INT, 0)
    b.event("Go", TRUE, y.set(x), x.set(0))
    b.invariant("Lemma", forall(I, x.at(I).eq(0)))
    b.invariant("Goal", forall(I, y.at(I).eq(0)))
    report = verify(dealt(b.program(), 2), Bounds(3), Engine.INDUCTION, names=("Goal",))
    (verdict,) = report.verdicts
    assert (verdict.claim.name, verdict.outcome, verdict.depth) == ("Goal", Outcome.HOLDS, 1)


def test_liveness_is_left_open_by_engines_that_know_nothing_of_it() -> None:
    b = growing()
    kind = core.PropertyKind.EVENTUALLY
    b.properties.append(core.Property("Some", kind, core.Const(True, BOOL), 0))
    report = verify(dealt(b.program(), 2), Bounds(1), Engine.INDUCTION, names=("Some",))
    (verdict,) = report.verdicts
    assert verdict.outcome is Outcome.UNKNOWN
    assert verdict.obstacles == (WholeRuns(),)


# --- running out ----------------------------------------------------------------------------------


def test_without_time_everything_is_unknown() -> None:
    report = verify(dealt(growing().program(), 2), Bounds(5, 0.0))
    assert {v.outcome for v in report.verdicts if v.claim.kind is ClaimKind.PROPERTY} == {
        Outcome.UNKNOWN
    }
    assert any("timeout" in v.reason or "out of time" in v.reason for v in report.verdicts)


def test_out_of_time_says_how_far_it_holds() -> None:
    """The solver cannot tell whether three cubes add up; until then it could."""
    b = Build()
    n = b.local("n", INT, 0)
    x, y, z = (b.sensor(name, INT, 0) for name in "xyz")
    b.module()
    cubes = x * x * x + y * y * y + z * z * z
    b.event("Count", n < 2, n.set(n + 1), urgent=True)
    b.event("Find", n.eq(2) & cubes.eq(114), n.set(5))
    b.invariant("NotFound", forall(I, n.at(I) < 5))
    report = verify(dealt(b.program(), 1), Bounds(9, 2.0), Engine.BMC)
    (verdict,) = [v for v in report.verdicts if v.claim.name == "NotFound"]
    assert (verdict.outcome, verdict.engine) == (Outcome.UNKNOWN, Engine.BMC)
    assert verdict.reason == "timeout"
    assert verdict.rounds in (2, 3)


class _CtrlC:
    """Presses Ctrl-C when progress is told for the n-th time, or of something."""

    def __init__(self, when: Callable[[int, str], bool]) -> None:
        self.told: list[str] = []
        self._when = when

    def __call__(self, text: str) -> None:
        self.told.append(text)
        if self._when(len(self.told), text):
            raise KeyboardInterrupt


def interrupted(
    program: core.Program, when: Callable[[int, str], bool], choice: Engine | None = None
) -> Report:
    return verify(dealt(program, 1), Bounds(9), choice, progress=_CtrlC(when))


def test_ctrl_c_ends_in_what_is_known() -> None:
    program = growing().program()
    told: list[str] = []

    def when(number: int, text: str) -> bool:
        """In the second of two slices: nothing faults, and so that is asked of nothing at all."""
        told.append(text)
        return sum("bmc, round 5" in each for each in told) == 2

    report = interrupted(program, when, Engine.BMC)
    assert report.interrupted
    *open_, no_fault = report.verdicts
    assert (no_fault.outcome, no_fault.rounds) == (Outcome.HOLDS, 9)
    for verdict in open_:
        assert (verdict.outcome, verdict.engine) == (Outcome.UNKNOWN, Engine.BMC)
        assert (verdict.rounds, verdict.reason) == (4, "interrupted")


def test_ctrl_c_leaves_what_is_proved() -> None:
    report = interrupted(growing().program(), lambda n, text: text.startswith("NotSeven: "))
    verdicts = {v.claim.name: v for v in report.verdicts}
    assert report.interrupted
    assert verdicts["no fault"].outcome is Outcome.HOLDS
    assert verdicts["NotSeven"].outcome is Outcome.UNKNOWN
    assert verdicts["NotSeven"].reason == "interrupted"


def test_ctrl_c_at_any_moment() -> None:
    """A report comes of it whenever it is pressed, and never says what is not so."""
    cut = 0
    for moment in range(1, 12):
        reached = 0

        def when(number: int, text: str, moment: int = moment) -> bool:
            nonlocal reached
            reached = number
            return number == moment

        report = interrupted(late(3), when)
        # How much is told before all is settled hangs on how soon other processes are.
        assert report.interrupted or reached < moment or moment > 3
        assert [v.claim.name for v in report.verdicts] == ["Small", "no fault"]
        assert report.verdicts[0].outcome is not Outcome.HOLDS
        cut += report.interrupted
    assert cut > 0


def test_what_holds_for_some_rounds_is_no_lemma() -> None:
    """Other claims may rely only on what holds in every round."""
    system = dealt(growing().program(), 1)
    claims = claims_of(system)
    ledger = Ledger(
        VerificationProblem(system, _judge, system), Bounds(9), Deadline.after(None), claims
    )
    some, every = claims
    ledger.settle({some: Verdict(some, Outcome.HOLDS, Engine.BMC, 0.0, rounds=4)})
    ledger.settle({every: Verdict(every, Outcome.HOLDS, Engine.INDUCTION, 0.0, rounds=None)})
    assert ledger.proved() == [every]
    assert ledger.open() == []


def test_how_far_an_engine_came_is_not_forgotten() -> None:
    """A later try of it may have less time; and what came farther counts for all of them."""
    system = dealt(growing().program(), 1)
    first, *_ = claims = claims_of(system)
    ledger = Ledger(
        VerificationProblem(system, _judge, system),
        Bounds(9),
        Deadline.after(None),
        claims,
        before={first: 0.5},
        clock=lambda: 0.0,
    )
    known = Verdict(
        first,
        Outcome.UNKNOWN,
        Engine.SEARCH,
        0.5,
        rounds=7,
        reason="too many states",
        obstacles=(GaveUp(Engine.SEARCH),),
    )
    ledger.leave([first], reach_of(known))
    ledger.leave([first], Reach(Engine.SEARCH, 2, "timeout", 0.1))
    ledger.leave([first], Reach(Engine.BMC, 0, "timeout", 0.0))
    assert ledger.verdict(first) == known
    ledger.leave([first], Reach(Engine.SEARCH, 7, "out of memory", 0.5))
    assert ledger.verdict(first).reason == "out of memory"


def test_what_was_not_looked_at_whole_does_not_hold() -> None:
    """All rounds were looked at, but for something: then there is a reason."""
    system = dealt(growing().program(), 1)
    first, *_ = claims = claims_of(system)
    ledger = Ledger(
        VerificationProblem(system, _judge, system), Bounds(9), Deadline.after(None), claims
    )
    ledger.leave([first], Reach(Engine.BMC, 9, "not covered: long lists", 0.1))
    assert ledger.verdict(first).outcome is Outcome.UNKNOWN
    assert ledger.verdict(first).reason == "not covered: long lists"
    ledger.leave([first], Reach(Engine.SEARCH, 9, "", 0.1))
    assert ledger.verdict(first).outcome is Outcome.HOLDS


def _judge(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
    raise AssertionError("nothing is replayed")


# --- what is not covered --------------------------------------------------------------------------


def test_a_loop_without_a_known_bound_is_unknown_with_its_place() -> None:
    """A range that depends on a variable is more than the formula can follow."""
    b = Build()
    n, x, k = b.local("n", FLOAT, 0), b.local("x", INT, 0), bound("k", 0, INT)
    b.event("Go", TRUE, for_range(k, 0, x, n.set(n + Fraction(1, 3))), x.set(x + 1), bound=1)
    b.invariant("Low", forall(I, n.at(I) < 2))
    asked = ask(b.program(), rounds=6, choice=Engine.BMC)
    assert asked.outcome("Low") is Outcome.UNKNOWN
    assert "no bound" in asked["Low"].reason
    assert not asked.report.failures  # it is a limit, and no mistake
    # Nothing in the loop can fault: whether there is a fault does not depend on it. [T-CONE]
    assert asked.outcome("no fault") is Outcome.HOLDS


def test_long_lists_are_told_and_never_claimed() -> None:
    """A sensor's list may be longer than what the formula looks at."""
    b = Build()
    seen, most = b.sensor("seen", ListType(INT), lst(INT)), b.local("most", INT, 0)
    b.module()
    b.event("Look", TRUE, most.set(length(seen)))
    b.invariant("Few", forall(I, most.at(I) < 50))
    b.invariant("One", forall(I, most.at(I) < 1))
    for choice in (None, Engine.BMC, Engine.INDUCTION):
        asked = ask(b.program(), robots=1, rounds=3, choice=choice)
        assert asked.outcome("Few") is Outcome.UNKNOWN
        assert asked.outcome("One") is not Outcome.HOLDS
        assert "seen" in asked["Few"].reason or choice is Engine.INDUCTION
        if choice is None:
            shown = asked["One"].counterexample
            assert shown is not None
            assert shown.round == 2


def test_what_only_long_lists_allow_is_not_said_to_be_impossible() -> None:
    """A contract that asks for longer lists than are looked at leaves no run, of those."""

    def told(*promises: Callable[[E], E]) -> tuple[Vacuity, ...]:
        b = Build()
        seen = b.sensor("seen", ListType(INT), lst(INT))
        n = b.local("n", INT, 0)
        b.module(contracts=[contract("Many", [], [p(length(seen.primed)) for p in promises])])
        b.event("Look", TRUE, n.set(n + 1))
        b.invariant("Low", forall(I, n.at(I) >= 0))
        return verify(dealt(b.program(), 1), Bounds(3)).vacuities

    # A run at random has one. Where there is none, the solver does not know of longer ones.
    assert told(lambda n: n > LIST_CAPACITY) == ()
    (empty,) = told(lambda n: n > LIST_CAPACITY, lambda n: n < LIST_CAPACITY)
    assert empty.what is Emptiness.CONTRACTS
    assert "not covered: lists" in empty.detail
    assert not empty.certain


@pytest.mark.parametrize("choice", first(1, (Engine.BMC, Engine.INDUCTION, None)), ids=str)
def test_candidates_that_do_not_replay_are_unknown_and_prove_nothing(choice: Engine | None) -> None:
    """No rational number is the root of 2, so no run of numbers shows it; it is still so."""
    b = Build()
    x, n = b.local("x", FLOAT, core.Start.ARBITRARY), b.local("n", INT, 0)
    b.event("Go", TRUE, n.set(n + 1))
    b.assume(forall(I, (x.at(I) * x.at(I)).eq(2)))
    b.invariant("NoRoot", forall(I, (x.at(I) * x.at(I)).ne(2)))
    b.invariant("Small", forall(I, n.at(I) < 3))
    asked = ask(b.program(), robots=1, rounds=3, choice=choice)
    # NoRoot is false from the start: as a lemma it would prove everything.
    assert asked.outcome("NoRoot") is Outcome.UNKNOWN
    assert asked.outcome("Small") is Outcome.UNKNOWN
    if choice is Engine.BMC:
        assert "did not replay" in asked["NoRoot"].reason
        assert asked["NoRoot"].rounds is None
        assert asked["Small"].rounds == 2


# --- emptiness ------------------------------------------------------------------------------------


def test_assumptions_that_contradict_each_other_are_told() -> None:
    """[PROP-ASSUME]: everything holds then, for no reason."""
    b = climbing()
    z = b.local("z", INT, core.Start.ARBITRARY)
    b.assume(forall(I, z.at(I) > 3))
    b.assume(forall(I, z.at(I) < 3))
    asked = ask(b.program(), robots=1)
    assert asked.report.outcome is Outcome.HOLDS
    assert asked.empty == ["assumptions: no initial configuration satisfies them all"]


@pytest.mark.parametrize("choice", first(1, [Engine.BMC, None]))
def test_contracts_that_contradict_each_other_are_told_with_the_round(
    choice: Engine | None,
) -> None:
    """[ENV-CONTRACT]: no environment's turn meets them in round 3."""
    b = climbing()
    age = b.sensor("age", INT, 0)
    ages = contract("Ages", [], [age.primed.eq(age + 1)])
    b.module(contracts=[ages, contract("Young", [], [age.primed < 3])])
    b.event("Late", age > 6, STOP)
    asked = ask(b.program(), robots=1, rounds=6, choice=choice)
    assert asked.empty == ["contracts: no run gets through round 3"]
    asked = ask(programs.rover(contradictory=True), rounds=4, choice=choice)
    assert asked.empty == ["contracts: no run gets through round 1"]


@pytest.mark.slow
def test_events_that_never_run_are_told() -> None:
    b = climbing()
    z = b.local("z", INT, 0)
    b.event("Never", z > 0, z.set(0))
    b.event("InRound3", core_local(b, 0) > 1, STOP)
    assert ask(b.program(), robots=1, rounds=2, choice=Engine.BMC).empty == [
        "event Never: cannot run within 2 rounds",
        "event InRound3: cannot run within 2 rounds",
    ]
    asked = ask(b.program(), robots=1, rounds=3, choice=Engine.BMC)
    assert asked.empty == ["event Never: cannot run within 3 rounds"]
    # In a later round it may: that is no vacuity.
    assert not asked.report.is_vacuous


def test_what_happens_late_says_something_of_all_rounds_only() -> None:
    b = Build("counting")
    n = b.local("n", INT, 0)
    b.event("Count", n < 9, n.set(n + 1))
    b.event("Late", n > 7, n.set(0))
    b.invariant("Small", forall(I, n.at(I) <= 9))
    assert ask(b.program(), robots=1, rounds=5).empty == []
    bounded = ask(b.program(), robots=1, rounds=5, choice=Engine.BMC)
    assert bounded.empty == ["event Late: cannot run within 5 rounds"]


def test_what_takes_all_robots_can_happen() -> None:
    """Two robots of a kind are looked at first; where they are not enough, all are."""
    b = Build()
    total, done = b.allwrite("total", INT, 0), b.local("done", BOOL, False)
    code = b.sensor("code", INT, 0)  # runs at random do not guess it
    b.module()
    b.event("Add", ~done, b.atomic(total.set(total + 1), done.set(True)))
    b.event("All", (total >= 3) & (code * 7 + 3).eq(48_275), total.set(9))
    b.event("More", total.eq(5), total.set(6))
    b.invariant("Low", total >= 0)
    asked = ask(b.program(), robots=3, rounds=5, choice=Engine.BMC)
    assert [text.split(":")[0] for text in asked.empty] == ["event More"]


def test_what_can_never_happen_is_certain() -> None:
    b = climbing()
    z = b.local("z", INT, 0)
    b.event("Never", z < 0, z.set(0))
    b.event("Up", TRUE, z.set(z + 1))
    b.invariant("Signed", forall(I, (z.at(I) >= 0)))
    b.invariant("Odd", forall(I, (z.at(I) < 0) >> z.at(I).eq(-1)))
    asked = ask(b.program(), robots=1, rounds=3)
    assert asked.empty == ["event Never: can never run", "supposition Odd: can never come true"]
    assert asked.report.is_vacuous


def test_a_search_that_ends_makes_it_certain_too() -> None:
    b = Build()
    turn = b.local("turn", INT, 0)
    b.event("Swap", TRUE, turn.set(-turn + 2))
    b.event("Never", turn.eq(1), STOP)
    asked = ask(b.program(), robots=1, rounds=3, choice=Engine.SEARCH)
    assert asked.empty == ["event Never: can never run"]


def test_an_event_that_always_faults_is_not_said_to_be_impossible() -> None:
    """[FAULT]: it can be tried, though a run in which it is goes no further."""
    b = Build()
    x = b.local("x", INT, 1)
    b.event("Divide", TRUE, x.set(x / 0))
    asked = ask(b.program(), robots=1, rounds=2)
    assert asked.outcome("no fault") is Outcome.VIOLATED
    assert asked.empty == ["event Divide: can never run without a fault"]


def test_an_event_whose_round_cannot_end_is_told() -> None:
    """What follows an event, told as the conjunction of cases that exclude each other."""
    b = Build()
    on, level = b.actuator("on", BOOL, False), b.sensor("level", INT, 0)
    rises = level.primed.eq(level + 1)
    stays = level.primed.eq(level)
    b.module(contracts=[contract("Rises", [], [on >> (rises & stays), (~on) >> stays])])
    b.event("Start", TRUE, on.set(True))
    b.invariant("Low", forall(I, level.at(I) < 9))
    asked = ask(b.program(), robots=1, rounds=3)
    assert asked.outcome("Low") is Outcome.HOLDS
    why = "but no round in which it does can end: contracts rule it out"
    where = "robot 0 in round 1 of some run, which ends there"
    assert asked.empty == [
        f"contracts: no turn of the environment meets those of {where}",
        f"event Start: can run, {why}",
        f"supposition contract Rises: can come true, {why}",
    ]
    assert asked.report.is_vacuous


def test_summaries_that_contradict_each_other_are_told() -> None:
    b = Build()
    n, answer = bound("n", 0, INT), bound("answer", 1, INT)
    b.external("between", [n], answer, ensures=[answer > n, answer < n + 1])
    x = b.local("x", INT, 0)
    b.init(x.set(b.ask("between", 3)))
    b.event("Go", TRUE, x.set(x + 1))
    asked = ask(b.program(), robots=1, rounds=2, choice=Engine.BMC)
    assert asked.empty == ["summaries: no external functions satisfy them all"]


def test_an_invariant_that_no_event_touches_is_told() -> None:
    b = Build()
    x, limit = b.local("x", INT, 0), b.allwrite("limit", INT, 7)
    b.event("Go", x < limit, x.set(x + 1))
    b.invariant("Touched", forall(I, x.at(I) <= limit))
    b.invariant("Untouched", limit < 9)
    asked = ask(b.program(), robots=1, rounds=2)
    assert asked.empty == ["untouched Untouched: nothing that it reads changes after the start"]


def test_an_invariant_that_nothing_could_break_is_told() -> None:
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Go", x < 3, x.set(x + 1))
    b.invariant("Either", forall(I, (x.at(I) > 2) | (x.at(I) <= 2)))
    b.invariant("Same", forall(I, x.at(I).eq(x.at(I))))
    b.invariant("Follows", forall(I, (x.at(I) > 2) >> (x.at(I) > 1)))
    b.invariant("Small", forall(I, x.at(I) <= 3))
    asked = ask(b.program(), robots=2, rounds=4)
    told = "it is true whatever the events do"
    assert asked.empty == [f"untouched Either: {told}", f"untouched Same: {told}"]


def core_local(b: Build, slot: int) -> E:
    return E(core.Read(core.Place(b.kind.locals[slot].variable)))


def test_a_run_that_must_fault_is_no_matter_of_contracts() -> None:
    b = growing()
    z = b.local("z", INT, 0)
    b.kind.events.clear()
    b.event("Slip", TRUE, z.set(e(1, INT) / z), urgent=True)
    b.event("Never", z > 0, z.set(0))
    asked = ask(b.program(), robots=1, rounds=4, choice=Engine.BMC)
    assert asked.outcome("no fault") is Outcome.VIOLATED
    assert not any("contracts" in line for line in asked.empty)


def test_kinds_of_robot_that_are_not_there_have_no_idle_events() -> None:
    program = programs.two_kinds()
    asked = ask(dealt(program, 1), rounds=3)
    assert not any("Look" in line or "Climb" in line for line in asked.empty)


# --- the same every time --------------------------------------------------------------------------


@pytest.mark.parametrize("program", [programs.rover(), programs.lock_demo()], ids=lambda p: p.name)
def test_equal_seeds_give_equal_reports(program: core.Program) -> None:
    def told(seed: int) -> list[object]:
        return [
            (v.claim.name, v.outcome, v.engine, v.rounds, v.reason, v.counterexample)
            for v in ask(program, robots=2, rounds=3, seed=seed)
        ]

    assert told(3) == told(3)
    # Another seed may show another run, and says the same.
    assert [row[:2] for row in told(3)] == [row[:2] for row in told(11)]  # type: ignore[index]


#: Programs that take some engine long.
LONG = ("collections", "thermostat", "external_planner", "line_form", "sum_of_ids")


@pytest.mark.parametrize(
    "program",
    [
        pytest.param(
            p,
            id=p.name,
            marks=[pytest.mark.slow] if p.name in LONG else [],
        )
        for p in (*programs.RUNNING, late(2))
    ],
)
def test_engines_agree_on_programs_written_by_hand(program: core.Program) -> None:
    """Whoever knows says the same."""
    said: dict[str, set[Outcome]] = {}
    # The search alone would go on as long as it finds something new.
    for choice in (None, Engine.BMC, Engine.INDUCTION):
        for verdict in ask(program, robots=2, rounds=3, choice=choice):
            if verdict.outcome is not Outcome.UNKNOWN:
                said.setdefault(verdict.claim.name, set()).add(verdict.outcome)
    assert all(len(outcomes) == 1 for outcomes in said.values()), said


def test_few_likely_invariants_are_tried_before_states_are_counted() -> None:
    """With whom the lock is, which proves it for every N, need not be said."""
    text = (
        "allwrite:\n  int owner = -1\nlocal:\n  bool inside = false\n"
        "Enter:\n  pre: owner == -1\n  eff:\n    atomic:\n      owner = pid\n      inside = true\n"
        "Leave:\n  pre: inside\n  eff:\n    owner = -1\n    inside = false\n"
        "invariant Alone: forall i, j: i != j implies not (inside@i and inside@j)\n"
    )
    alone, _ = verify(of_text(text), Bounds(rounds=3)).verdicts
    assert (alone.outcome, alone.engine) == (Outcome.HOLDS, Engine.EVERY_N)
    (lemma,) = alone.lemmas
    assert Quoting.of(of_text(text).program).invariant(lemma) == (
        "forall i: inside@i implies owner != -1"
    )
