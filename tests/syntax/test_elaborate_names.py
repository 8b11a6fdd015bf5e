"""What names mean, and what may be written."""

from __future__ import annotations

from fractions import Fraction
from textwrap import dedent

import pytest

from koord.syntax import core
from koord.syntax.core import Parameter
from koord.syntax.diagnostics import Severity
from koord.syntax.elaboration.phrases import closest
from koord.syntax.types import BOOL, INT, POS, ArrayType, EnumType, ListType, Robots
from tests.syntax.elaborating import codes, diagnostics, effect, errors, only, program, value


def test_variables_have_slots_by_home() -> None:
    made = program("""
        local:
          int a = 0
          bool b = true
        allread:
          pos[] x
          int level[numAgents]
        allwrite:
          int[] list
        Go:
          eff: if b and a > 0: x[pid].y = level[0] + length(list)
    """)
    agent = made.agents[0]
    assert [d.variable for d in agent.locals] == [
        core.Variable(core.Home.LOCAL, 0, "a", INT),
        core.Variable(core.Home.LOCAL, 1, "b", BOOL),
    ]
    assert [d.variable.type for d in made.allread] == [
        ArrayType(POS, Robots.ALL),
        ArrayType(INT, Robots.ALL),
    ]
    assert made.allwrite[0].variable == core.Variable(core.Home.ALLWRITE, 0, "list", ListType(INT))


def test_constants_of_the_language() -> None:
    assert value("pid") == core.Pid(INT)
    assert value("Nsys") == value("numAgents") == core.NumAgents(INT)
    assert isinstance(value("delta", type_="float"), core.Delta)


def test_params_are_replaced_by_their_values() -> None:
    text = """
        param int n = 2 * 3
        param float speed = 1
        param int[] sizes = [n, 1]
        local:
          int cells[n]
          int m = 0
        Go:
          eff: m = n + sizes[0]
               cells[0] = length(cells)
    """
    made = program(text)
    assert [(p.name, p.value) for p in made.parameters] == [
        ("n", 6),
        ("speed", 1),
        ("sizes", (6, 1)),
    ]
    assert made.agents[0].locals[0].variable.type == ArrayType(INT, 6)
    set_ = program(text, n=9)
    assert set_.parameters[0] == Parameter("n", 9, 6)
    assert set_.agents[0].locals[0].variable.type == ArrayType(INT, 9)


def test_settings_that_do_not_fit_are_told() -> None:
    text = """
        param int tasks = 4
        local:
          int n = tasks
        Go:
          eff: n = tasks
    """
    assert errors(text, tasks="many") == ["K237"]
    assert errors(text, tasks=True) == ["K237"]
    for given, told in ((Fraction(2), "2.0"), (Fraction(10) ** 400, "1e400")):
        assert only(text, tasks=given).message == f"`tasks` is an `int`, but it is set to `{told}`"
    mode = only(
        "enum Mode: idle, pick\nparam Mode m = idle\nGo: eff: if m == pick: stop\n", m="pock"
    )
    assert (mode.code, mode.hint) == ("K237", "it is one of idle, pick")
    unknown = only(text, task=3)
    assert (unknown.code, unknown.hint) == ("K236", "did you mean `tasks`?")


def test_letters_that_names_cannot_have_are_all_that_is_told_of_a_name() -> None:
    text = "local: int größe = 0\nlocal: int 数 = 0\nGo: eff: größe = größe + 数 + 1\n"
    assert codes(text) == ["K101"] * 5


def test_members_of_enumerations() -> None:
    above = """
        enum Mode: idle, pick, drop
        enum Phase: idle, done
    """
    mode = EnumType("Mode", ("idle", "pick", "drop"))
    assert value("pick", above, "Mode") == core.Const(1, mode)
    assert value("Mode.drop", above, "Mode") == core.Const(2, mode)
    assert value("idle", above, "Phase") == core.Const(0, EnumType("Phase", ("idle", "done")))
    assert errors(dedent(above) + "Go:\n  pre: idle == idle\n  eff: stop\n") == ["K210", "K210"]
    assert codes(dedent(above) + "Go:\n  pre: idle != Mode.pick\n  eff: stop\n") == []


def test_a_misspelt_name_gets_a_suggestion() -> None:
    told = diagnostics("""
        local:
          int counter = 0
        Go:
          eff: counter = countr
    """)
    assert [(d.code, d.hint) for d in told] == [("K201", "did you mean `counter`?")]


