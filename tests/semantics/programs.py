"""Small core programs, each about one thing, for the tests of semantics, traces and engines."""

from __future__ import annotations

from fractions import Fraction

from koord.syntax import core
from koord.syntax.core import ListOp
from koord.syntax.faults import FaultKind
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    STRING,
    ArrayType,
    EnumType,
    ListType,
    MapType,
    QueueType,
    RecordType,
)
from tests.semantics.building import (
    BREAK,
    DELTA,
    PID,
    STOP,
    TRUE,
    TRYSTOP,
    Build,
    E,
    I,
    J,
    N,
    back,
    bound,
    contains,
    contract,
    e,
    exists,
    fold,
    for_each,
    for_range,
    forall,
    length,
    lst,
    output,
    pos,
    queue,
    rec,
    stopped,
    table,
    when,
)

MODE = EnumType("Mode", ("idle", "pick", "drop"))
TASK = RecordType("Task", (("loc", POS), ("assigned", BOOL), ("id", INT)))


def sum_of_ids() -> core.Program:
    """Each robot adds its number once, under a lock, and tells; the sum is never too large."""
    b = Build("sum_of_ids")
    total = b.allwrite("total", INT, 0)
    done = b.local("done", BOOL, False)
    b.event("Add", ~done, b.atomic(total.set(total + PID)), done.set(True), output(total))
    b.event("End", done & (total * 2).eq(N * (N - 1)), STOP)
    b.invariant("Bounded", (total * 2) <= N * (N - 1))
    b.invariant("Sure", exists(I, ~done.at(I)) | (total * 2).eq(N * (N - 1)))
    return b.program()


def counter_race() -> core.Program:
    """Everyone adds one to a shared counter without a lock: an update is lost."""
    b = Build("counter_race")
    count = b.allwrite("count", INT, 0)
    done = b.local("done", BOOL, False)
    b.event("Add", ~done, count.set(count + 1), done.set(True))
    b.invariant("Counted", forall(I, done.at(I)) >> count.eq(N))
    return b.program()


def line_form() -> core.Program:
    """Robots between the first and the last move to the middle of their neighbours."""
    b = Build("line_form")
    x = b.allread("x", FLOAT, (PID * PID).widened())
    inner = e(0, INT) < PID
    middle = (x[PID - 1] + x[PID + 1]) / 2
    b.event("Move", inner & (PID < N - 1), x[PID].set(middle))
    last = ((N - 1) * (N - 1)).widened()
    b.invariant("Hull", forall(I, (e(0, FLOAT) <= x[I]) & (x[I] <= last)))
    return b.program()


def lock_demo(*, urgent: bool = False) -> core.Program:
    """Two lock classes; ``Both`` needs the two, ``Left`` and ``Right`` one, ``Free`` none."""
    b = Build("lock_demo")
    left, right = b.allwrite("left", INT, -1), b.allwrite("right", INT, -1)
    tries, out = b.local("tries", INT, 0), b.actuator("out", INT, 0)
    b.module()
    note = (tries.set(tries + 1), out.set(tries), output(tries))
    b.event("Left", TRUE, *note, b.atomic(left.set(PID), lock=0), urgent=urgent)
    b.event("Right", TRUE, *note, b.atomic(right.set(PID), lock=1))
    both = (b.atomic(left.set(PID), lock=0), b.atomic(right.set(PID), lock=1))
    b.event("Both", TRUE, *note, *both)
    b.event("Free", TRUE, tries.set(tries + 1))
    # Which class is entered is decided on the way: nobody enters class 0 with ``tries`` above 0.
    b.event("Maybe", TRUE, when(tries.eq(0), b.atomic(left.set(PID), lock=0)), output(tries))
    return b.program()


def thermostat() -> core.Program:
    """A heater with a model: it warms by the switch, cools, and the draught is anyone's guess."""
    b = Build("thermostat")
    temp = b.sensor("temp", FLOAT, 70, "Heater")
    hours = b.sensor("hours", FLOAT, 0, "Heater")
    switch = b.actuator("switch", INT, 0, "Heater")
    warming = temp + DELTA * switch.widened() + b.choose(Fraction(-1, 10), Fraction(1, 10))
    keeps = contract("KeepsWarm", [temp >= 60, switch.eq(1)], [temp.primed >= 60])
    b.module(
        "Heater", [temp.set(warming), when(temp > 0, hours.set(hours + DELTA))], contracts=[keeps]
    )
    b.event("On", (temp < 69) & switch.eq(0), switch.set(1), urgent=True)
    b.event("Off", (temp > 71) & switch.eq(1), switch.set(0), urgent=True)
    b.invariant("Comfort", forall(I, (temp.at(I) > 60) & (temp.at(I) < 80)), at_round=True)
    return b.program()


