"""Properties, assumptions, starts; files of properties; several kinds of robot."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.syntax import core
from koord.syntax.elaboration import Elaborated, Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.types import BOOL, FLOAT, INT
from koord.syntax.walk import nodes
from tests.syntax.elaborating import codes, errors, only, program

ABOVE = """
    using Motion
    local:
      int n = 0
      bool done = false
      int[] mine = []
    allread:
      int[] level
      pos[] x
    allwrite:
      int total = 0
      int[] list = []
    Go:
      eff: n = total + length(list) + length(mine)
           level[pid] = n
           done = Motion.reached
           x[pid] = Motion.psn
"""


def condition(text: str) -> core.Expr:
    """The condition of an invariant."""
    return program(f"{ABOVE}\n    invariant: {text}\n").properties[0].condition


def test_a_bare_local_is_that_of_every_robot() -> None:
    closed = condition("n >= 0 and not done and Motion.reached")
    assert isinstance(closed, core.Quantified)
    assert closed.quantifier is core.QuantifierKind.FORALL
    assert closed.domain == core.RobotRange()
    assert closed.variable.name == "pid"
    assert closed.body == _robot_zero(condition("forall i: n@i >= 0 and not done@i and reached@i"))


def _robot_zero(expr: core.Expr) -> core.Expr:
    """The body of ``forall i``, with ``i`` called ``pid``."""
    assert isinstance(expr, core.Quantified)
    return _renamed(expr.body, expr.variable, core.Variable(core.Home.BOUND, 0, "pid", INT))


def _renamed(expr: core.Expr, old: core.Variable, new: core.Variable) -> core.Expr:
    match expr:
        case core.Binary(op=op, left=left, right=right, type=type_):
            return core.Binary(op, _renamed(left, old, new), _renamed(right, old, new), type_)
        case core.Unary(op=op, operand=operand, type=type_):
            return core.Unary(op, _renamed(operand, old, new), type_)
        case core.Read(place=place):
            if place.variable == old:
                return core.Read(core.Place(new))
            robot = None if place.robot is None else _renamed(place.robot, old, new)
            return core.Read(core.Place(place.variable, place.steps, robot))
        case _:
            return expr


def test_pid_in_a_property_is_every_robot() -> None:
    closed = condition("x[pid].x >= 0 and pid < numAgents")
    assert isinstance(closed, core.Quantified)
    assert closed.variable.name == "pid"


def test_entries_of_allread_variables() -> None:
    plain = condition("forall i: x[i].x > 0")
    assert condition("forall i: x@i.x > 0") == plain
    assert condition("forall i: x.x@i > 0") == plain


def test_at_reaches_into_expressions() -> None:
    assert condition("forall i: (n + level[0])@i > 0") == condition("forall i: n@i + level[0] > 0")
    assert condition("forall i: mine@i[0] > 0") == condition("forall i: mine[0]@i > 0")


def test_binders() -> None:
    both = condition("forall i, j: i != j implies n@i != n@j")
    assert isinstance(both, core.Quantified)
    assert isinstance(both.body, core.Quantified)
    ranged = condition("exists k in 0, length(list): list[k] > k")
    assert isinstance(ranged, core.Quantified)
    assert isinstance(ranged.domain, core.IntRange)
    element = condition("forall t in list: t > 0")
    assert isinstance(element, core.Quantified)
    assert isinstance(element.domain, core.Elements)
    assert element.variable.type == INT
    mixed = condition("forall i, k in 0, 3: n@i > k")
    assert isinstance(mixed, core.Quantified)


def test_events_and_ends() -> None:
    ran = condition("forall i: ran(Go)@i implies not stopped@i")
    assert isinstance(ran, core.Quantified)
    assert isinstance(ran.body, core.Binary)
    assert isinstance(ran.body.left, core.Ran)
    assert ran.body.left.events == ((0, 0),)
    closed = condition("ran(Go) or stopped")
    assert isinstance(closed, core.Quantified)


def test_kinds_and_names_of_properties() -> None:
    made = program(f"""{ABOVE}
    invariant: total >= 0
    invariant Fence at round: total < 3
    invariant: total != 7
    eventually: done
    eventually Served: total == 3 leadsto total == 4
    assume: total == 0
    assume Small: total < 3
    """)
    assert [(p.name, p.kind) for p in made.properties] == [
        ("invariant_1", core.PropertyKind.INVARIANT),
        ("Fence", core.PropertyKind.AT_ROUND),
        ("invariant_3", core.PropertyKind.INVARIANT),
        ("eventually_1", core.PropertyKind.EVENTUALLY),
        ("Served", core.PropertyKind.LEADS_TO),
    ]
    assert made.properties[4].trigger is not None
    assert [a.name for a in made.assumptions] == ["assume_1", "Small"]


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("total@0 > 0", "K302"),
        ("forall i: (1 + 2)@i > 0", "K302"),
        ("n@done > 0", "K204"),
        ("n' > 0", "K303"),
        ("ran(Went)", "K304"),
        ("ran(3)", "K304"),
        ("forall int k: k > total", "K306"),
        ("forall Car c: n@c > 0", "K306"),
        ("n == 3 and choose(0, 1) > 2", "K308"),
        ("n != choose(0, 1)", "K308"),
        ("length(findPath(psn, psn)) > 0", "K309"),
        ("n", "K204"),
        ("forall i: n@i", "K204"),
        ("forall t in total: t > 0", "K229"),
        ("unknown@0 > 0", "K201"),
        ("Motion.speed@0 > 0", "K206"),
    ],
)
def test_properties_that_are_wrong(text: str, code: str) -> None:
    assert errors(f"{ABOVE}\n    invariant: {text}\n") == [code]


def test_a_quantifier_that_hides_a_local_is_named() -> None:
    hint = only(f"{ABOVE}\n    invariant: forall n: n@n > 0\n").hint
    assert hint == "`n` is what a quantifier binds here: give that another name"


def test_statements_of_a_program_are_not_those_of_properties() -> None:
    for text, code in [
        ("forall i: i > 0", "K301"),
        ("n@0 > 0", "K302"),
        ("n' > 0", "K303"),
        ("ran(Go)", "K304"),
    ]:
        above = "local:\n  int n = 0\nGo:\n"
        assert errors(f"{above}  pre: {text}\n  eff: n = 1\n") == [code]


def test_leadsto_is_about_one_robot_on_both_sides() -> None:
    (stated,) = program(f"{ABOVE}\n    eventually: done leadsto n > 0\n").properties
    each = stated.each
    assert each is not None
    assert each.agent is None
    assert each.variable.name == "pid"
    assert stated.trigger is not None
    for side in (stated.trigger, stated.condition):
        robots = [n.robot for n in nodes(side) if isinstance(n, core.Place) and n.robot]
        assert robots == [core.Read(core.Place(each.variable))]


def test_leadsto_about_all_robots_is_said_once() -> None:
    (stated,) = program(f"{ABOVE}\n    eventually: total > 0 leadsto total > 1\n").properties
    assert stated.each is None


def test_what_is_expected_of_whole_runs_is_no_assumption_about_starts() -> None:
    made = program(f"{ABOVE}\n    assume Arrives:\n      n > 0 leadsto done\n      total == 0\n")
    assert [a.name for a in made.assumptions] == ["Arrives"]
    assert [(e.name, e.kind) for e in made.expectations] == [
        ("Arrives", core.PropertyKind.LEADS_TO)
    ]
    assert made.expectations[0].each is not None
    assert not made.properties


def test_fresh_answers_are_found_through_functions() -> None:
    text = """
        def fun way(pos p) -> pos[]:
          return findPath(p, p)
        using Motion
        Go:
          eff: Motion.path = way(Motion.psn)
        invariant: length(way(Motion.psn)) > 0
    """
    assert only(text).code == "K309"


def test_choose_in_an_assumption_is_a_range() -> None:
    made = program("""
        local:
          float x
        Go:
          eff: x = x + 1
        assume: x == choose(0, 1)
        assume: 0 <= x and x <= 1
    """)
    first, second = made.assumptions
    assert first.condition == second.condition


# --- starts -------------------------------------------------------------------------------------


def test_what_an_assumption_reads_starts_arbitrary() -> None:
    made = program("""
        param int tasks = 4
        local:
          int n
          int m
          int[] path
          int k = 3
        allwrite:
          Task[] list
          Task[] rest
        allread:
          pos[][] route
          int[] level
        Go:
          eff: n = m + length(path) + length(rest) + k
               level[pid] = length(route)
        assume: length(list) == tasks and (forall t in list: not t.assigned)
        assume: forall i: length(route[i]) == 2 and n@i > k@i
        assume: length(path) == 3
    """)
    n, m, path, k = made.agents[0].locals
    assert n.initial is core.Start.ARBITRARY
    assert m.initial is core.Start.UNSET
    assert (path.initial, path.length) == (core.Start.ARBITRARY, 3)
    assert k.initial == core.Const(3, INT)
    list_, rest = made.allwrite
    assert (list_.initial, list_.length) == (core.Start.ARBITRARY, 4)
    assert rest.initial is core.Start.UNSET
    route, level = made.allread
    assert (route.initial, route.length) == (core.Start.ARBITRARY, 2)
    assert level.initial is core.Start.UNSET


def test_initial_values_of_allread_variables_are_of_the_own_entry() -> None:
    made = program("""
        allread:
          int[] level = pid * 2
          float[] speed = 1
          int[][] seen = []
        Go:
          eff: level[pid] = length(seen) + length(speed)
    """)
    level, speed, seen = made.allread
    assert isinstance(level.initial, core.Binary)
    assert speed.initial == core.Const(Fraction(1), FLOAT)
    assert isinstance(seen.initial, core.MakeList)
    assert errors("allwrite:\n  int first = pid\nGo:\n  eff: first = 1\n") == ["K226"]


def test_the_tasks_of_the_world() -> None:
    text = "allwrite:\n  Task[] list\nGo:\n  pre: allAssigned(list)\n  eff: stop\n"
    places = ((Fraction(1), Fraction(2), Fraction(0)), (Fraction(3), Fraction(4), Fraction(0)))
    made = load(Source("a.krd", text), Settings(tasks=places)).program
    assert made is not None
    initial = made.allwrite[0].initial
    assert isinstance(initial, core.MakeList)
    assert len(initial.items) == 2
    second = initial.items[1]
    assert isinstance(second, core.MakeRecord)
    assert second.fields[1:] == (core.Const(False, BOOL), core.Const(-1, INT), core.Const(1, INT))


def test_an_array_of_tasks_has_the_worlds_size() -> None:
    text = "allwrite:\n  Task[2] list\nGo:\n  pre: allAssigned(list)\n  eff: stop\n"
    place = (Fraction(1), Fraction(2), Fraction(0))
    made = load(Source("a.krd", text), Settings(tasks=(place, place))).program
    assert made is not None
    assert isinstance(made.allwrite[0].initial, core.MakeList)
    wrong = load(Source("a.krd", text), Settings(tasks=(place,)))
    assert [d.code for d in wrong.diagnostics] == ["K246"]


def test_a_false_assumption_is_warned_of() -> None:
    assert codes("param int n = 0\nassume: n > 1\nGo:\n  eff: stop\n") == ["K404"]


@pytest.mark.parametrize(
    "conditions",
    [
        ["n == 0 and n == 1"],
        ["n == 0", "forall i: m[i] > 0", "n > 3"],
        ["n < 4 and n > 3"],
        ["2 <= n", "n != 2", "n <= 2"],
        ["f < 1.5", "1.5 <= f"],
        ["b and not b"],
        ["mode == idle", "mode == busy"],
        ["forall i: m[i] > 3 and m[i] < n and m[i] <= 3"],
    ],
)
def test_assumptions_that_leave_no_value_are_warned_of(conditions: list[str]) -> None:
    assert codes(_WITH + "".join(f"assume: {each}\n" for each in conditions)) == ["K404"]


@pytest.mark.parametrize(
    "conditions",
    [
        ["n == 0 or n == 1"],
        ["n == 0", "forall i: m[i] > 3"],
        ["n < 5 and n > 3"],
        ["f < 1.5", "1.4 <= f"],
        ["f > 1.0 and f < 2.0"],
        ["b implies not b"],
        ["mode != idle", "mode != busy"],
        ["forall k in 0, n: n == 0 and n == 1"],
        ["choose(0, 1) == 0 and choose(0, 1) == 1"],
    ],
)
def test_assumptions_that_leave_some_value_are_not(conditions: list[str]) -> None:
    assert codes(_WITH + "".join(f"assume: {each}\n" for each in conditions)) == []


_WITH = """\
enum Mode: idle, busy, done
allwrite:
  int n
  float f
  bool b
  Mode mode
