"""The rules, each seen at work in a small program and a run by hand."""

from __future__ import annotations

from fractions import Fraction
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from koord.sampling.monitors import Monitor
from koord.sampling.policies import AtRandom
from koord.semantics.configurations import NO_EVENT, Configuration
from koord.semantics.domain import Constant
from koord.semantics.recordings import Recording, Round, execute
from koord.semantics.rounds import IllegalStepError
from koord.semantics.storage import Cell
from koord.syntax import core
from koord.syntax.core import Home, ListOp
from koord.syntax.faults import FaultKind
from koord.syntax.system import Status
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    ArrayType,
    ListType,
    MapType,
    QueueType,
)
from koord.traces.names import variables
from koord.traces.trace import Numbers
from tests.loading import program_of
from tests.sampling import examples
from tests.semantics import programs
from tests.semantics.building import (
    BREAK,
    DELTA,
    PID,
    STOP,
    TRUE,
    Build,
    E,
    N,
    array,
    bound,
    contains,
    contract,
    e,
    fold,
    for_each,
    for_range,
    length,
    lst,
    output,
    pos,
    queue,
    rec,
    table,
    when,
)
from tests.semantics.driving import Drive, drive, played


def refused(rule: str) -> pytest.RaisesExc[IllegalStepError]:
    """The step is refused by that rule."""
    return pytest.RaisesExc(IllegalStepError, match=rf"\[{rule}\]")


# --- reading and writing ------------------------------------------------------------------------


def test_a_robot_reads_its_snapshot() -> None:
    """[LOOKUP] [SHARED-ASSIGN] [REFRESH]: own writes at once, others' from the next round on."""
    b = Build()
    x, seen = b.allwrite("x", INT, 0), b.local("seen", INT, -1)
    b.event("Write", TRUE, x.set(7), seen.set(x))
    b.event("Look", TRUE, seen.set(x))
    d = drive(b.program(), 2).go(0, "Write")
    assert d.own(0, "seen") == "7"
    assert (d.shared("x"), d.own(1, "x")) == ("7", "0")
    assert d.go(1, "Look").own(1, "seen") == "0"
    d.env()
    assert d.own(1, "x") == "7"
    assert d.skip(0).go(1, "Look").own(1, "seen") == "7"


def test_a_guard_is_evaluated_on_the_snapshot() -> None:
    """[SELECT] [LOOKUP]: an event that another robot's write would disable may still run."""
    b = Build()
    free = b.allwrite("free", BOOL, True)
    b.event("Take", free, free.set(False))
    d = drive(b.program(), 2).go(0, "Take")
    assert d.shared("free") == "false"
    assert d.enabled(1) == ["Take"]
    d.go(1, "Take").env()
    assert d.enabled(0) == []


def test_two_robots_write_parts_of_one_variable() -> None:
    """[SHARED-ASSIGN] [LOCATION]: locations that do not overlap both stand."""
    b = Build()
    xs = b.allwrite("xs", ListType(INT), lst(INT, 0, 0, 0))
    task = b.allwrite("task", programs.TASK, rec(programs.TASK, pos(0, 0), False, 0))
    b.event(
        "Mark",
        TRUE,
        xs[PID].set(PID + 1),
        when(PID.eq(0), task.field("id").set(5)),
        when(PID.eq(1), task.field("loc").field("y").set(2)),
    )
    d = drive(b.program(), 3).round("Mark", "Mark", "Mark")
    assert d.shared("xs") == "[1, 2, 3]"
    assert d.shared("task") == "Task(loc = (0, 2, 0), assigned = false, id = 5)"


@pytest.mark.parametrize(("order", "winner"), [((0, 1, 2), 2), ((2, 1, 0), 0), ((1, 0, 2), 2)])
def test_of_two_writers_the_later_wins(order: tuple[int, ...], winner: int) -> None:
    """[SHARED-ASSIGN] [EVENT-TRANS]: the order decides every race of the round alike."""
    b = Build()
    x, xs = b.allwrite("x", INT, -1), b.allwrite("xs", ListType(INT), lst(INT, -1))
    b.event("Write", TRUE, x.set(PID), xs[0].set(PID))
    d = drive(b.program(), 3)
    for robot in order:
        d.go(robot, "Write")
    assert d.shared("x") == str(winner)
    assert d.shared("xs") == f"[{winner}]"


def test_a_whole_write_and_a_write_below_it() -> None:
    """[LOCATION]: a write into a list that an earlier robot shortened is lost; a later one wins."""
    b = Build()
    xs = b.allwrite("xs", ListType(INT), lst(INT, 1, 2, 3))
    b.event("Cut", TRUE, xs.set(lst(INT, 9)))
    b.event("Poke", TRUE, xs[2].set(30))
    b.event("First", TRUE, xs[0].set(10))
    assert drive(b.program()).go(0, "Cut").go(1, "Poke").shared("xs") == "[9]"
    assert drive(b.program()).go(0, "Cut").go(1, "First").shared("xs") == "[10]"
    assert drive(b.program()).go(1, "Poke").go(0, "Cut").shared("xs") == "[9]"


