"""Statements: loops, conditions, changes of lists, locks, output."""

from __future__ import annotations

import pytest

from koord.syntax import core
from koord.syntax.types import BOOL, INT, STRING
from tests.syntax.elaborating import codes, effect, errors, only, program

ABOVE = """
    local:
      int n = 0
      int[] list = []
      Queue<int> queue = []
      Map<int, string> names = {}
      Task task
    allwrite:
      Task[] tasks
      int total = 0
      int other = 0
"""


def test_elif_is_if_in_else() -> None:
    (made,) = effect("if n > 3: n = 1\nelif n > 2: n = 2\nelse: n = 3", ABOVE)
    assert isinstance(made, core.If)
    (inner,) = made.otherwise
    assert isinstance(inner, core.If)
    assert len(inner.then) == len(inner.otherwise) == 1


def test_loops_bind_their_variables() -> None:
    (loop,) = effect("for i = pid, length(list) + 1: n = n + i", ABOVE)
    assert isinstance(loop, core.ForRange)
    assert loop.variable == core.Variable(core.Home.BOUND, 0, "i", INT)
    assert loop.low == core.Pid(INT)
    (each,) = effect("for k, name in names: n = k", ABOVE)
    assert isinstance(each, core.ForEach)
    assert each.key is not None
    assert (each.key.type, each.value.type) == (INT, STRING)
    (pairs,) = effect("for k, v in list: n = k + v", ABOVE)
    assert isinstance(pairs, core.ForEach)
    assert pairs.key is not None


def test_nested_loops_have_slots_of_their_own() -> None:
    made = program("""
        local:
          int n = 0
        Go:
          eff:
            for i = 0, 3:
              for j in [1, 2]: n = n + i * j
            for i = 0, 2: n = n + i
    """)
    event = made.agents[0].events[0]
    assert event.bound == 3


def test_repeat_is_a_loop_from_0_whose_variable_has_no_name() -> None:
    (repeated,) = effect("repeat numAgents: n = n + 1", "local:\n  int n = 0\n")
    (loop,) = effect("for trip = 0, numAgents: n = n + 1", "local:\n  int n = 0\n")
    assert repeated == loop
    assert codes("""
        local:
          int n = 0
        Go:
          eff:
            repeat 2:
              repeat 3:
                n = n + 1
                break
              n = trip
    """) == ["K201"]


def test_a_loop_may_begin_and_end_where_one_around_it_is() -> None:
    assert (
        codes("""
        local:
          int n = 0
          int[] list = [3, 1]
        Go:
          eff:
            for i = 0, numAgents:
              for j = i + 1, numAgents: n = n + j
              for j = 0, i: n = n + j
            for i, x in list:
              for j = i, length(list): n = n + x * list[j]
    """)
        == []
    )


@pytest.mark.parametrize(
    ("statement", "code"),
    [
        ("for i = 0, n: n = i", "K215"),
        ("repeat n: n = 1", "K215"),
        ("repeat 1.5: n = 1", "K204"),
        ("for i = n, 3: n = i", "K215"),
        ("for i = 0, 2.5: n = i", "K204"),
        ("for i = 0, 3: for j = n, i: n = j", "K215"),
        ("for i, x in list: for j = x, 3: n = j", "K215"),
        ("for x in n: n = x", "K229"),
        ("for x in names: n = 1", "K229"),
        ("break", "K220"),
        ("return 3", "K221"),
        ("return", "K221"),
        ("int m = 3", "K223"),
        ("n = choose(0, 3)", "K219"),
        ("if n: n = 1", "K204"),
        ("append(list)", "K217"),
        ("append(list, true)", "K204"),
        ("append(n, 1)", "K229"),
        ("remove(names, true)", "K204"),
        ("n = pop(names)", "K229"),
        ("pop(list, 3)", "K217"),
        ("list.push(3)", "K202"),
        ("assign(n, pid)", "K229"),
        ("assign(task, true)", "K204"),
        ("n = length(pop(queue))", "K228"),
        ("length(list)", "K228"),
        ("sqrt(2)", "K228"),
        ("n.x = 3", "K205"),
        ("n++ ", None),
        ("task++", "K229"),
        ("pid++", "K213"),
    ],
)
def test_statements_that_are_wrong(statement: str, code: str | None) -> None:
    indented = "\n".join(f"      {line}" for line in statement.splitlines())
    assert errors(f"{ABOVE}\n    Go:\n     eff:\n{indented}\n") == ([code] if code else [])


def test_changes_of_lists_are_statements_of_the_core() -> None:
    made = effect(
        """
        append(list, 3)
        list.append(3)
        list = append(list, 3)
        queue.remove(3)
        names.remove(3)
        pop(queue)
        n = pop(queue)
        n = queue.pop()
        """,
        ABOVE,
    )
    assert made[0] == made[1] == made[2]
    assert [type(s) for s in made] == [core.Append] * 3 + [core.Remove] * 2 + [core.Pop] * 3
    assert made[6] == made[7]
    taken = made[6]
    assert isinstance(taken, core.Pop)
    assert taken.into is not None


def test_assign_marks_a_task() -> None:
    made = effect("assign(task, pid)", ABOVE)
    plain = effect("task.assigned = true\ntask.assignedTo = pid", ABOVE)
    assert made == plain
    (atomic,) = effect("atomic: assign(tasks[n], pid)", ABOVE)
    assert isinstance(atomic, core.Atomic)
    assert len(atomic.body) == 2