allread:
  int[] m
Go:
  eff:
    atomic:
      n = m[pid]
      m[pid] = n
      f = 1.0
      b = true
      mode = done
"""


COMPARISONS = st.tuples(
    st.sampled_from(["==", "!=", "<", "<=", ">", ">="]), st.integers(-2, 2), st.booleans()
)


@given(st.lists(COMPARISONS, min_size=1, max_size=5))
def test_what_contradicts_has_no_solution(parts: list[tuple[str, int, bool]]) -> None:
    texts = [f"{value} {op} n" if turned else f"n {op} {value}" for op, value, turned in parts]
    solved = any(all(eval(text, {"n": n}) for text in texts) for n in range(-9, 10))
    found = codes(_WITH + "".join(f"assume: {text}\n" for text in texts))
    if solved:
        assert found == []
    elif all(op != "!=" for op, _, _ in parts):
        assert found == ["K404"]


# --- files of properties ------------------------------------------------------------------------


APP = Source(
    "app.krd",
    "local:\n  int n = 0\nallwrite:\n  int total = 0\nGo:\n  eff: total = n\n",
)


def joined(text: str) -> Elaborated:
    return load(APP, properties=(Source("props.krd", text),))


def test_properties_join_a_program() -> None:
    made = joined(
        "def fun double(int a) -> int:\n  return 2 * a\ninvariant Even: total == double(n)"
    )
    assert made.program is not None
    assert [p.name for p in made.program.properties] == ["Even"]
    assert made.program.properties[0].span.file == "props.krd"
    assert made.program.name == "app"


def test_mistakes_in_both_files_are_told() -> None:
    found = load(
        Source("app.krd", "Go:\n  eff: n = 1\n"),
        properties=(Source("props.krd", "invariant: m > 1\nlocal:\n  int k = 0\n"),),
    )
    assert [(d.code, d.span.file) for d in found.diagnostics] == [
        ("K201", "app.krd"),
        ("K201", "props.krd"),
        ("K232", "props.krd"),
    ]


def test_properties_are_checked_on_their_own() -> None:
    assert codes("invariant: forall i: n@i > other and ran(Go)@i and Motion.psn@i == p") == []
    assert load(Source("p.krd", "invariant: n > 0\n")).program is None
    assert errors("invariant: 1 + true > 2") == ["K229"]
    assert errors("invariant: n' > 0") == ["K303"]
    assert errors("invariant A: n > 0\ninvariant A: n > 1\n") == ["K208"]


# --- several kinds of robot ---------------------------------------------------------------------


AGENTS = """
    allwrite:
      int turn = 0
    agent Car:
      using Motion
      local:
        int own = 1
        int fuel = 3
      Go:
        pre: Motion.reached and fuel > own
        eff: fuel = fuel - 1
             atomic: turn = 1
    agent Drone:
      using Motion:
        sensors:
          float height
      local:
        bool up = false
        int fuel = 4
      Fly:
        pre: up and height > 0 and Motion.reached
        eff: fuel--
             atomic: turn = 2
      Go:
        eff: up = true
