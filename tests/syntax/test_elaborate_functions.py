"""Functions: bodies, order, recursion, summaries, the library."""

from __future__ import annotations

import pytest

from koord.syntax import ast, core
from koord.syntax.elaboration.library import library, library_names
from koord.syntax.types import BOOL, FLOAT, INT, POS, ListType
from tests.syntax.elaborating import effect, errors, only, program, value


def names(made: core.Program) -> list[str]:
    return [function.name for function in made.functions]


def test_parameters_are_the_first_slots() -> None:
    made = program("""
        def fun best(float[] xs, int most) -> float:
          float found = 0
          for k, x in xs:
            if k < most and x > found:
              found = x
          return found
    """)
    (function,) = made.functions
    assert [(p.slot, p.name, p.type) for p in function.parameters] == [
        (0, "xs", ListType(FLOAT)),
        (1, "most", INT),
    ]
    assert (function.result, function.bound) == (FLOAT, 5)


def test_functions_come_behind_those_that_they_call() -> None:
    made = program("""
        def fun a(int n) -> int:
          return b(n) + c(n)
        def fun b(int n) -> int:
          return c(n)
        def fun c(int n) -> int:
          return n
    """)
    assert names(made) == ["c", "b", "a"]


def test_recursion_is_told_with_its_cycle() -> None:
    found = only("""
        def fun a(int n) -> int:
          return b(n)
        def fun b(int n) -> int:
          return c(n)
        def fun c(int n) -> int:
          return a(n)
        def fun d(int n) -> int:
          return a(n)
    """)
    assert (found.code, found.span.line) == ("K216", 2)
    assert found.message == "`a`, `b` and `c` call each other: a → b → c → a"
    assert only("def fun f(int n) -> int:\n  return f(n)\n").message == "`f` calls itself"


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("return total", "K224"),
        ("return n", "K224"),
        ("return pid", "K224"),
        ("n = 1", "K224"),
        ("Motion.target = pos(0, 0, 0)", "K224"),
        ("append(seen, 1)", "K224"),
        ("a = 2", "K213"),
        ("stop", "K225"),
        ("atomic: return 1", "K225"),
        ("stdout << a", "K225"),
        ("int a = 3", "K208"),
        ("return true", "K204"),
        ("return", "K222"),
        ("forall i: i > 0", None),
    ],
)
def test_functions_only_compute(line: str, code: str | None) -> None:
    text = f"""
using Motion
local:
  int n = 0
  int[] seen = []
allwrite:
  int total = 0
def fun f(int a) -> int:
  {line}
  return a
Go:
  eff: n = total + length(seen)
       Motion.target = psn
"""
    if code is not None:
        assert errors(text) == [code]
    else:
        assert errors(text) != []


def test_functions_know_what_is_constant() -> None:
    made = program("""
        param int most = 3
        enum Mode: idle, busy
        def fun f(Mode m) -> int:
          if m == idle:
            return most
          else:
            return numAgents
    """)
    assert names(made) == ["f"]


@pytest.mark.parametrize(
    "body",
    [
        "for x in xs:\n    return x",
        "if length(xs) > 0:\n    return 1",
        "if length(xs) > 0:\n    return 1\n  elif length(xs) > 1:\n    return 2",
        "int n = 0",
    ],
)
def test_functions_return_on_every_way(body: str) -> None:
    assert errors(f"def fun f(int[] xs) -> int:\n  {body}\n") == ["K222"]


def test_external_functions_have_summaries() -> None:
    made = program("""
        def fun way(pos a, pos b) -> pos[]:
          extern fresh
          requires: a != b
          ensures:
            length(result) > 0 and result[0] == a
            forall k in 0, length(result), pos p: p == result[k] implies p.z >= 0
        def fun near(pos a, pos b) -> bool: extern
          ensures: result == near(b, a)
    """)
    way, near = made.externals
    assert (way.kind, near.kind) == (core.ExternalKind.FRESH, core.ExternalKind.FUNCTION)
    assert way.result == core.Variable(core.Home.BOUND, 2, "result", ListType(POS))
    assert (len(way.requires), len(way.ensures), way.bound) == (1, 2, 5)
    (symmetric,) = near.ensures
    assert isinstance(symmetric, core.Binary)
    assert isinstance(symmetric.right, core.ExternalCall)
    assert symmetric.right.function == "near"


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("def fun f(int a):\n  extern\n", "K240"),
        ("def fun f(int a):\n  int b = a\n", "K228"),
        ("def fun f(int a, bool a) -> int:\n  return 1\n", "K208"),
        ("def fun f(int a) -> int:\n  return 1\ndef fun f() -> int:\n  return 1\n", "K208"),
        ("def fun f(int a) -> int:\n  extern\n  ensures: b > a\n", "K201"),
        ("def fun f(int a) -> int:\n  extern\n  requires: result > a\n", "K201"),
        ("def fun f(int a) -> int:\n  extern\n  ensures: result\n", "K204"),
        ("def fun f(int a) -> int:\n  extern\n  ensures: pid > a\n", "K224"),
        ("def fun f(int a) -> int:\n  extern\n  ensures: a@pid > a\n", "K302"),
        ("def fun f(itn a) -> int:\n  return a\n", "K203"),
    ],
)
def test_declarations_that_are_wrong(text: str, code: str) -> None:
    assert errors(text) == [code]


