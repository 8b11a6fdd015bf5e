"""Variables that are read and never set are warned of, and those that something sets are not."""

from __future__ import annotations

import pytest

from tests.syntax.elaborating import diagnostics

USE = "Go:\n  pre: n < 3\n  eff:\n    n = n + 1\n    {0}\n"
COUNT = "local:\n  int n = 0\n"


def warned(declaration: str, *statements: str, more: str = "", home: str = "local") -> list[str]:
    text = f"{COUNT}{home}:\n  {declaration}\n" + USE.format("\n    ".join(statements)) + more
    return [found.message for found in diagnostics(text) if found.code == "K406"]


@pytest.mark.parametrize("home", ["local", "allwrite"])
@pytest.mark.parametrize(
    ("declaration", "statements"),
    [
        ("Queue<int> q", ["append(q, 1)"]),
        ("Queue<int> q", ["n = pop(q)"]),
        ("int[] q", ["q[0] = 3", "n = length(q)"]),
        ("Map<int, int> q", ["q[3] = 2"]),
        ("int q", ["n = q"]),
        ("pos q", ["q.x = 1", "if q.y > 0: n = 3"]),
        ("Task[4] q", ["if q[0].assigned: n = 3"]),
        ("Task[4] q", ["q[0].loc = pos(0, 0, 0)", "if not q[1].assigned: n = 3"]),
    ],
)
def test_what_is_never_set_is_told(home: str, declaration: str, statements: list[str]) -> None:
    changes = declaration.startswith("Map")
    more = "invariant: q[3] == 2\n" if changes and home == "allwrite" else ""
    more = "invariant: forall i: q@i[3] == 2\n" if changes and home == "local" else more
    told = warned(declaration, *statements, more=more, home=home)
    assert len(told) == 1
    assert "is read and never set" in told[0]


def test_a_field_is_named() -> None:
    assert warned("pos q", "q.x = 1", "if q.y > 0: n = 3") == [
        "`y` of `q` is read and never set: to read it is a fault"
    ]


@pytest.mark.parametrize(
    ("declaration", "statements"),
    [
        ("int q", ["q = 3", "n = q"]),
        ("Queue<int> q", ["q = [1]", "append(q, 1)"]),
        ("int q = 1", ["n = q"]),
        ("pos q", ["q.x = 1", "if q.x > 0: n = 3"]),
        ("int q[3]", ["for i = 0, 3: q[i] = i", "n = q[0]"]),
        ("int q", ["q = 3"]),
    ],
)
def test_what_is_set_is_not(declaration: str, statements: list[str]) -> None:
    assert warned(declaration, *statements) == []


def test_init_and_assumptions_set_too() -> None:
    assert warned("int q", "n = q", more="init:\n  q = 1\n") == []
    assert warned("int q", "n = q", more="assume: forall i: q@i > 0\n") == []


def test_a_property_reads() -> None:
    assert len(warned("int q", "n = 2", more="invariant: forall i: q@i > 0\n")) == 1


def test_the_cure_is_one_and_the_world_may_give_tasks() -> None:
    text = f"{COUNT}allwrite:\n  Task[] todo\n" + USE.format("n = length(todo)")
    (found,) = (found for found in diagnostics(text) if found.code == "K406")
    assert found.hint is not None
    assert "`todo = []`" in found.hint
    assert "world: {tasks: …}" in found.hint
    assert diagnostics(text.replace("Task[] todo", "Task[] todo = []")) == ()


def test_nothing_is_said_of_a_program_that_could_not_be_read() -> None:
    """What sets the variable may be in what was lost."""
    text = f"{COUNT}  int q\nGo:\n  eff: n = q\n"
    assert [found.code for found in diagnostics(text)] == ["K406"]
    for wrong in ("Set:\n  eff: q = 3 +\n", "Set:\n  eff: q = zz\n"):
        assert "K406" not in [found.code for found in diagnostics(text + wrong)]
