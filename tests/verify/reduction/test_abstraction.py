"""Values that merely flow become opaque; what is found so is true of real values, or is dropped."""

from __future__ import annotations

import pytest

from koord.semantics.domain import EXACT
from koord.semantics.recordings import Recording, execute
from koord.semantics.values import Rec, Seq
from koord.syntax import core
from koord.syntax.system import dealt
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    ListType,
    MapType,
    OpaqueType,
    QueueType,
    RecordType,
    Type,
)
from koord.syntax.walk import nodes
from koord.verify.bounded_check import BoundedCheck
from koord.verify.claims import Claim, ClaimPhase, claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.reduction.abstraction import abstracted
from koord.verify.reduction.problems import Concretion
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Counterexample, Outcome
from koord.verify.witness import replayed
from tests.semantics import programs
from tests.semantics.building import (
    PID,
    TRUE,
    Build,
    E,
    I,
    J,
    bound,
    contains,
    e,
    for_each,
    forall,
    length,
    lst,
    pos,
    rec,
    when,
)
from tests.verify.asking import ask

PATH = ListType(POS)
P, Q = bound("p", 0, POS), bound("q", 1, POS)
A, B = bound("a", 0, PATH), bound("b", 1, PATH)


def planner(*, locked: bool = True) -> Build:
    """Robots plan ways to a goal; one that is clear of the others' becomes a robot's route."""
    b = Build("planner")
    b.external("plan", [P, Q], bound("result", 2, PATH), fresh=True)
    clear = bound("result", 2, BOOL)
    b.external("clear", [A, B], clear)
    symmetric = core.ExternalCall("clear", (B.expr, A.expr), BOOL, b.site())
    promise = core.Binary(core.BinaryOp.EQ, clear.expr, symmetric, BOOL)
    kind = core.ExternalKind.FUNCTION
    parameters = (A.place.variable, B.place.variable)
    b.externals[1] = core.External(
        "clear", parameters, clear.place.variable, kind, (), (promise,), 3
    )
    route = b.allread("route", PATH, core.Start.ARBITRARY)
    moving, turn = b.allread("moving", BOOL, False), b.allwrite("turn", INT, 0)
    here, way = b.local("here", POS, pos(0, 0)), b.local("way", PATH, lst(POS))
    other = bound("other", 0, INT)
    free = forall(other, other.ne(PID) >> (~moving[other] | b.ask("clear", route[other], way)))
    take = (route[PID].set(way), moving[PID].set(True), turn.set(turn + 1))
    b.event("Plan", ~moving[PID], way.set(b.ask("plan", here, here)))
    effect = (b.atomic(when(free, *take)),) if locked else (when(free, *take[:2]),)
    b.event("Take", ~moving[PID], *effect, bound=1)
    both = moving[I] & moving[J] & I.ne(J)
    b.invariant("Apart", forall(I, forall(J, both >> b.ask("clear", route[I], route[J]))))
    return b


def hidden(b: Build) -> set[Type]:
    found = abstracted(b.program())
    return set(found.hidden.values()) if found is not None else set()


# --- which types flow -----------------------------------------------------------------------------


def test_what_only_external_functions_look_into_flows() -> None:
    assert hidden(planner()) == {POS, PATH}


def test_without_an_external_function_there_is_nothing_to_gain() -> None:
    assert abstracted(programs.collections()) is None
    b = planner()
    b.externals.clear()
    b.kind.events.clear()
    b.properties.clear()
    assert abstracted(b.program()) is None


def test_what_is_taken_apart_does_not_flow() -> None:
    """By a field, a loop, an element test, a list operation; an index and a length observe."""
    for number in range(8):
        b = planner()
        here, way = (E(core.Read(core.Place(x.variable))) for x in b.kind.locals)
        place, n = b.local("place", POS, pos(0, 0)), b.local("n", INT, 0)
        x = b.local("x", FLOAT, 0)
        effect = [
            x.set(here.field("x")),
            place.set(way[0]),
            n.set(length(way)),
            for_each(bound("step", 0, POS), way, n.set(n + 1)),
            when(contains(way, here), n.set(1)),
            way.append(here),
            way.pop(),
            here.field("y").set(1),
        ][number]
        b.event("Look", TRUE, effect, bound=1)
        found = hidden(b)
        if number in (0, 7):
            assert found == {PATH}, number
        elif number in (1, 2):
            assert found == {POS, PATH}, number
        else:
            assert found == {POS}, number


def test_what_a_callers_duty_looks_into_does_not_flow() -> None:
    """A promise may be dropped: then more can happen. A duty may not."""
    b = planner()
    some = e(0, INT) < length(A)
    b.external("follow", [A], bound("result", 1, BOOL), requires=[some])
    assert hidden(b) == {POS}
    b = planner()
    b.external("follow", [A], bound("result", 1, BOOL), ensures=[some])
    assert hidden(b) == {POS, PATH}
    found = abstracted(b.program())
    assert found is not None
    assert found.program.external("follow").ensures == ()
    # What says nothing about the inside is kept.
    assert len(found.program.external("clear").ensures) == 1