def test_appends_of_one_round_lose_one_another() -> None:
    """[S-APPEND] [SHARED-ASSIGN]: a list operation writes the whole list."""
    b = Build()
    xs = b.allwrite("xs", ListType(INT), lst(INT))
    b.event("Add", TRUE, xs.append(PID))
    d = drive(b.program(), 3).round("Add", "Add", "Add")
    assert d.shared("xs") == "[2]"


def test_keys_of_a_map_are_locations() -> None:
    """[LOCATION]: two robots put different keys into one map; for one key the later wins."""
    b = Build()
    m = b.allwrite("m", MapType(INT, INT), table(INT, INT, (0, 0)))
    b.event("Own", TRUE, m[PID].set(PID * 10))
    b.event("Same", TRUE, m[e(7, INT)].set(PID))
    d = drive(b.program(), 3).round("Own", "Own", "Own")
    assert d.shared("m") == "{0: 0, 1: 10, 2: 20}"
    assert d.round("Same", "Same", "Own").shared("m") == "{0: 0, 1: 10, 2: 20, 7: 1}"


def test_each_robot_writes_its_own_entry() -> None:
    """[ALLREAD] [INIT]: an entry per robot, with an initial value that may use pid."""
    b = Build()
    x, other = b.allread("x", INT, PID * 100), b.local("other", INT, 0)
    b.event("Step", TRUE, x[PID].set(x[PID] + 1), other.set(x[(PID + 1) % N]))
    d = drive(b.program(), 3)
    assert d.shared("x") == "[0, 100, 200]"
    d.round("Step", "Step", "Step")
    assert d.shared("x") == "[1, 101, 201]"
    assert d.each("other") == ["100", "200", "0"]


def test_an_actuator_is_seen_by_its_robot_and_its_module() -> None:
    """[ACTUATE] [ENV-MODEL]"""
    b = Build()
    speed, x = b.actuator("speed", INT, 1), b.sensor("x", INT, 0)
    read = b.local("read", INT, 0)
    b.module("Unit", [x.set(x + speed)])
    b.event("Set", TRUE, speed.set(5), read.set(speed))
    d = drive(b.program(), 2).round("Set", None)
    assert d.each("read") == ["5", "0"]
    assert d.each("Unit.x") == ["5", "1"]


def test_init_blocks_race_like_events() -> None:
    """[INIT]: every robot starts from the declared store; the order decides who wins."""
    b = Build()
    x, mine = b.allwrite("x", INT, 3), b.local("mine", INT, 0)
    b.init(mine.set(x), x.set(PID + 10))
    assert drive(b.program(), 3, order=(0, 1, 2)).shared("x") == "12"
    d = drive(b.program(), 3, order=(2, 1, 0))
    assert (d.shared("x"), d.each("mine")) == ("10", ["3", "3", "3"])
    assert d.own(1, "x") == "10"


def test_parts_of_records_and_arrays_are_set_one_by_one() -> None:
    """[ATOM] [LOOKUP]: a place is read only if every atom below it is set."""
    b = Build()
    grid, got = b.local("grid", ArrayType(INT, 3)), b.local("got", INT, 0)
    copy = b.local("copy", ArrayType(INT, 3))
    b.event("One", TRUE, grid[1].set(5), got.set(grid[1]))
    b.event("All", TRUE, copy.set(grid))
    b.event("Size", TRUE, got.set(length(grid)))
    d = drive(b.program(), 1).round("Size")
    assert d.own(0, "got") == "3"
    d.round("One")
    assert (d.own(0, "grid"), d.own(0, "got")) == ("[unset, 5, unset]", "5")
    d.go(0, "All")
    assert d.configuration.fault is not None
    assert d.configuration.fault.kind is FaultKind.UNSET


def test_parts_of_what_a_function_declares_are_set_one_by_one() -> None:
    """[ATOM]: a bound variable without a value has every atom unset, until it is written."""
    text = """
        def fun pick(int k) -> int:
            Task t
            int[3] a
            t.id = k
            a[1] = k
            return t.id + a[1]

        def fun miss() -> int:
            int[3] a
            a[1] = 1
            return a[0]

        local:
            int n = 0

        Pick:
            pre: true
            eff: n = pick(n + 1)

        Miss:
            pre: true
            eff: n = miss()
    """
    made = program_of(text)
    d = drive(made, 1).round("Pick").round("Pick")
    assert d.own(0, "n") == "6"
    d.go(0, "Miss")
    assert d.configuration.fault is not None
    assert d.configuration.fault.kind is FaultKind.UNSET


