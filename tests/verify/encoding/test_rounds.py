"""The round as a formula has the same outcomes as the round one turn at a time.

For each program all models of the formula are read out, and compared with all legal sequences of
turns. [T-ONE-WINNER] [T-PREFIX] [T-COMMIT] [SHARED-ASSIGN]
"""

from __future__ import annotations

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from koord.semantics.storage import Cell
from koord.syntax import core
from koord.syntax.system import System, dealt
from koord.syntax.types import BOOL, FLOAT, INT, ArrayType, ListType, MapType, QueueType, RecordType
from koord.verify.encoding.rounds import Encoder
from koord.verify.encoding.terms import Terms
from koord.verify.encoding.unknowns import Unknowns
from koord.verify.encoding.unrolling import Unrolling
from tests.semantics import programs
from tests.semantics.building import (
    PID,
    STOP,
    TRUE,
    TRYSTOP,
    Build,
    I,
    N,
    array,
    bound,
    exists,
    for_range,
    forall,
    length,
    lst,
    queue,
    ran,
    rec,
    stopped,
    table,
    when,
)
from tests.verify.asking import bounded
from tests.verify.models import (
    anywhere,
    anywhere_by_formula,
    ends,
    ends_by_formula,
    starts,
    starts_by_formula,
)

PAIR = RecordType("Pair", (("a", INT), ("b", INT)))
NESTED = RecordType("Nested", (("pair", PAIR), ("c", BOOL)))
HOLDER = RecordType("Holder", (("items", ListType(INT)), ("flag", BOOL)))

Racing = Callable[[Build], None]


def scalar(b: Build) -> None:
    x = b.allwrite("x", INT, 0)
    b.event("Mine", TRUE, x.set(PID + 1))
    b.event("Twice", TRUE, x.set(PID * 10), x.set(x + 100))


def unset_scalar(b: Build) -> None:
    x = b.allwrite("x", FLOAT)
    b.event("Mine", TRUE, x.set(PID.widened()))


def record(b: Build) -> None:
    x = b.allwrite("x", NESTED, rec(NESTED, rec(PAIR, 0, 0), False))
    b.event("Whole", PID.eq(0), x.set(rec(NESTED, rec(PAIR, 1, 1), True)))
    b.event("Half", PID.eq(1), x.field("pair").set(rec(PAIR, 2, 2)))
    b.event("Leaf", PID.eq(2), x.field("pair").field("b").set(3))


def arrays(b: Build) -> None:
    x = b.allwrite("x", ArrayType(PAIR, 2), array(PAIR, rec(PAIR, 0, 0), rec(PAIR, 0, 0)))
    b.event("Row", PID.eq(0), x[1].set(rec(PAIR, 1, 1)))
    b.event("Leaf", PID.eq(1), x[x[0].field("a")].field("b").set(2))
    b.event("All", PID.eq(2), for_range(K, 0, 2, x[K].field("b").set(K + 7)), bound=1)


def lists(b: Build) -> None:
    x = b.allwrite("x", ListType(INT), lst(INT, 1, 2))
    b.event("Shrink", PID.eq(0), x.set(lst(INT, 9)))
    b.event("Second", PID.eq(1), x[1].set(5))
    b.event("Grow", PID.eq(2), x.append(7))
    b.event("First", PID.eq(1), x[0].set(6), when(x[1].eq(2), x.append(8)))


def lists_of_records(b: Build) -> None:
    x = b.allwrite("x", ListType(PAIR), lst(PAIR, rec(PAIR, 0, 0), rec(PAIR, 0, 0)))
    b.event("Field", PID.eq(0), x[1].field("a").set(1))
    b.event("Element", PID.eq(1), x[1].set(rec(PAIR, 2, 2)))
    b.event("Pop", PID.eq(2), x.pop())


def lists_in_records(b: Build) -> None:
    x = b.allwrite("x", HOLDER, rec(HOLDER, lst(INT, 1, 2), False))
    b.event("Flag", PID.eq(0), x.field("flag").set(True), x.field("items")[0].set(3))
    b.event("Items", PID.eq(1), x.field("items").remove(1))
    b.event("Whole", PID.eq(2), x.set(rec(HOLDER, lst(INT, 4), False)))