def rover(*, contradictory: bool = False) -> core.Program:
    """A sensor without a model: it moves by one at most, and only as told."""
    b = Build("rover")
    place = b.sensor("place", INT, module="Motion")
    arrived = b.sensor("arrived", BOOL, False, module="Motion")
    goal = b.actuator("goal", INT, 0, "Motion")
    far = place.primed - place
    steps = [contract("Steady", [], [far <= 1, e(-1, INT) <= far])]
    truth = [place.primed.eq(goal) >> arrived.primed, arrived.primed >> place.primed.eq(goal)]
    steps.append(contract("Honest", [], truth))
    if contradictory:
        steps.append(contract("Never", [], [arrived.primed, ~arrived.primed]))
    b.module("Motion", contracts=steps)
    b.event("Go", arrived, goal.set(goal + 1))
    b.assume(forall(I, (e(0, INT) <= place.at(I)) & (place.at(I) < N)), "Inside")
    distinct = forall(I, forall(J, I.ne(J) >> place.at(I).ne(place.at(J))))
    b.assume(distinct, "Apart")
    return b.program()


def collections() -> core.Program:
    """Lists, queues, maps, records, arrays and enumerations in every home."""
    b = Build("collections")
    tasks = b.allwrite("tasks", ListType(TASK), _two_tasks())
    jobs = b.allwrite("jobs", QueueType(INT), queue(INT, 5, 6, 7))
    owner = b.allwrite("owner", MapType(STRING, INT), table(STRING, INT, ("a", -1)))
    mode = b.allread("mode", MODE, "idle")
    mine = b.local("mine", TASK)
    grid = b.local("grid", ArrayType(INT, 3))
    seen = b.local("seen", ListType(FLOAT), lst(FLOAT, Fraction(1, 3)))
    job = b.local("job", INT, 0)
    k, t = bound("k", 0, INT), bound("t", 1, TASK)
    b.init(grid[0].set(PID), mine.field("id").set(-1))
    b.event(
        "Take",
        mode[PID].eq(e("idle", MODE)) & (e(0, INT) < length(tasks)),
        b.atomic(
            for_each(
                t,
                tasks,
                when(
                    ~t.field("assigned"),
                    mine.set(t),
                    tasks[k].field("assigned").set(True),
                    owner[e("b", STRING)].set(PID),
                    mode[PID].set(e("pick", MODE)),
                    BREAK,
                ),
                key=k,
            )
        ),
        output(mode[PID], mine.field("id")),
        bound=2,
    )
    b.event("Pop", e(0, INT) < length(jobs), b.atomic(jobs.pop(into=job), lock=1))
    b.event(
        "Rest",
        mode[PID].eq(e("pick", MODE)),
        seen.append(Fraction(2, 3)),
        owner.remove("b"),
        mode[PID].set(e("drop", MODE)),
        output(seen, owner, mode),
        bound=2,
    )
    return b.program()


def _two_tasks() -> E:
    first = rec(TASK, pos(1, 2), False, 0)
    second = rec(TASK, pos(Fraction(1, 2), 0, 3), False, 1)
    return lst(TASK, first, second)


def stopping() -> core.Program:
    """Even robots ask to stop, odd ones stop in their third round; the rest of an effect runs."""
    b = Build("stopping")
    age = b.local("age", INT, 0)
    heat = b.sensor("heat", INT, 0)
    b.module("Unit", [heat.set(heat + 1)])
    b.event("Ask", (PID % 2).eq(0), TRYSTOP, age.set(age + 1))
    b.event("Stop", (PID % 2).eq(1) & age.eq(2), STOP, age.set(100))
    b.event("Grow", (PID % 2).eq(1) & (age < 2), age.set(age + 1))
    b.invariant("Never", ~forall(I, stopped(I)))
    return b.program()


def arithmetic() -> core.Program:
    """Integer division and remainder round down; short circuits hide faults."""
    b = Build("arithmetic")
    q, r = b.local("q", INT, 0), b.local("r", INT, 0)
    z, empty = b.local("z", INT, 0), b.local("empty", ListType(INT), lst(INT))
    b.event(
        "Divide",
        TRUE,
        q.set((PID - 3) / 2),
        r.set((PID - 3) % 2),
        when((z.ne(0)) & (q / z).eq(1), r.set(99)),
        when(z.eq(0) | empty[0].eq(1), r.set(r + 10)),
        when(z.ne(0) >> empty[0].eq(1), r.set(r + 100)),
    )
    return b.program()