# --- schedules ----------------------------------------------------------------------------------


def test_a_robot_has_one_turn_a_round() -> None:
    """[EVENT-TRANS] [END-EVENT] [END-PROG]"""
    d = drive(programs.late_violation(), 2).go(1, "Count")
    with refused("EVENT-TRANS"):
        d.go(1, "Count")
    assert d.configuration.turn.value == "prog"
    d.skip(0)
    assert d.configuration.turn.value == "env"
    with refused("EVENT-TRANS"):
        d.skip(0)
    assert d.env().each("n") == ["0", "1"]


def test_the_environment_waits_for_everyone() -> None:
    """[ENV-TRANS]"""
    with refused("ENV-TRANS"):
        drive(programs.late_violation(), 2).go(1, "Count").env()


def test_any_enabled_event_may_run_and_no_other() -> None:
    """[SELECT]: no priority by order; a disabled event is refused."""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("First", x.eq(0), x.set(1))
    b.event("Second", x.eq(0), x.set(2))
    b.event("Never", x.eq(9), x.set(3))
    d = drive(b.program(), 1)
    assert d.enabled(0) == ["First", "Second"]
    with refused("SELECT"):
        d.go(0, "Never")
    assert d.go(0, "Second").own(0, "x") == "2"


def test_the_loser_of_a_lock_skips_its_whole_event() -> None:
    """[ATOMIC]: no write, local, shared or to an actuator, and no output survives."""
    d = drive(programs.lock_demo(), 3).go(1, "Left")
    assert (d.shared("left"), d.output) == ("1", ["1"])
    with refused("ATOMIC"):
        d.go(0, "Left")
    d.skip(0).skip(2).env()
    assert d.each("tries") == ["0", "1", "0"]
    assert d.each("Unit.out") == ["0", "1", "0"]
    assert d.shared("left") == "1"


def test_lock_classes_are_taken_one_by_one() -> None:
    """[ATOMIC]: other classes stay free; an event that enters two needs both."""
    d = drive(programs.lock_demo(), 3).go(0, "Left").go(1, "Right")
    assert d.configuration.taken == {0, 1}
    with refused("ATOMIC"):
        d.go(2, "Both")
    d.go(2, "Free").env()
    assert d.configuration.taken == frozenset()
    d.go(2, "Both")
    assert (d.shared("left"), d.shared("right")) == ("2", "2")


def test_a_lock_is_entered_only_where_the_run_comes_by() -> None:
    """[ATOMIC] [SELECT]: an event that does not reach its atomic block does not enter."""
    d = drive(programs.lock_demo(), 2).round("Free", None)
    d.go(1, "Left").go(0, "Maybe")
    assert d.output == ["1"]


def test_an_event_that_lost_its_lock_can_be_replaced() -> None:
    """[ATOMIC] [SKIP]: the robot may run another event instead."""
    d = drive(programs.lock_demo(), 2).go(0, "Left")
    with refused("ATOMIC"):
        d.go(1, "Left")
    assert d.go(1, "Right").shared("right") == "1"


def test_an_urgent_event_may_not_be_skipped() -> None:
    """[SKIP]: unless its lock is taken."""
    d = drive(programs.lock_demo(urgent=True), 2)
    assert not d.run.may_skip(0)
    with refused("SKIP"):
        d.skip(0)
    d.go(1, "Left")
    assert d.run.may_skip(0)
    d.skip(0)


def test_urgency_ends_with_the_guard() -> None:
    """[SKIP]: an urgent event obliges only where its pre holds; another event will do too."""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Must", x < 1, x.set(x + 1), urgent=True)
    b.event("May", TRUE, x.set(5))
    d = drive(b.program(), 1)
    with refused("SKIP"):
        d.skip(0)
    d.go(0, "May").env().skip(0)
    assert d.own(0, "x") == "5"


def test_everyone_may_skip_without_urgent_events() -> None:
    """[SKIP]"""
    d = drive(programs.sum_of_ids(), 3)
    before = d.configuration
    d.round(None, None, None)
    assert d.configuration.store == before.store
    assert d.configuration.round == 1


# --- stopping and output ------------------------------------------------------------------------


def test_the_effect_goes_on_behind_stop() -> None:
    """[STOP]: the rest of the effect runs; then no event, not even an urgent one."""
    b = Build()
    x, heat = b.local("x", INT, 0), b.sensor("heat", INT, 0)
    b.module("Unit", [heat.set(heat + 1)])
    b.event("End", TRUE, STOP, x.set(9), urgent=True)
    d = drive(b.program(), 2).round("End", "End")
    assert d.each("x") == ["9", "9"]
    assert d.enabled(0) == []
    with refused("STOP"):
        d.go(0, "End")
    d.skip(0, 1).env()
    assert d.each("Unit.heat") == ["2", "2"]