def test_no_hidden_type_is_left_in_the_abstraction() -> None:
    found = abstracted(planner().program())
    assert found is not None
    types = [getattr(node, "type", None) for node in nodes(found.program)]
    assert not {POS, PATH} & {t for t in types if isinstance(t, RecordType | ListType)}
    assert not any(
        isinstance(node, core.MakeList | core.MakeRecord) and node.type in (POS, PATH)
        for node in nodes(found.program)
    )


def test_types_stay_apart() -> None:
    """Two records of one shape are two sorts; containers of hidden types stay containers."""
    one = RecordType("One", (("n", INT),))
    two = RecordType("Two", (("n", INT),))
    b = Build()
    u, v = bound("u", 0, one), bound("v", 1, two)
    b.external("mix", [u, v], bound("result", 2, BOOL))
    x, y = b.local("x", one, rec(one, 1)), b.local("y", two, rec(two, 1))
    queue = b.local("queue", QueueType(one), E(core.MakeList((), QueueType(one))))
    names = b.local("names", MapType(INT, two), E(core.MakeMap((), MapType(INT, two))))
    b.event("Go", b.ask("mix", x, y), queue.append(x), names[3].set(y))
    found = abstracted(b.program())
    assert found is not None
    sorts = {t.name: t for t in found.hidden.values() if isinstance(t, RecordType)}
    assert sorts == {"One": one, "Two": two}
    assert len(found.hidden) == 2
    (agent,) = found.program.agents
    kinds = [entry.variable.type for entry in agent.locals]
    assert kinds[2:] == [QueueType(OpaqueType("One")), MapType(INT, OpaqueType("Two"))]
    assert kinds[0] != kinds[1]


# --- verdicts -------------------------------------------------------------------------------------


@pytest.mark.parametrize("choice", [None, Engine.INDUCTION, Engine.BMC])
def test_what_holds_of_opaque_values_holds(choice: Engine | None) -> None:
    asked = ask(planner().program(), robots=3, rounds=3, choice=choice)
    assert asked.outcome("Apart") is Outcome.HOLDS


@pytest.mark.parametrize("choice", [None, Engine.BMC])
def test_a_violation_is_shown_with_real_values(choice: Engine | None) -> None:
    """[REPLAY]: of the program itself, not of its abstraction."""
    system = dealt(planner(locked=False).program(), 3)
    shown = ask(system, rounds=3, choice=choice)["Apart"].counterexample
    assert shown is not None
    steps = list(execute(EXACT, system, shown.recording))
    routes = [answer for round_ in shown.recording.rounds for answer in round_.answers]
    assert steps[-1].configuration.fault is None
    paths = [answer.value for answer in routes if answer.function == "plan"]
    assert paths
    assert all(isinstance(path, Seq) for path in paths)


def made_of_parts() -> Build:
    """Two records that are not equal, though a function of their parts might be."""
    b = Build("parts")
    b.external("near", [P], bound("result", 1, BOOL))
    here, flag = b.local("here", POS, pos(0, 0)), b.local("flag", BOOL, False)
    b.event("Go", here.eq(pos(1, 0)) & b.ask("near", here), flag.set(True))
    b.invariant("Never", forall(I, ~flag.at(I)))
    return b


@pytest.mark.slow
def test_records_made_of_parts_are_told_apart_after_all() -> None:
    """Of a record that is made nothing is known but its parts: the replay knows more."""
    assert hidden(made_of_parts()) == {POS}
    for choice in (Engine.BMC, None):
        asked = ask(made_of_parts().program(), rounds=2, choice=choice)
        assert asked.outcome("Never") is Outcome.HOLDS


@pytest.mark.slow
def test_only_what_is_open_is_asked_again_of_real_values() -> None:
    """What opaque values settled stays settled, and the suspected round is looked at first."""
    b = made_of_parts()
    n = b.local("n", INT, 0)
    b.event("Count", n < 1, n.set(n + 1))
    b.invariant("Low", forall(I, n.at(I) < 1))
    told: list[str] = []
    report = verify(dealt(b.program(), 2), Bounds(2), progress=told.append)
    outcomes = {verdict.claim.name: verdict.outcome for verdict in report.verdicts}
    assert (outcomes["Low"], outcomes["Never"]) == (Outcome.VIOLATED, Outcome.HOLDS)
    last = max(i for i, text in enumerate(told) if "Spacer" in text)
    of_rounds = [text for text in told[last + 1 :] if "Never: bmc" in text]
    assert of_rounds[0].endswith("Never: bmc, round 0 of 2; violated: Low"), told[last:]
    assert all(text.endswith("; violated: Low") for text in told[last:])