def external_planner() -> core.Program:
    """A mathematical function and a fresh one, both known by their summaries."""
    b = Build("external_planner")
    n, up = bound("n", 0, INT), bound("result", 1, INT)
    b.external("above", [n], up, requires=[n >= 0], ensures=[up > n])
    m, any_ = bound("m", 0, INT), bound("result", 1, INT)
    b.external("dice", [m], any_, ensures=[any_ >= 1, any_ <= m], fresh=True)
    same = b.allread("same", INT, 0)
    roll = b.local("roll", INT, 1)
    b.event("Ask", TRUE, same[PID].set(b.ask("above", 7)), roll.set(b.ask("dice", 6)))
    agree = forall(I, forall(J, (same[I].ne(0) & same[J].ne(0)) >> same[I].eq(same[J])))
    b.invariant("Agree", agree)
    b.invariant("Pips", forall(I, (roll.at(I) >= 1) & (roll.at(I) <= 6)))
    return b.program()


def two_kinds() -> core.Program:
    """Cars and drones: other locals, ports and events, one shared store."""
    b = Build("two_kinds")
    sightings = b.allwrite("sightings", INT, 0)
    height = b.allread("height", FLOAT, 0)
    b.agent("Car")
    fuel = b.local("fuel", INT, 3)
    b.event("Drive", fuel > 0, fuel.set(fuel - 1))
    b.agent("Drone")
    name = b.local("name", STRING, "hawk")
    up = b.actuator("up", FLOAT, 0, "Rotor")
    b.module("Rotor")
    b.event("Climb", TRUE, up.set(up + DELTA), height[PID].set(up), name.set("eagle"))
    b.event("Look", height[PID] > 0, b.atomic(sightings.set(sightings + 1)))
    b.invariant("Fuel", forall(I, fuel.at(I) >= 0, core.RobotRange(0)), bound=1)
    return b.program()


def late_violation(rounds: int = 3) -> core.Program:
    """An invariant that breaks when a robot has counted that far."""
    b = Build("late_violation")
    n = b.local("n", INT, 0)
    b.event("Count", TRUE, n.set(n + 1))
    b.invariant("Small", forall(I, n.at(I) < rounds), bound=1)
    return b.program()


def fault_demo(kind: FaultKind) -> core.Program:
    """A program whose event ``Slip`` meets one kind of fault, in the robots but number 0."""
    b = Build(f"fault_{kind.name.lower()}")
    hole = b.local("hole", INT)
    x, items = b.local("x", INT, 0), b.local("items", ListType(INT), lst(INT, 4))
    names = b.local("names", MapType(INT, INT), table(INT, INT, (0, 0)))
    heat = b.sensor("heat", FLOAT, 0)
    n, up = bound("n", 0, INT), bound("result", 1, INT)
    b.external("root", [n], up, requires=[n >= 0], ensures=[up >= 0])
    model: list[core.Stmt] = []
    slip: core.Stmt
    match kind:
        case FaultKind.INDEX:
            slip = x.set(items[PID])
        case FaultKind.DIVISION:
            slip = x.set(e(1, INT) / (PID - PID))
        case FaultKind.UNSET:
            slip = x.set(hole)
        case FaultKind.KEY:
            slip = x.set(names[PID])
        case FaultKind.EMPTY:
            slip = when(e(0, INT) < fold(ListOp.MIN, lst(INT)), x.set(1))
        case FaultKind.PRECONDITION:
            slip = x.set(b.ask("root", -PID))
        case FaultKind.CHOICE:
            slip = x.set(1)
            model = [when(PID > 0, heat.set(b.choose(1, 0)))]
    b.module("Unit", model)
    b.event("Slip", PID > 0, slip)
    return b.program()


def functions() -> core.Program:
    """A function with a loop and an early return, called from a guard and an effect."""
    b = Build("functions")
    n, k = bound("n", 0, INT), bound("k", 1, INT)
    search = for_range(k, 0, 10, when((k * k) >= n, back(k)))
    b.function("ceil_root", [n], INT, search, back(-1), bound=2)
    x = b.local("x", INT, 0)
    b.event("Step", b.call("ceil_root", x) < 4, x.set(x + b.call("ceil_root", x + 1)))
    b.invariant("Low", forall(I, x.at(I) <= 20), bound=1)
    return b.program()


#: Every program here that has a run without a fault, by name.
RUNNING = (
    sum_of_ids(),
    counter_race(),
    line_form(),
    lock_demo(),
    lock_demo(urgent=True),
    thermostat(),
    rover(),
    collections(),
    stopping(),
    arithmetic(),
    external_planner(),
    two_kinds(),
    functions(),
)

__all__ = ["MODE", "RUNNING", "TASK", "contains", "output"]