def test_who_stops_has_stopped_while_others_go_on() -> None:
    """[STOP]: stopping asks nobody."""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Go", TRUE, x.set(x + 1), when(PID.eq(0), STOP))
    d = drive(b.program(), 2).round("Go", "Go")
    assert [r.status for r in d.configuration.robots] == [Status.STOPPED, Status.RUNNING]
    with refused("STOP"):
        d.go(0, "Go")
    d.round(None, "Go")
    assert d.each("x") == ["1", "2"]


def test_asking_to_stop_waits_for_everyone() -> None:
    """[STOP] [END-PROG]: robots that asked go on; all stop when the last has asked or stopped."""
    d = drive(programs.stopping(), 2).round("Ask", "Grow")
    assert [r.status for r in d.configuration.robots] == [Status.ASKED, Status.RUNNING]
    d.round("Ask", "Grow")
    assert d.own(0, "age") == "2"
    d.round("Ask", "Stop")
    assert [r.status for r in d.configuration.robots] == [Status.STOPPED, Status.STOPPED]
    assert d.own(1, "age") == "100"
    assert d.run.all_stopped


def test_output_labels_the_step() -> None:
    """[OUTPUT] [E-CONST]: values in order, with the robot's own writes of the same event."""
    d = drive(programs.collections(), 2).go(1, "Take")
    assert d.output == ["pick0"]
    d.skip(0).env().go(1, "Rest")
    assert d.output == ['[1/3, 2/3]{"a": -1}[idle, drop]']


# --- faults -------------------------------------------------------------------------------------


@pytest.mark.parametrize("numbers", Numbers)
@pytest.mark.parametrize("kind", [k for k in FaultKind if k is not FaultKind.CHOICE])
def test_every_kind_of_fault_in_an_event(kind: FaultKind, numbers: Numbers) -> None:
    """[FAULT]: the configuration names kind and robot, and has no successors."""
    d = drive(programs.fault_demo(kind), 3, numbers=numbers).skip(0)
    d.go(1, "Slip")
    fault = d.configuration.fault
    assert fault is not None
    assert (fault.kind, fault.robot) == (kind, 1)
    with refused("FAULT"):
        d.skip(2)


@pytest.mark.parametrize("numbers", Numbers)
def test_an_empty_range_to_choose_from(numbers: Numbers) -> None:
    """[CHOOSE] [FAULT]: in the environment's turn, of the robot whose port it is."""
    d = drive(programs.fault_demo(FaultKind.CHOICE), 3, numbers=numbers)
    d.round(None, None, None)
    fault = d.configuration.fault
    assert fault is not None
    assert (fault.kind, fault.robot) == (FaultKind.CHOICE, 1)


def test_a_guard_that_faults_is_a_fault_of_its_robot() -> None:
    """[SELECT] [FAULT]: the event may be selected, and that is the fault."""
    b = Build()
    hole = b.local("hole", INT)
    b.event("Look", hole > 0)
    d = drive(b.program(), 1)
    assert d.enabled(0) == ["Look"]
    d.go(0, "Look")
    assert d.configuration.fault is not None
    assert d.configuration.fault.kind is FaultKind.UNSET


def test_the_first_fault_counts() -> None:
    """[FAULT]: evaluation goes on, but the first in its order is reported."""
    b = Build()
    x, items = b.local("x", INT, 0), b.local("items", ListType(INT), lst(INT))
    b.event("Slip", TRUE, x.set(items[4]), x.set(e(1, INT) / x))
    d = drive(b.program(), 1).go(0, "Slip")
    assert d.configuration.fault is not None
    assert d.configuration.fault.kind is FaultKind.INDEX


def test_a_missing_key_may_be_written_but_not_below() -> None:
    """[S-ASSIGN] [FAULT]: KEY for a missing key that is not last, UNSET below an unset map."""
    b = Build()
    m = b.local("m", MapType(INT, POS), table(INT, POS))
    none = b.local("none", MapType(INT, POS))
    b.event("Put", TRUE, m[e(1, INT)].set(pos(0, 0)))
    b.event("Below", TRUE, m[e(2, INT)].field("x").set(1))
    b.event("Unset", TRUE, none[e(1, INT)].set(pos(0, 0)))
    assert drive(b.program(), 1).go(0, "Put").own(0, "m") == "{1: (0, 0, 0)}"
    for event, kind in (("Below", FaultKind.KEY), ("Unset", FaultKind.UNSET)):
        fault = drive(b.program(), 1).go(0, event).configuration.fault
        assert fault is not None
        assert fault.kind is kind