def nested_lists(b: Build) -> None:
    x = b.allwrite("x", ListType(ListType(INT)), lst(ListType(INT), lst(INT, 1), lst(INT, 2, 3)))
    b.event("Inner", PID.eq(0), x[1][1].set(4))
    b.event("Shorter", PID.eq(1), x[1].set(lst(INT, 5)))
    b.event("Outer", PID.eq(2), x.set(lst(ListType(INT), lst(INT, 6))))


def queues(b: Build) -> None:
    x, taken = b.allwrite("x", QueueType(INT), queue(INT, 1, 2)), b.local("taken", INT, 0)
    b.event("Pop", PID < 2, x.pop(into=taken))
    b.event("Push", PID.eq(2), x.append(9))


def maps(b: Build) -> None:
    x = b.allwrite("x", MapType(INT, PAIR), table(INT, PAIR, (0, rec(PAIR, 0, 0))))
    b.event("Entry", PID.eq(0), x[0].field("a").set(1))
    b.event("Put", PID.eq(1), x[0].set(rec(PAIR, 2, 2)), x[1].set(rec(PAIR, 3, 3)))
    b.event("Add", PID.eq(2), x[2].set(rec(PAIR, 4, 4)))
    b.event("Gone", PID.eq(0), x.remove(0))


def conditional(b: Build) -> None:
    x, y = b.allwrite("x", INT, 0), b.allwrite("y", INT, 0)
    b.event("Either", TRUE, when(x.eq(PID), x.set(PID + 1), otherwise=(y.set(PID + 1),)))


def mixed(b: Build) -> None:
    """Written inside of ``atomic`` by one event and outside by another."""
    x = b.allwrite("x", INT, 0)
    b.event("Locked", PID < 2, b.atomic(x.set(PID + 1)))
    b.event("Free", PID > 0, x.set(PID + 10))


K = bound("k", 0, INT)

SHAPES: tuple[Racing, ...] = (
    scalar,
    unset_scalar,
    record,
    arrays,
    lists,
    lists_of_records,
    lists_in_records,
    nested_lists,
    queues,
    maps,
    conditional,
    mixed,
)


def built(make: Racing) -> core.Program:
    b = Build(make.__name__)
    make(b)
    return b.program()


@pytest.mark.parametrize("shape", SHAPES, ids=lambda f: f.__name__)
def test_races_end_as_some_order_ends_them(shape: Racing) -> None:
    """[SHARED-ASSIGN]: for every shape of variable, all orders of three robots and no others."""
    system = dealt(built(shape), 3)
    found = ends_by_formula(system)
    assert found == ends(system)
    assert len(found) > 3


def test_a_race_after_a_round_is_decided_anew() -> None:
    b = Build()
    x, seen = b.allwrite("x", INT, -1), b.local("seen", INT, -1)
    b.event("Mine", TRUE, seen.set(x), x.set(PID))
    # Robot 0 may win the first round and robot 1 the second.
    both = seen.at(0).eq(0) & seen.at(1).eq(0) & x.eq(1)
    b.invariant("Never", ~both)
    assert bounded(b.program(), rounds=3).rounds["Never"] == 2


@pytest.mark.parametrize("urgent", [False, True])
def test_one_robot_per_lock_class(urgent: bool) -> None:
    """[ATOMIC] [T-ONE-WINNER]: two classes, events that enter one, both, none, or one by chance."""
    system = dealt(programs.lock_demo(urgent=urgent), 2)
    assert ends_by_formula(system) == ends(system)
    assert anywhere_by_formula(system) == anywhere(system)


def test_who_loses_a_lock_has_done_nothing() -> None:
    b = Build()
    x, out = b.allwrite("x", INT, 0), b.actuator("out", INT, 0)
    b.module()
    mine, y = b.local("mine", INT, 0), b.allread("y", INT, 0)
    leave = (mine.set(1), out.set(1), y[PID].set(1), STOP)
    b.event("Take", TRUE, *leave, b.atomic(x.set(x + 1)))
    b.invariant("Alone", ~(mine.at(0).eq(1) & mine.at(1).eq(1)) | (x > 1))
    b.invariant("Count", forall(I, stopped(I)) >> x.eq(N))
    system = dealt(b.program(), 2)
    assert ends_by_formula(system) == ends(system)
    assert bounded(system, rounds=3).rounds == {}