def test_one_mistake_is_told_once() -> None:
    assert errors("""
        local:
          Cargo load
          int n = 0
        Go:
          eff: load.mass = 3
               n = load.mass + load.size
    """) == ["K203"]
    assert errors("""
        local:
          int n = 0
          int n = 1
        Go:
          eff: n = true
    """) == ["K208"]


@pytest.mark.parametrize(
    ("declared", "cure"),
    [
        ("int[3] x", "write `int[] x`, or `int[3][] x`: one `int[3]` for each robot"),
        ("int[][3] x", "write `int[][3][] x`: one `int[][3]` for each robot"),
        ("int[Nsys][3] x", "write `int[3][numAgents] x`"),
    ],
)
def test_an_allread_variable_that_is_no_array_over_the_robots(declared: str, cure: str) -> None:
    found = only(f"allread:\n  {declared}\n")
    assert (found.code, found.hint) == ("K211", cure)


@pytest.mark.parametrize(
    ("line", "cure"),
    [
        ("n = list.length", "the length of a list is `length(…)`"),
        ("n = list.size()", "did you mean `length`?"),
        ("list.add(task)", "did you mean `append`?"),
        ("for i in range(0, 3): n = i", "a loop over numbers is written `for i = 0, n:`"),
        ("print(n)", "write `stdout << …`, with `using Log`"),
        ("n = null", "there is no such value: a variable is unset until it is written"),
        ("n = self", "did you mean `pid`?"),
        ("n = list[0].asigned", "did you mean `assigned`?"),
    ],
)
def test_what_other_languages_say(line: str, cure: str) -> None:
    text = "local:\n  int n\n  Task task\n  Task[] list\nUse:\n  pre: list[n] == task\n"
    assert only(f"{text}  eff: {line}\n").hint == cure


def test_a_type_of_another_language() -> None:
    assert only("local:\n  double x\nE:\n  eff: x = 1\n").hint == "did you mean `float`?"


def test_a_text_that_cannot_be_read_is_not_called_empty() -> None:
    assert codes("locl:\n  int x\n") == ["K141"]  # an error, and no K405
    assert codes("# nothing\n") == ["K405"]


def test_nothing_is_made_of_a_string_without_end() -> None:
    assert codes('local:\n  int n = 0\nE:\n  pre: n > 0\n  eff: n = "abc\n') == ["K102"]


def test_all_mistakes_of_a_file_are_told() -> None:
    assert errors("""
        local:
          int a = true
          float b = 0
        allread:
          int[3] level
        One:
          pre: c > 0
          eff: a = b
        Two:
          pre: b
          eff: nothing(a)
    """) == ["K204", "K211", "K201", "K204", "K204", "K202"]


@pytest.mark.parametrize(
    ("statement", "code"),
    [
        ("level = [1]", "K212"),
        ("level[0] = 1", "K212"),
        ("level[me] = 1", "K212"),
        ("append(level, 1)", "K212"),
        ("Motion.psn = p", "K213"),
        ("psn.x = 0", "K213"),
        ("most = 3", "K213"),
        ("pid = 3", "K213"),
        ("idle = 3", "K213"),
        ("for i = 0, 3: i = 2", "K213"),
        ("for q in all_: q = p", "K213"),
        ("for k, q in all_: k = 0", "K213"),
        ("Motion.target = true", "K204"),
        ("stdout = p", "K201"),
    ],
)
def test_what_may_not_be_written(statement: str, code: str) -> None:
    text = f"""
param int most = 3
enum Mode: idle, busy
using Motion
local:
  int me = 0
  pos p
  pos[] all_
  Mode mode
allread:
  int[] level
Go:
  eff:
    {statement}
"""
    assert errors(text) == [code]


def test_own_entries_of_allread_variables_are_written() -> None:
    above = """
        allread:
          pos[] x
          int[][] seen
    """
    first, second, third = effect("x[pid].y = 2\nseen[pid] = [1]\nseen[pid].append(3)", above)
    assert isinstance(first, core.Assign)
    step = first.place.steps[0]
    assert isinstance(step, core.IndexStep)
    assert step.index == core.Pid(INT)
    assert isinstance(second, core.Assign)
    assert isinstance(third, core.Append)