"""


def test_kinds_have_names_of_their_own_and_share_the_rest() -> None:
    made = program(AGENTS)
    car, drone = made.agents
    assert (car.name, drone.name) == ("Car", "Drone")
    assert [d.variable.name for d in car.locals] == ["fuel", "own"]
    assert [d.variable.name for d in drone.locals] == ["fuel", "up"]
    assert car.locals[0].variable == drone.locals[0].variable
    assert car.ports[0].declaration.variable == drone.ports[0].declaration.variable
    assert [lock.variables for lock in made.lock_classes] == [("turn",)]
    assert errors(AGENTS.replace("fuel--", "fuel = own")) == ["K201"]


def test_properties_of_kinds() -> None:
    made = program(f"""{AGENTS}
    invariant: forall i: fuel@i >= 0
    invariant: forall Car c: own@c > 0 and Motion.reached@c
    invariant: ran(Go) implies fuel > 0
    invariant: forall Drone d: ran(Fly)@d implies up@d
    """)
    first, second, third, fourth = [p.condition for p in made.properties]
    assert isinstance(first, core.Quantified)
    assert isinstance(second, core.Quantified)
    assert (first.domain, second.domain) == (core.RobotRange(), core.RobotRange(0))
    assert isinstance(third, core.Quantified)
    assert isinstance(third.body, core.Binary)
    assert isinstance(third.body.left, core.Ran)
    assert third.body.left.events == ((0, 0), (1, 1))
    assert isinstance(fourth, core.Quantified)
    assert fourth.domain == core.RobotRange(1)


def test_what_not_all_robots_have() -> None:
    assert errors(f"{AGENTS}\n    invariant: forall i: own@i > 0\n") == ["K243"]
    assert errors(f"{AGENTS}\n    invariant: own > 0\n") == ["K243"]
    assert errors(f"{AGENTS}\n    invariant: own@0 > 0\n") == ["K243"]
    assert errors(f"{AGENTS}\n    invariant: forall i: height@i > 0\n") == ["K243"]


def test_a_property_inside_a_kind_is_of_that_kind() -> None:
    made = program("""
        agent Car:
          local:
            int own = 1
          Go:
            eff: own = 2
          invariant: own > 0
        agent Drone:
          Go:
            eff: stop
    """)
    condition_ = made.properties[0].condition
    assert isinstance(condition_, core.Quantified)
    assert condition_.domain == core.RobotRange(0)


def test_what_stands_outside_is_for_all_kinds() -> None:
    made = program("""
        local:
          int n = 0
        init:
          n = 1
        Common:
          eff: n = n + 1
        agent Car:
          Go:
            eff: n = 2
        agent Drone:
          Go:
            eff: n = 3
    """)
    assert [[e.name for e in agent.events] for agent in made.agents] == [["Common", "Go"]] * 2
    assert all(len(agent.init) == 1 for agent in made.agents)


@pytest.mark.parametrize(
    ("line", "right"),
    [
        ("ensures: forall int q: q > 0 implies near(q)", True),
        ("ensures: result implies forall int q: near(q)", True),
        ("ensures: forall k in 0, 3: forall int q: near(q + k)", True),
        ("ensures: not ((forall int q: near(q)) implies result)", True),
        ("ensures: not (forall int q: near(q))", False),
        ("ensures: (forall int q: near(q)) implies result", False),
        ("ensures: result == (forall int q: near(q))", False),
        ("ensures: exists int q: near(q)", False),
        ("ensures: forall int q, int r: exists int s: near(q + r + s)", False),
        ("requires: forall int q: near(q)", False),
    ],
)
def test_summaries_promise_something_of_every_value_and_deny_nothing(
    line: str, right: bool
) -> None:
    """[EXTERNAL]: or nobody could ever try it."""
    text = f"""
def fun near(int p) -> bool: extern
  {line}
Go:
  pre: near(1)
  eff: stop
"""
    assert errors(text) == ([] if right else ["K310"])