def test_a_lock_is_entered_on_the_way_only() -> None:
    """[ATOMIC]: who takes the branch without the block does not enter its class."""
    b = Build()
    x, ways = b.allwrite("x", INT, 0), b.local("ways", INT, 0)
    b.event("Maybe", TRUE, ways.set(1), when(PID.eq(0), b.atomic(x.set(1))))
    b.invariant("NotAll", exists(I, ways.at(I).eq(0)))
    assert bounded(b.program(), robots=3, rounds=1).rounds == {"NotAll": 1}


def stoppers(*, urgent: bool) -> core.Program:
    b = Build("stoppers")
    x = b.local("x", INT, 0)
    b.event("Ask", PID < 2, TRYSTOP, x.set(x + 1), urgent=urgent)
    b.event("Stop", PID > 0, STOP, x.set(x + 10))
    b.invariant("Looks", exists(I, ~stopped(I)))
    return b.program()


@pytest.mark.parametrize("urgent", [False, True])
@pytest.mark.parametrize("robots", [1, 2, 3])
def test_stopping_shows_where_it_should(robots: int, urgent: bool) -> None:
    """[STOP] [END-PROG] [T-PREFIX]: asked robots stop at the end, before which others see it."""
    system = dealt(stoppers(urgent=urgent), robots)
    assert ends_by_formula(system) == ends(system)
    assert anywhere_by_formula(system) == anywhere(system)


def test_stopped_robots_run_nothing_and_need_not() -> None:
    """[STOP] [SKIP]: not even urgent events."""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Once", TRUE, STOP, x.set(x + 1), urgent=True)
    b.invariant("Once", forall(I, x.at(I) <= 1))
    b.invariant("Ran", forall(I, stopped(I)) >> forall(I, x.at(I).eq(1)))
    assert bounded(b.program(), rounds=4).rounds == {}


def test_an_urgent_event_waits_for_a_lock_only() -> None:
    """[SKIP]: nobody skips while an urgent event's classes are free."""
    b = Build()
    x, late = b.allwrite("x", INT, 0), b.local("late", INT, 0)
    b.event("Go", late.eq(0), late.set(1), b.atomic(x.set(x + 1)), urgent=True)
    b.invariant("Soon", x.eq(0) | x.eq(1) | x.eq(2), at_round=True)
    b.invariant("Busy", exists(I, ran(0, I)) | x.eq(0) | x.eq(3), at_round=True)
    system = dealt(b.program(), 3)
    assert ends_by_formula(system) == ends(system)
    assert anywhere_by_formula(system) == anywhere(system)
    # Exactly one gets through per round, so there are three after the third.
    assert bounded(system, rounds=3).rounds == {"Soon": 3}


def test_what_is_seen_when_somebody_has_skipped_and_nobody_run() -> None:
    """[T-PREFIX] [PROP-RAN]: the first turn of a round clears every ``ran``, be it a skip."""
    b = Build()
    b.agent("Idle")
    b.agent("Busy")
    x = b.local("x", INT, 0)
    b.event("Go", TRUE, x.set(1), urgent=True)
    b.invariant("Ran", forall(I, x.at(I).eq(1) >> ran(0, I, kind=1), core.RobotRange(1)))
    checked = bounded(System(b.program(), (0, 1)), rounds=3)
    assert checked.rounds == {"Ran": 2}
    assert checked.violated["Ran"].recording.rounds[-1].order == (0,)
    # A robot that is alone ends the round by its turn.
    assert bounded(System(b.program(), (1,)), rounds=3).rounds == {}
    # Where nobody may skip, somebody has run.
    b.properties.clear()
    busy = core.RobotRange(1)
    b.invariant("Some", exists(I, x.at(I).eq(1), busy) >> exists(I, ran(0, I, kind=1)))
    assert bounded(System(b.program(), (1, 1)), rounds=3).rounds == {}
    assert bounded(System(b.program(), (1, 0)), rounds=3).rounds == {"Some": 2}


def test_nobody_skips_by_an_answer_that_cannot_be() -> None:
    """[SKIP] [EXTERNAL]: an urgent guard obliges if it holds for all answers of the summary."""
    b = Build()
    n, result = bound("n", 0, INT), bound("result", 1, INT)
    b.external("dice", [n], result, ensures=[result >= 1, result <= n], fresh=True)
    age, x = b.sensor("age", INT, 0), b.local("x", INT, 0)
    b.module("Unit", [age.set(age + 1)])
    guard = b.ask("dice", 6)
    b.event("Go", guard >= 1, x.set(1), urgent=True)
    b.invariant("Gone", forall(I, (age.at(I) > 0) >> x.at(I).eq(1)))
    assert bounded(b.program(), robots=1, rounds=3).rounds == {}
    # With a guard that some answer denies, it may skip.
    b.kind.events.clear()
    b.event("Go", guard >= 2, x.set(1), urgent=True)
    assert bounded(b.program(), robots=1, rounds=3).rounds == {"Gone": 1}