def test_reserved_names_and_names_of_types() -> None:
    assert errors("local:\n  int numAgents = 0\nGo:\n  eff: numAgents = 1\n") == ["K209"]
    assert errors("def pos:\n  int x\n") == ["K209"]
    assert errors("enum Mode: pid, idle\n") == ["K209"]
    assert errors("def fun f(int pid) -> int:\n  return pid\n") == ["K209"]


def test_events_may_be_called_like_anything() -> None:
    made = program("""
        allwrite:
          int sum = 0
        local:
          int finalsum = 0
        finalsum:
          pre: sum > 3
          eff: finalsum = sum
        length:
          eff: atomic: sum = sum + 1
    """)
    assert [event.name for event in made.agents[0].events] == ["finalsum", "length"]


def test_declarations_may_come_in_any_order() -> None:
    assert (
        codes("""
        Go:
          pre: n < most
          eff: n = twice(n)
        def fun twice(int a) -> int:
          return 2 * a
        local:
          int n = 1
        param int most = 3
    """)
        == []
    )


def test_a_size_knows_no_variables() -> None:
    for section in ("local", "allwrite"):
        found = only(f"""
{section}:
  int n = 3
  int cells[n]
Go:
  eff: cells[0] = n
""")
        assert found.code == "K226"


def test_hints_name_the_module_of_a_port() -> None:
    found = only("local:\n  pos p\nGo:\n  eff: p = psn\n")
    assert found.hint == "`psn` is a port of `Motion`: begin the program with `using Motion`"
    assert errors("using Odd:\n  sensors:\n    int pid\n") == ["K209"]


def test_what_only_follows_from_unreadable_lines_is_not_told() -> None:
    assert errors("local:\n  int n = = 0\n  int m = 0\nGo:\n  eff: n = m\n") != []
    assert "K201" not in errors("local:\n  int n = = 0\n  int m = 0\nGo:\n  eff: n = m\n")
    assert "K403" not in codes("local:\n  int n = 0\nGo:\n  eff: n = = 1\n")
    assert "K201" in errors("local:\n  int n = = 0\n  int m = 0\nGo:\n  eff: k = m\n")


@pytest.mark.parametrize(
    "misspelt", ["nmae_0777", "nam_0777", "naame_0777", "nane_0777", "name_07777", "NAME_0777"]
)
def test_among_thousands_of_names_the_closest_is_found(misspelt: str) -> None:
    """One that is written like it but for a letter, or two that changed places."""
    known = [f"name_{number:04}" for number in range(2_000)]
    assert closest(misspelt, known) == "name_0777"
    assert closest("quite_different", known) is None


@pytest.mark.parametrize(
    ("body", "meant"),
    [
        # The nearest name is of another type.
        ("pre: redy\n    eff: n = 1", "ready"),
        ("eff: n = redy", None),
        ("eff: ready = cont", None),
        ("eff: n = cont", "count"),
        ("pre: n < redy\n    eff: n = 1", None),
        ("pre: n < cont\n    eff: n = 1", "count"),
        ("eff: n = n + speedy", None),
        ("eff: far = n + speedy", "speed"),
        ("eff: far = spot.x + spt.y", "spot"),
        ("eff: far = cont.y", None),
        # It cannot be written.
        ("eff: mot = 2", None),
        ("eff: n = mot", "most"),
        ("eff: pdi = 2", None),
        ("eff: n = pdi", "pid"),
        ("eff: cont = 2", "count"),
    ],
)
def test_what_is_guessed_fits_where_it_would_stand(body: str, meant: str | None) -> None:
    text = (
        "param int most = 3\nlocal:\n  int n = 0\n  int count = 0\n  bool ready = false\n"
        "  float speed = 0\n  float far = 0\n  pos spot = pos(0, 0, 0)\n"
    )
    (unknown,) = [d for d in diagnostics(f"{text}Go:\n    {body}\n") if d.code == "K201"]
    assert ("did you mean" in (unknown.hint or "")) is (meant is not None)
    if meant is not None:  # and with it there is no other mistake
        assert unknown.hint == f"did you mean `{meant}`?"
        wrong = unknown.message.split("`")[1]
        mended = f"{text}Go:\n    {body.replace(wrong, meant)}\n"
        assert [d.code for d in diagnostics(mended) if d.severity is Severity.ERROR] == []