def test_increments_read_and_write() -> None:
    (made,) = effect("n++", ABOVE)
    assert made == effect("n = n + 1", ABOVE)[0]
    assert effect("n--", ABOVE) == effect("n = n - 1", ABOVE)


def test_output_names_its_stream() -> None:
    (made,) = effect('stdout << "n = " << n', ABOVE)
    assert isinstance(made, core.Output)
    assert made.stream == "stdout"
    assert [value.type for value in made.values] == [STRING, INT]
    (same,) = effect('Log.stdout << "n = " << n', ABOVE + "\n    using Log\n")
    assert same == made
    assert errors("local:\n  int n = 0\nGo:\n  eff: n << 3\n") == ["K238"]


def test_an_event_without_a_guard_is_always_enabled() -> None:
    made = program("Go:\n  eff: stop\nurgent Stop:\n  pre: true\n  eff: trystop()\n")
    first, second = made.agents[0].events
    assert first.guard == core.Const(True, BOOL)
    assert (first.urgent, second.urgent) == (False, True)
    assert isinstance(first.effect[0], core.Stop)
    assert isinstance(second.effect[0], core.TryStop)


# --- lock classes -------------------------------------------------------------------------------


def classes(text: str) -> list[tuple[str, ...]]:
    return [lock.variables for lock in program(text).lock_classes]


LOCKS = """
    allwrite:
      int a = 0
      int b = 0
      int c = 0
      int d = 0
    local:
      int n = 0
"""


def test_blocks_that_write_a_common_variable_are_one_class() -> None:
    text = f"""{LOCKS}
    One:
      eff: atomic: a = 1
    Two:
      eff: atomic:
             b = 1
             if n > 0: c = 1
    Three:
      eff: atomic:
             for i = 0, 3: a = b
             c = 1
    Four:
      eff: atomic: d = 1
    Five:
      eff: atomic: n = 1
    Six:
      eff: atomic: n = 2
    """
    made = program(text)
    assert [lock.variables for lock in made.lock_classes] == [("a", "b", "c"), ("d",), (), ()]
    assert [event.lock_classes for event in made.agents[0].events] == [
        {0},
        {0},
        {0},
        {1},
        {2},
        {3},
    ]


def test_reading_in_common_does_not_lock() -> None:
    assert classes(f"""{LOCKS}
    One:
      eff: atomic: a = d
    Two:
      eff: atomic: b = d
    """) == [("a",), ("b",)]


def test_an_event_may_enter_several_classes() -> None:
    made = program(f"""{LOCKS}
    One:
      eff: atomic: a = 1
           atomic: d = 1
    """)
    assert made.agents[0].events[0].lock_classes == {0, 1}


def test_atomic_inside_atomic_is_an_error() -> None:
    assert (
        only(f"""{LOCKS}
    One:
      eff: atomic:
             a = 1
             if n > 0: atomic: b = 1
    """).code
        == "K214"
    )
    assert only(f"{LOCKS}\n    init:\n      atomic: a = 1\n").code == "K225"


# --- warnings -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("statement", "warned"),
    [
        ("total = total + 1", True),
        ("total++", True),
        ("n = total\n    total = n + 1", True),
        ("if total > 3: total = 0", True),
        ("tasks.append(task)", True),
        ("assign(tasks[0], pid)", True),
        ("atomic: total = total + 1", False),
        ("total = 3", False),
        ("n = total", False),
        ("total = other", False),
        ("if total > 3: other = 1", False),
        ("n = total\n    atomic: total = n", False),
        ("at[0].x = 1.0", True),
        ("at[pid].x = 1.0", False),
        ("atomic: at[0].x = 1.0", False),
        ("at[0] = pos(1.0, 2.0, 3.0)", False),
    ],
)
def test_lost_updates(statement: str, warned: bool) -> None:
    text = f"""
local:
  int n = 0
  Task task
allwrite:
  int total = 0
  int other = 0
  Task[] tasks
  Map<int, pos> at = {{}}
Go:
  eff:
    {statement}
Use:
  pre: n > total + other + length(at)
  eff: task = tasks[0]
"""
    assert ("K401" in codes(text)) == warned


@pytest.mark.parametrize(
    ("guard", "statement", "warned"),
    [
        ("turn == -1", "turn = pid", True),
        ("turn == -1", "n = turn\n    turn = n + pid", True),
        ("turn == -1", "if n > 0: turn = n", True),
        ("turn == -1", "atomic: turn = pid", False),
        ("turn == pid", "turn = -1", False),
        ("n > 0", "turn = pid", False),
        ("marks[pid] == 0", "marks[pid] = n", False),
    ],
)
def test_guards_that_read_what_the_effect_writes(guard: str, statement: str, warned: bool) -> None:
    text = f"""
local:
  int n = 0
allwrite:
  int turn = -1
  int[numAgents] marks
init:
  marks[pid] = 0
Go:
  pre: {guard}
  eff:
    {statement}
Use:
  pre: n > turn + marks[0]
  eff: n = 0
"""
    assert codes(text) == (["K401"] if warned else [])


def test_entries_of_ones_own_are_never_lost() -> None:
    assert (
        codes("""
        allwrite:
          int marks[numAgents]
        init:
          marks[pid] = 0
        Go:
          eff: marks[pid] = marks[pid] + 1
    """)
        == []
    )