def test_a_racing_init_ends_as_some_order_ends_it() -> None:
    """[INIT]: nobody skips, ``atomic`` excludes nobody, races are decided by the order."""
    b = Build()
    x, y = b.allwrite("x", INT, -1), b.allwrite("y", ListType(INT), lst(INT))
    z = b.allread("z", INT, PID * 2)
    mine = b.local("mine", INT, 0)
    b.init(b.atomic(x.set(PID)), y.append(PID), mine.set(length(y)), when(PID > 0, z[PID].set(x)))
    b.event("Go", TRUE, mine.set(x))
    system = dealt(b.program(), 3)
    found = starts_by_formula(system)
    assert found == starts(system)
    assert len(found) == 3


def test_an_init_in_which_one_robot_writes_has_one_end() -> None:
    b = Build()
    x = b.allwrite("x", INT, -1)
    b.init(when(PID.eq(1), x.set(PID)))
    system = dealt(b.program(), 3)
    assert starts_by_formula(system) == starts(system)
    assert len(starts(system)) == 1


def test_programs_written_by_hand() -> None:
    closed = (
        programs.sum_of_ids(),
        programs.counter_race(),
        programs.line_form(),
        programs.arithmetic(),
        programs.functions(),
        programs.collections(),
        programs.late_violation(),
    )
    for program in closed:
        system = dealt(program, 3)
        assert anywhere_by_formula(system) == anywhere(system), program.name


def test_without_races_there_is_no_order() -> None:
    """[T-COMMIT]: unknowns for an order stand in the formula only where it matters."""
    for program, ordered in ((programs.sum_of_ids(), False), (programs.counter_race(), True)):
        system = dealt(program, 4)
        unrolling = Unrolling(system)
        start = unrolling.opening.moment.configuration
        assert bool(unrolling.encoder.round(start, "0").before) is ordered


def test_the_formula_grows_with_the_robots_and_not_with_their_orders() -> None:
    """[T-COMMIT]: O(N · program) where nothing races; at most quadratic with races."""

    def size(program: core.Program, robots: int) -> int:
        unrolling = Unrolling(dealt(program, robots))
        encoder = Encoder(unrolling.system, Unknowns(Terms(), program, robots))
        taken = encoder.round(unrolling.opening.moment.configuration, "0")
        return len(taken.options) + len(taken.before)

    assert [size(programs.sum_of_ids(), n) for n in (2, 4, 8)] == [2, 4, 8]
    assert [size(programs.counter_race(), n) for n in (2, 4, 8)] == [2 + 1, 4 + 6, 8 + 28]


def test_what_every_robot_writes_in_init_is_known_to_be_set() -> None:
    """[INIT] [ATOM]: scalars, lists and maps alike, whoever comes last."""
    b = Build()
    x, xs = b.allwrite("x", INT), b.allwrite("xs", ListType(INT))
    some = b.allwrite("some", INT)
    b.init(x.set(PID), xs.set(lst(INT, 1, 2)), when(PID.eq(0), some.set(3)))
    b.event("Go", TRUE, STOP)
    store = Unrolling(dealt(b.program(), 3)).opening.moment.configuration.store
    flags = [cell.is_set for cell in store.allwrite if isinstance(cell, Cell)]
    assert flags == [True, True, True]


def test_heterogeneous_robots_have_their_own_events_and_one_store() -> None:
    b = Build("kinds")
    x = b.allwrite("x", INT, 0)
    b.agent("Adder")
    n = b.local("n", INT, 0)
    b.event("Add", TRUE, x.set(x + 1), n.set(1))
    b.agent("Doubler")
    m, flag = b.local("m", INT, 5), b.local("flag", BOOL, False)
    b.event("Idle", ~flag, flag.set(True))
    b.event("Double", TRUE, x.set(x * 2 + 10), m.set(m + 1), urgent=True)
    for kinds in ((0, 1), (1, 0), (1, 1, 0)):
        system = replace(dealt(b.program(), len(kinds)), kinds=kinds)
        assert ends_by_formula(system) == ends(system)
        assert anywhere_by_formula(system) == anywhere(system)