@pytest.mark.slow
def test_a_dropped_promise_is_kept_after_all() -> None:
    """[EXTERNAL]: answers are chosen such that the whole summary holds, or are none."""
    b = Build("steps")
    result = bound("result", 1, POS)
    b.external("next", [P], result, ensures=[result.field("x") > P.field("x")], fresh=True)
    here = b.local("here", POS, pos(0, 0))
    never = b.local("never", BOOL, False)
    b.event("Back", b.ask("next", here).eq(here), never.set(True))
    b.invariant("NoStep", forall(I, ~never.at(I)))
    assert abstracted(b.program()) is not None
    for choice in (Engine.BMC, None):
        assert ask(b.program(), robots=1, rounds=2, choice=choice).outcome("NoStep") is (
            Outcome.HOLDS
        )


def paths(goal: E, route: E | core.Start) -> core.Program:
    """Robots plan paths, and count them; a path begins and ends where it should."""
    b = Build("paths")
    way = bound("result", 2, PATH)
    ends = [
        e(1, INT) < length(way),
        E(core.Select(way.expr, core.IndexStep(core.Const(0, INT), POS))).eq(P),
    ]
    last = core.Binary(core.BinaryOp.SUB, length(way).expr, core.Const(1, INT), INT)
    ends.append(E(core.Select(way.expr, core.IndexStep(last, POS))).eq(Q))
    b.external("plan", [P, Q], way, ensures=ends, fresh=True)
    taken, n = b.local("route", PATH, route), b.local("n", INT, 0)
    here, there = b.local("here", POS, pos(0, 0)), b.local("goal", POS, goal)
    b.event("Plan", n < 3, taken.set(b.ask("plan", here, there)), n.set(n + 1))
    b.invariant("Two", forall(I, n.at(I) < 2))
    return b.program()


def test_a_promise_can_be_kept_by_an_answer_that_is_made_up() -> None:
    """[EXTERNAL]: a path that begins and ends where it should."""
    program = paths(pos(5, 0), lst(POS))
    found = abstracted(program)
    assert found is not None
    assert PATH in found.hidden.values()
    shown = ask(program, robots=1, rounds=3, choice=Engine.BMC)["Two"].counterexample
    assert shown is not None
    for round_ in shown.recording.rounds:
        (answer,) = round_.answers
        assert isinstance(answer.value, Seq)
        assert answer.value.items[0] == Rec((0, 0, 0))
        assert answer.value.items[-1] == Rec((5, 0, 0))


def test_such_an_answer_replays_without_asking_about_the_program_itself() -> None:
    """[EXTERNAL] [REPLAY]"""
    program = paths(pos(0, 0), core.Start.UNSET)
    abstraction = abstracted(program)
    assert abstraction is not None
    abstract, real = dealt(abstraction.program, 1), dealt(program, 1)

    def judge(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
        made = Concretion(abstraction, real).recording(recording)
        return replayed(real, made, claims_of(real)[0], phase)

    check = BoundedCheck(abstract, judge)
    claim = claims_of(abstract)[0]
    found = check.check([claim], (), 3, Deadline())
    assert not check.unreplayed
    assert found[claim].outcome is Outcome.VIOLATED


def test_equal_opaque_values_stay_equal() -> None:
    """What the program compared must come out alike."""
    b = Build("twice")
    b.external("pick", [P], bound("result", 1, POS), fresh=True)
    here, n = b.local("here", POS, pos(0, 0)), b.local("n", INT, 0)
    before = b.local("before", POS, pos(0, 0))
    b.event("Pick", TRUE, before.set(here), here.set(b.ask("pick", here)))
    b.event("Same", here.eq(before) & here.ne(pos(0, 0)), n.set(n + 1))
    b.invariant("Never", forall(I, n.at(I).eq(0)))
    shown = ask(b.program(), robots=1, rounds=4, choice=Engine.BMC)["Never"].counterexample
    assert shown is not None
    assert shown.round == 3


def test_a_concretion_that_is_no_run_is_no_counterexample() -> None:
    """[REPLAY]: the abstraction has a candidate; its translation is of real values, and no run."""
    program = made_of_parts().program()
    abstraction = abstracted(program)
    assert abstraction is not None
    abstract, real = dealt(abstraction.program, 2), dealt(program, 2)
    told: list[Recording] = []

    def judge(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
        told.append(Concretion(abstraction, real).recording(recording))
        return replayed(real, told[-1], claims_of(real)[0], phase)

    check = BoundedCheck(abstract, judge)
    (claim, _) = claims_of(abstract)
    assert check.check([claim], (), 1, Deadline()) == {}
    assert claim in check.unreplayed
    arguments = [a.arguments for a in told[0].rounds[0].answers]
    assert arguments
    assert all(isinstance(argument, Rec) for (argument,) in arguments)