def test_a_fault_in_init() -> None:
    """[INIT] [FAULT]"""
    b = Build()
    x = b.local("x", INT, e(1, INT) / PID)
    b.event("Nothing", x > 0)
    fault = drive(b.program(), 2).configuration.fault
    assert fault is not None
    assert (fault.kind, fault.robot) == (FaultKind.DIVISION, 0)


# --- expressions and statements -----------------------------------------------------------------


@pytest.mark.parametrize("numbers", Numbers)
def test_integer_division_rounds_down(numbers: Numbers) -> None:
    """[E-ARITH] [E-SHORT]: floor division; the remainder has the divisor's sign; lazy operands."""
    d = drive(programs.arithmetic(), 5, numbers=numbers)
    d.round(*["Divide"] * 5)
    assert d.configuration.fault is None
    # Robots 0 to 4 divide -3, -2, -1, 0 and 1 by two; 10 and 100 are added by lazy branches.
    assert d.each("q") == ["-2", "-1", "-1", "0", "0"]
    assert d.each("r") == ["111", "110", "111", "110", "111"]


def test_what_is_not_evaluated_asks_nothing() -> None:
    """[E-SHORT] [S-IF] [RECORDING]: a right operand that is not looked at needs no answer."""
    b = Build()
    n, up = bound("n", 0, INT), bound("result", 1, INT)
    b.external("above", [n], up, ensures=[up > n])
    x, flag = b.local("x", INT, 0), b.local("flag", BOOL, False)

    def ask() -> E:
        return b.ask("above", 3).eq(4)

    b.event(
        "Go",
        ~flag | ask(),
        when(flag & ask(), x.set(1)),
        when(~flag | ask(), x.set(2), otherwise=[x.set(b.ask("above", 9))]),
        when(flag >> ask(), flag.set(False)),
    )
    d = drive(b.program(), 1).round("Go")
    assert d.own(0, "x") == "2"
    assert d.run.recording().rounds[0].answers == ()


def test_remainders_by_negative_numbers() -> None:
    """[E-ARITH]"""
    b = Build()
    r, q = b.local("r", INT, 0), b.local("q", INT, 0)
    b.event("Go", TRUE, r.set(e(7, INT) % -2), q.set(e(7, INT) / -2))
    d = drive(b.program(), 1).go(0, "Go")
    assert (d.own(0, "r"), d.own(0, "q")) == ("-1", "-4")


def test_floats_are_exact_or_doubles() -> None:
    """[DOMAIN]: a tenth, ten times, is one in ℚ and not in IEEE doubles."""
    b = Build()
    x, k, one = b.local("x", FLOAT, 0), bound("k", 0, INT), b.local("one", BOOL, False)
    loop = for_range(k, 0, 10, x.set(x + Fraction(1, 10)))
    b.event("Add", TRUE, loop, one.set(x.eq(1)), bound=1)
    assert drive(b.program(), 1).go(0, "Add").own(0, "one") == "true"
    assert drive(b.program(), 1, numbers=Numbers.DOUBLE).go(0, "Add").own(0, "one") == "false"


def test_delta_is_a_constant_of_the_run() -> None:
    """[E-CONST]"""
    b = Build()
    x, n = b.local("x", FLOAT, DELTA), b.local("n", INT, N)
    b.event("Nothing", (x > 9) & (n > 9))
    d = drive(b.program(), 4)
    assert d.each("x") == ["0.1"] * 4
    assert d.each("n") == ["4"] * 4


def test_lists_queues_and_maps() -> None:
    """[S-APPEND] [S-REMOVE] [S-POP] [E-LIST] [E-MAP]"""
    b = Build()
    xs, q = b.local("xs", ListType(INT), lst(INT, 1, 2, 1)), b.local("q", QueueType(INT))
    m, out = b.local("m", MapType(INT, BOOL)), b.local("out", INT, 0)
    b.init(q.set(queue(INT, 4, 5)), m.set(table(INT, BOOL, (3, True), (3, False), (1, True))))
    b.event("Remove", TRUE, xs.remove(1), xs.remove(8), m.remove(3), m.remove(9))
    b.event("Pop", TRUE, q.pop(out), xs.pop())
    b.event("Grow", TRUE, xs.append(out), q.append(9))
    d = drive(b.program(), 1)
    assert d.own(0, "m") == "{3: false, 1: true}"
    d.round("Remove")
    assert (d.own(0, "xs"), d.own(0, "m")) == ("[2, 1]", "{1: true}")
    d.round("Pop")
    assert (d.own(0, "q"), d.own(0, "out"), d.own(0, "xs")) == ("[5]", "4", "[2]")
    d.round("Grow")
    assert (d.own(0, "xs"), d.own(0, "q")) == ("[2, 4]", "[5, 9]")