def test_calls_are_numbered() -> None:
    made = program("""
        local:
          int n = 0
        def fun f(int a) -> int:
          return a
        Go:
          eff: n = f(f(n)) + f(1)
    """)
    (assign,) = made.agents[0].events[0].effect
    assert isinstance(assign, core.Assign)
    assert sorted(_sites(assign.value)) == [0, 1, 2]


def _sites(expr: core.Expr) -> list[int]:
    match expr:
        case core.Call(site=site, arguments=arguments):
            return [site, *(s for argument in arguments for s in _sites(argument))]
        case core.Binary(left=left, right=right):
            return [*_sites(left), *_sites(right)]
        case _:
            return []


# --- the library --------------------------------------------------------------------------------


def test_only_what_is_called_lands_in_the_program() -> None:
    made = program("""
        local:
          pos p = pos(0, 0, 0)
          float d = 0
        Go:
          eff: d = distance(p, pos3d(1, 2, 3))
    """)
    assert set(names(made)) == {"subtractedPos", "norm", "distance", "pos3d"}
    assert names(made).index("norm") < names(made).index("distance")
    assert [external.name for external in made.externals] == ["sqrt"]


def test_arguments_choose_among_functions_of_one_name() -> None:
    above = """
        local:
          pos p
          pos[] path
          pos[][] paths
          bool ok
    """
    made = effect(
        """
        path = findPath(p, p)
        path = findPath(p, p, path)
        p = midpoint(p, p)
        p = midpoint(path)
        ok = willCollide(paths, path, pid)
        ok = willCollide(path, path)
        ok = pathIsClear(paths, path, pid)
        """,
        above,
    )
    called = []
    for s in made:
        assert isinstance(s, core.Assign)
        assert isinstance(s.value, core.Call | core.ExternalCall)
        called.append(s.value.function)
    assert called == [
        "findPath",
        "findPath_2",
        "midpoint",
        "midpoint_2",
        "willCollide",
        "willCollide_2",
        "pathIsClear",
    ]


def test_calls_that_fit_no_function() -> None:
    above = "local:\n  pos p\n  float d = 0\nGo:\n  eff: %s\n"
    assert errors(above % "p = midpoint(p, 2)") == ["K204"]
    assert errors(above % "p = midpoint()") == ["K217"]
    assert errors(above % "d = distance(p)") == ["K217"]
    assert errors(above % "d = distance(p, 3)") == ["K204"]
    assert errors(above % "d = distance(a = p, b = p)") == ["K218"]
    assert errors(above % "d = sqrt(nothing)") == ["K201"]


def test_a_programs_function_takes_the_place_of_the_librarys() -> None:
    made = program("""
        def fun distance(int a, int b) -> int:
          return abs(a - b)
        local:
          int n = 0
        Go:
          eff: n = distance(n, 3)
    """)
    assert names(made) == ["distance"]


def test_also_for_the_library_if_its_types_agree() -> None:
    made = program("""
        def fun pathsClear(pos[] a, pos[] b) -> bool: extern
          ensures: not result
        allread:
          pos[][] route
        local:
          bool ok = true
        Go:
          eff: ok = pathIsClear(route, route[pid], pid)
    """)
    (clear,) = made.externals
    assert isinstance(clear.ensures[0], core.Unary)
    other = program("""
        def fun norm(int a) -> int:
          return abs(a)
        local:
          float d = 0
          pos p
        Go:
          eff: d = distance(p, p) + norm(3)
    """)
    assert set(names(other)) == {"norm", "library_norm", "distance", "subtractedPos"}


def test_neighbours_on_a_line() -> None:
    assert value("getNeighbors(pid)", type_="int[]").type == ListType(INT)
    above = "allread:\n  pos[] x\n"
    assert value("midpoint(getNeighbors(pid, x))", above, "pos").type == POS


def written(type_: ast.TypeExpr) -> str:
    match type_:
        case ast.NamedType(name=name, arguments=()):
            return name
        case ast.NamedType(name=name, arguments=arguments):
            return f"{name}<{', '.join(map(written, arguments))}>"
        case ast.ArrayTypeExpr(element=element):
            return f"{written(element)}[]"


DEFINITIONS = [d for name in library_names() for d in library().functions[name]]


@pytest.mark.parametrize("definition", DEFINITIONS, ids=lambda d: d.name.name)
def test_every_function_of_the_library_can_be_called(definition: ast.FunDef) -> None:
    assert definition.result is not None
    types = [written(decl.type) for decl in definition.parameters]
    variables = "".join(f"  {type_} a{k}\n" for k, type_ in enumerate(types))
    arguments = ", ".join(f"a{k}" for k in range(len(types)))
    made = program(
        f"local:\n{variables}  {written(definition.result)} answer\n"
        f"Go:\n  eff: answer = {definition.name.name}({arguments})\n"
    )
    called = {f.name.partition("_")[0] for f in made.functions}
    called |= {f.name.partition("_")[0] for f in made.externals}
    assert definition.name.name in called


def test_a_task_that_lacks_a_field_is_told_at_the_call() -> None:
    found = only("""
        def Task:
          pos loc
          int taskId
        allwrite:
          Task[] list
        local:
          Task next
        Go:
          eff: next = getAvailableNextTask(list)
    """)
    assert (found.code, found.span.line) == ("K245", 10)
    assert "`Task` has no field `assigned`" in found.message
    assert found.notes[0].span.line == 2


def test_results_of_truth() -> None:
    assert value("allAssigned([])", type_="bool").type == BOOL