def test_functions_of_lists() -> None:
    """[E-LIST] [E-EQUAL]"""
    b = Build()
    xs = b.local("xs", ListType(INT), lst(INT, 3, 1, 2))
    flags = b.local("flags", ListType(BOOL), lst(BOOL))
    low, high, found = b.local("low", INT, 0), b.local("high", INT, 0), b.local("found", BOOL)
    every, some = b.local("every", BOOL), b.local("some", BOOL)
    b.event(
        "Go",
        TRUE,
        low.set(fold(ListOp.MIN, xs)),
        high.set(fold(ListOp.MAX, xs)),
        found.set(contains(xs, 2) & ~contains(xs, 7)),
        every.set(fold(ListOp.ALL, flags)),
        some.set(fold(ListOp.ANY, flags)),
    )
    d = drive(b.program(), 1).go(0, "Go")
    assert [d.own(0, x) for x in ("low", "high", "found", "every", "some")] == [
        "1",
        "3",
        "true",
        "true",
        "false",
    ]


def test_loops_take_their_bounds_and_elements_once() -> None:
    """[S-FOR] [S-FOREACH] [S-BREAK]: changing the list in the body does not change the trips."""
    b = Build()
    xs = b.local("xs", ListType(INT), lst(INT, 1, 2, 3))
    k, x = bound("k", 0, INT), bound("x", 1, INT)
    total = b.local("total", INT, 0)
    b.event("Double", TRUE, for_each(x, xs, xs.append(x * 2), total.set(total + x)), bound=2)
    b.event(
        "Until",
        TRUE,
        for_each(x, xs, when(x.eq(2), BREAK), total.set(total + x), key=k),
        total.set(total + 100),
        bound=2,
    )
    b.event(
        "Range",
        TRUE,
        for_range(k, 2, 5, total.set(total + k)),
        for_range(k, 5, 2, total.set(-1)),
        bound=1,
    )
    d = drive(b.program(), 1).round("Double")
    assert (d.own(0, "xs"), d.own(0, "total")) == ("[1, 2, 3, 2, 4, 6]", "6")
    assert drive(b.program(), 1).go(0, "Until").own(0, "total") == "101"
    assert drive(b.program(), 1).go(0, "Range").own(0, "total") == "9"


def test_functions_return_out_of_loops() -> None:
    """[E-CALL] [S-RETURN]"""
    d = drive(programs.functions(), 1)
    for expected in ("1", "3", "5", "8"):
        d.round("Step")
        assert d.own(0, "x") == expected


def test_arrays_of_a_fixed_size() -> None:
    """[ATOM] [LOCATION]: a literal sets the elements that it has; elements are locations."""
    b = Build()
    xs = b.allwrite("xs", ArrayType(INT, 4), array(INT, 1, 2))
    b.event("Put", TRUE, xs[PID + 1].set(PID * 7))
    d = drive(b.program(), 2)
    assert d.shared("xs") == "[1, 2, unset, unset]"
    assert d.round("Put", "Put").shared("xs") == "[1, 0, 7, unset]"


# --- the environment ----------------------------------------------------------------------------


def test_models_read_what_was_before() -> None:
    """[ENV-MODEL]: also behind a write of the same port; ports that are not written stay."""
    b = Build()
    x, y, z = b.sensor("x", INT, 0), b.sensor("y", INT, 0), b.sensor("z", INT, 8)
    b.module("Unit", [x.set(x + 1), y.set(x)])
    b.event("Nothing", z > 9)
    d = drive(b.program(), 1).round(None).round(None)
    assert [d.own(0, f"Unit.{p}") for p in "xyz"] == ["2", "1", "8"]


@pytest.mark.parametrize("numbers", Numbers)
def test_a_model_chooses_within_its_range(numbers: Numbers) -> None:
    """[CHOOSE] [ENV-MODEL]: each robot and each turn anew."""
    d = drive(programs.thermostat(), 3, numbers=numbers)
    seen = set()
    for _ in range(10):
        before = [_temperature(d, i) for i in range(3)]
        for robot in range(3):
            events = d.enabled(robot)
            if events:
                d.go(robot, events[0])
            else:
                d.skip(robot)
        switched = [int(d.own(i, "Heater.switch")) for i in range(3)]
        d.env()
        for i in range(3):
            step = _temperature(d, i) - before[i] - Fraction(switched[i], 10)
            assert abs(step) <= Fraction(1, 10) + Fraction(1, 10**9)
            seen.add(round(float(step), 6))
    assert len(seen) > 5


def _temperature(d: Drive, robot: int) -> Fraction:
    temp = d.configuration.robots[robot].ports[0]
    assert isinstance(temp, Cell)
    assert isinstance(temp.value, float | Fraction)
    return Fraction(temp.value)


def test_readings_keep_the_contracts() -> None:
    """[ENV-FREE] [ENV-CONTRACT]: any reading that every contract allows, and no other."""
    d = drive(programs.rover(), 3)
    for _ in range(8):
        before = [int(d.own(i, "Motion.place")) for i in range(3)]
        for robot in range(3):
            events = d.enabled(robot)
            if events:
                d.go(robot, events[0])
            else:
                d.skip(robot)
        d.env()
        for i in range(3):
            place, goal = int(d.own(i, "Motion.place")), int(d.own(i, "Motion.goal"))
            assert abs(place - before[i]) <= 1
            assert (d.own(i, "Motion.arrived") == "true") == (place == goal)


def test_a_contract_whose_requirement_fails_promises_nothing() -> None:
    """[ENV-CONTRACT] [PROP-FAULT]: also where the requirement faults."""
    b = Build()
    x, none = b.sensor("x", INT, 0), b.actuator("none", INT)
    never = contract("Never", [none > 0], [x.primed.eq(4), x.primed.eq(5)])
    b.module("Unit", contracts=[never])
    d = drive(b.program(), 2).round(None, None)
    assert d.configuration.fault is None


def test_a_model_that_breaks_its_contract_is_found() -> None:
    """[PROP-CONTRACT]: contracts of modules with a model are claims."""
    b = Build()
    x = b.sensor("x", INT, 0)
    low = contract("Low", [], [x.primed < 2])
    b.module("Unit", [x.set(x + 1)], contracts=[low])
    d = drive(b.program(), 2).round(None, None)
    assert not list(d.last.stepped.promises)
    d.round(None, None)
    broken = [f"{contract.name} of {robot}" for robot, contract in d.last.stepped.promises]
    assert broken == ["Low of 0", "Low of 1"]


# --- kinds of robot -----------------------------------------------------------------------------


def test_kinds_have_their_own_variables_and_events() -> None:
    """[CONFIG]: one store for all; locals, ports and events by kind."""
    d = drive(programs.two_kinds(), 4)
    assert [d.enabled(i) for i in range(4)] == [["Drive"], ["Climb"], ["Drive"], ["Climb"]]
    assert [robot.kind for robot in d.configuration.robots] == [0, 1, 0, 1]
    d.round("Drive", "Climb", None, "Climb").round(None, "Look", None, "Climb")
    assert d.own(0, "fuel") == "2"
    assert d.own(3, "Rotor.up") == "0.2"
    assert d.shared("sightings") == "1"
    assert d.shared("height") == "[0, 0.1, 0, 0.2]"


def test_events_have_homes_for_everything() -> None:
    """[S-ASSIGN]: records, enumerations, arrays and lists in every home."""
    d = drive(programs.collections(), 2).round("Take", "Pop")
    assert d.shared("mode") == "[pick, idle]"
    assert d.shared("owner") == '{"a": -1, "b": 0}'
    assert d.shared("tasks").startswith("[Task(loc = (1, 2, 0), assigned = true, id = 0)")
    assert d.own(1, "job") == "5"
    assert d.shared("jobs") == "[6, 7]"
    assert {v.home for v in _homes(d.run.system.program)} >= {Home.LOCAL, Home.ALLWRITE}


def _homes(program: core.Program) -> set[core.Variable]:
    return set(variables(program.agents[0].events))


def test_a_round_leaves_output_of_each_robot_apart() -> None:
    """[OUTPUT]"""
    b = Build()
    b.event("Tell", TRUE, output(PID), output(PID + 1))
    d = drive(b.program(), 2).go(0, "Tell")
    assert d.output == ["0", "1"]
    assert d.go(1, "Tell").output == ["1", "2"]


# --- what the rest of the chapters says ---------------------------------------------------------


def test_parts_of_computed_values() -> None:
    """[E-SELECT] [FAULT]: elements, entries and fields of what a function or a literal gives."""
    b = Build()
    n = bound("n", 0, INT)
    twice = core.Return(lst(INT, n, n * 2).expr)
    b.function("twice", [n], ListType(INT), twice)
    x, y = b.local("x", INT, 0), b.local("y", FLOAT, 0)
    b.event("Both", TRUE, x.set(b.call("twice", 4)[1]), y.set(pos(1, 2, 3).field("z")))
    b.event("Key", TRUE, x.set(table(INT, INT, (3, 30))[e(3, INT)]))
    b.event("Far", TRUE, x.set(b.call("twice", 4)[2]))
    b.event("Below", TRUE, x.set(b.call("twice", 4)[-1]))
    b.event("NoKey", TRUE, x.set(table(INT, INT, (3, 30))[e(4, INT)]))
    d = drive(b.program(), 1).round("Both")
    assert (d.own(0, "x"), d.own(0, "y")) == ("8", "3")
    assert d.go(0, "Key").own(0, "x") == "30"
    for event, kind in (
        ("Far", FaultKind.INDEX),
        ("Below", FaultKind.INDEX),
        ("NoKey", FaultKind.KEY),
    ):
        fault = drive(b.program(), 1).go(0, event).configuration.fault
        assert fault is not None
        assert fault.kind is kind


def test_statements_run_in_order_and_branches_alone() -> None:
    """[S-SEQ] [S-IF]: the branch that is not taken has no effect, no fault and no output."""
    b = Build()
    x = b.local("x", INT, 1)
    bad = x.set(e(1, INT) / (x - x))
    b.event(
        "Go",
        TRUE,
        x.set(x + 1),
        x.set(x * 10),
        when(x.eq(20), x.set(x + 3), otherwise=[bad, output(x)]),
        when(x.eq(20), bad, output(x), otherwise=[x.set(x + 4)]),
    )
    d = drive(b.program(), 1).go(0, "Go")
    assert (d.own(0, "x"), d.output, d.configuration.fault) == ("27", [], None)


def test_a_local_is_its_robots_own() -> None:
    """[LOCAL-ASSIGN]: seen at once by the robot, by nobody else, and no write to the store."""
    b = Build()
    x, y = b.local("x", INT, 1), b.local("y", INT, 0)
    shared = b.allwrite("shared", INT, 5)
    b.event("Go", TRUE, x.set(x + PID + 1), y.set(x), when(shared > 9, shared.set(0)))
    d = drive(b.program(), 2)
    before = d.configuration.store
    d.go(1, "Go")
    assert (d.each("x"), d.each("y")) == (["1", "3"], ["0", "3"])
    assert d.configuration.store == before


def test_properties_read_the_store_and_each_robots_own() -> None:
    """[PROP-READ]: shared variables of the store, not of a copy; ``v@i`` of robot i, or a fault."""
    b = Build()
    total, x = b.allwrite("total", INT, 0), b.local("x", INT, PID * 10)
    b.event("Go", TRUE, total.set(total + 1))
    b.invariant("Shared", total.eq(0), bound=0)
    b.invariant("Own", x.at(0).eq(0) & x.at(1).eq(10), bound=0)
    b.invariant("Nobody", x.at(7).eq(0), bound=0)
    shared, own, nobody = b.properties
    d = drive(b.program(), 2)
    watch = Monitor(d.run.d, d.run.system, d.run.inputs)
    assert watch.holds(shared, d.configuration)
    d.go(0, "Go")
    assert d.own(1, "total") == "0"
    assert not watch.holds(shared, d.configuration)
    assert watch.holds(own, d.configuration)
    assert not watch.holds(nobody, d.configuration)


def test_a_faulting_event_faults_whether_or_not_it_gets_its_lock() -> None:
    """[T-FAULT] [FAULT] [ATOMIC]: whoever goes first, the fault is the robot's own."""
    b = Build()
    x = b.allwrite("x", INT, 0)
    slip = when(PID.eq(1), x.set(e(1, INT) / x), otherwise=[x.set(5)])
    b.event("Go", TRUE, b.atomic(slip))
    for order in ((0, 1), (1, 0)):
        d = drive(b.program(), 2)
        for robot in order:
            if d.configuration.fault is None:
                d.go(robot, "Go")
        fault = d.configuration.fault
        assert fault is not None
        assert (fault.kind, fault.robot) == (FaultKind.DIVISION, 1)


#: Without urgent events, and without a robot that stops because another asks (END-PROG).
FREE_TO_SKIP = [
    program
    for program in programs.RUNNING
    if not any(event.urgent for agent in program.agents for event in agent.events)
    and program.name != "stopping"
]


@pytest.mark.parametrize("program", FREE_TO_SKIP, ids=lambda p: p.name)
@given(seed=st.integers(0, 10**6), late=st.integers(0, 2))
@examples(8)
def test_a_late_message_may_be_a_skip(program: core.Program, seed: int, late: int) -> None:
    """[T-SKIP] [SKIP]: where a robot skips instead, everyone else is as before."""
    rng = Random(seed)
    _, trace = played(program, AtRandom(rng), rounds=3, rng=rng)
    rounds = trace.recording.rounds
    last = replace(rounds[-1], cut=True)
    events = tuple(None if i == late else event for i, event in enumerate(last.events))

    def end(of_last: Round) -> Configuration[Constant]:
        made = Recording(trace.recording.opening, (*rounds[:-1], of_last))
        *_, step = execute(trace.numbers.domain, trace.system, made)
        return step.configuration

    before, after = end(last), end(replace(last, events=events))
    assert after.robots[late].ran == NO_EVENT
    for i in {0, 1, 2} - {late}:
        assert after.robots[i] == before.robots[i]
    if last.events[late] is None:
        assert after == before
