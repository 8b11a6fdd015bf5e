"""What costs too much is refused, with the number found; what passes costs no more than counted."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from koord.sampling.sampled_inputs import SampledInputs
from koord.semantics.domain import EXACT
from koord.semantics.turns import program_turn
from koord.syntax import core
from koord.syntax.analysis.limits import count, excesses
from koord.syntax.analysis.work import MOST_DEEP, TypeSizes, WorkEstimate, starting_lengths
from koord.syntax.budget import ENDLESS, Budget
from koord.syntax.diagnostics import Severity
from koord.syntax.elaboration import ParamValue, Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System
from tests.semantics.driving import drive
from tests.syntax.elaborating import program

ROOT = Path(__file__).parents[2]


def refused(text: str, **params: ParamValue) -> list[tuple[str, int, str]]:
    """The errors of a text: code, line, message."""
    found = load(Source("app.krd", dedent(text)), Settings(params))
    errors = [d for d in found.diagnostics if d.severity is Severity.ERROR]
    assert (found.program is None) == bool(errors)
    assert all(d.hint for d in errors)
    return [(d.code, d.span.line, d.message) for d in errors]


def doubling(functions: int) -> str:
    """Functions that call the one before twice."""
    made = ["def fun f0(int a) -> int:\n  return a + 1\n"]
    for n in range(1, functions):
        made.append(f"def fun f{n}(int a) -> int:\n  return f{n - 1}(a) + f{n - 1}(a + 1)\n")
    return "".join(made) + f"local:\n  int x = 0\nGo:\n  eff: x = f{functions - 1}(x)\n"


def chained(functions: int) -> str:
    """Functions that call the one before."""
    made = ["def fun f0(int a) -> int:\n  return a + 1\n"]
    for n in range(1, functions):
        made.append(f"def fun f{n}(int a) -> int:\n  return f{n - 1}(a + 1)\n")
    return "".join(made) + f"local:\n  int x = 0\nGo:\n  eff: x = f{functions - 1}(x)\n"


# --- what is refused ----------------------------------------------------------------------------


def test_loops_in_loops() -> None:
    text = """\
        local:
          int x = 0
        Count:
          eff:
            x = 1
            for i = 0, 100000:
              for j = 0, 10000:
                x = x + 1
        """
    ((code, line, message),) = refused(text)
    assert (code, line) == ("K247", 6)
    assert message.startswith("the event `Count` takes up to 6,000,500,0")
    assert message.endswith("steps; 10,000,000 is the most")


@pytest.mark.parametrize("start", ["", " = []", " = [1]"])
def test_what_is_added_to_an_unknown_length_counts(start: str) -> None:
    text = f"""\
        local:
          int x = 0
          int[] xs{start}
        Count:
          eff:
            for i = 0, len(xs) + {2**63}:
              x = x + 1
        """
    ((code, line, _),) = refused(text)
    assert (code, line) == ("K247", 6)
    assert refused(text.replace(str(2**63), "8")) == []


def test_calls_of_calls_are_told_where_they_become_too_many() -> None:
    ((code, line, message),) = refused(doubling(60))
    assert code == "K247"
    assert message.startswith("the function `f20` takes up to 14,")
    assert doubling(60).splitlines()[line - 1].startswith("def fun f20(")
    assert refused(doubling(19)) == []


def test_a_chain_of_calls() -> None:
    ((code, _, message),) = refused(chained(3_000))
    assert code == "K249"
    assert f"is {MOST_DEEP + 1} deep" in message or f"is {MOST_DEEP + 2} deep" in message
    assert refused(chained(50)) == []


def test_arrays_of_arrays() -> None:
    text = (
        "local:\n  int[1024][1024][1024][1024][1024][1024] x\nGo:\n  eff: x[0][0][0][0][0][0] = 1\n"
    )
    ((code, line, message),) = refused(text)
    assert (code, line) == ("K248", 2)
    assert "about 10^18 parts" in message


@pytest.mark.parametrize("where", ["local", "allwrite", "allread"])
def test_variables_that_are_too_large_together(where: str) -> None:
    array = "int[600][1000]"
    if where == "allread":
        text = f"{where}:\n  {array}[] x\n  {array}[] y\nGo:\n  eff: x[pid][0][0] = 1\n"
    else:
        text = f"{where}:\n  {array} x\n  {array} y\nGo:\n  eff: x[0][0] = 1\n"
    ((code, line, message),) = refused(text)
    assert (code, line) == ("K248", 2)
    assert "have 1,200,000 parts, of which `x` has 600,000" in message


def test_lists_that_an_assumption_makes_long() -> None:
    text = """\
        local:
          int[] heard
        assume: length(heard) == 1000000000
        Go:
          eff: stop
        """
    ((code, line, message),) = refused(text)
    assert (code, line) == ("K248", 2)
    assert "`heard` (an assumption gives it the length 1,000,000,000)" in message


def test_records_of_records() -> None:
    wide = ["def R0:\n  int a\n  int b\n"]
    wide += [f"def R{n}:\n  R{n - 1} a\n  R{n - 1} b\n" for n in range(1, 30)]
    ((code, _, message),) = refused("".join(wide) + "local:\n  R29 r\nGo:\n  eff: r.a = r.b\n")
    assert code == "K248"
    assert "`r` has 1,073,741,824 parts" in message
    long = ["def R0:\n  int a\n"]
    long += [f"def R{n}:\n  R{n - 1} a\n" for n in range(1, 100)]
    ((code, _, message),) = refused("".join(long) + "local:\n  R99 r\nGo:\n  eff: stop\n")
    assert code == "K249"
    assert "101 deep" in message


def test_records_inside_of_lists_and_functions_count_too() -> None:
    ((code, _, message),) = refused(
        """\
        def Map_:
          int[2000][2000] cells
        local:
          Map_[] maps = []
        Go:
          eff: stop
        """
    )
    assert (code, message[:30]) == ("K248", "`maps` has 4,000,000 parts; al")
    ((code, _, message),) = refused(
        """\
        def fun f() -> int:
          int[2000][2000] cells
          cells[0][0] = 1
          return cells[0][0]
        local:
          int x = f()
        Go:
          eff: stop
        """
    )
    assert (code, message[:31]) == ("K248", "`cells` has 4,000,000 parts; al")


def test_params_count_with_the_value_they_have() -> None:
    text = """\
        param int n = 3
        local:
          int x = 0
        Go:
          eff: x = 1
        invariant Far: forall i: forall a in 0, n: forall b in 0, n: x@i >= 0
        """
    assert refused(text) == []
    assert refused(text, n=1000) == []
    ((code, line, message),) = refused(text, n=10**9)
    assert (code, line) == ("K247", 6)
    assert message.startswith("`Far` takes up to about 10^18 steps")


def test_robots_count() -> None:
    made = program(
        """\
        allread:
          int[] y = 0
        local:
          int[500] mine
        Go:
          eff:
            mine[0] = 1
            for i = 0, numAgents:
              y[pid] = y[pid] + i
        invariant Near: forall i, j: y[i] <= y[j] + 1000
        """
    )
    assert excesses(made, (0,) * 900) == ()
    (steps,) = excesses(made, (0,) * 1_500)
    assert steps.code == "K247"
    assert "`Near` takes up to" in steps.message
    assert "with 1,500 robots" in steps.message
    (parts,) = excesses(made, (0,) * 2_500)
    assert parts.code == "K248"
    assert "`mine` has 500, for each of 2,500 robots" in parts.message


def test_numbers_are_shown_so_that_one_can_read_them() -> None:
    assert count(12_345) == "12,345"
    assert count(2**60) == "about 10^18"
    assert count(10 ** (10**5)) == "over 10^3000"


# --- what is counted ----------------------------------------------------------------------------


class Counting(Budget, eq=False):
    """Counts how often evaluation asks whether to go on."""

    spent: int = 0

    def spend(self, steps: int = 1) -> None:
        self.spent += steps


BODIES = {
    "triangle": ("for i = 0, 12:\n  for j = i + 1, 12:\n    x = x + j", 66, 144),
    "negative": ("for i = -3, 3:\n  x = x + i", 6, 6),
    "empty": ("for i = 5, 2:\n  x = x + i", 0, 0),
    "product": ("for i = 0, 3 * 4 - 2:\n  x = x + i", 10, 10),
    "robots": ("for i = pid, numAgents * 2:\n  x = x + i", 6, 6),
    "list": ("for a in xs:\n  for k, b in xs:\n    for i = 0, k:\n      x = x + b", 30, 100),
    "length": ("for i = 0, length(xs):\n  x = x + xs[i]", 5, 5),
    "array": ("for a in ys:\n  x = x + a", 7, 7),
    "map": ("for k, v in m:\n  x = x + v", 2, 2),
    "early": ("for i = 0, 100:\n  if x > 3: break\n  x = x + 1", 4, 100),
    "branches": (
        "if x > 0:\n  for i = 0, 9:\n    x = x + 1\nelse:\n  for i = 0, 8:\n    x = 1",
        8,
        17,
    ),
    "calls": ("x = f(x) + f(f(x))", 12, 12),
}


@pytest.mark.parametrize("name", sorted(BODIES))
def test_the_count_is_a_bound(name: str) -> None:
    """Of the statements that are executed: near, and never below."""
    body, done, most = BODIES[name]
    inside = "\n".join(f"    {line}" for line in body.splitlines())
    text = f"""\
def fun f(int a) -> int:
  int r = 0
  for i = 0, 4:
    r = r + a
  return r
local:
  int x = 0
  int[] xs = [1, 2, 3, 4, 5]
  int[7] ys = [1, 2, 3, 4, 5, 6, 7]
  Map<int, int> m = {{1: 2, 3: 4}}
Go:
  eff:
{inside}
"""
    made = program(text)
    event = made.agents[0].events[0]
    work, culprit = WorkEstimate(made, (0, 0, 0), TypeSizes(3)).body((), event.effect)
    assert culprit is None
    driven = drive(made, 3)
    counting = Counting(ENDLESS.is_over)
    system = System(made, (0, 0, 0), budget=counting)
    state = driven.run.configuration.robots[0]
    assert isinstance(driven.run.inputs, SampledInputs)
    _, turned = program_turn(EXACT, system, 0, state, 0, driven.run.inputs)
    assert turned.faults == ()
    assert done <= counting.spent <= work.steps
    # Each trip takes a handful of steps, and a whole array as many as it has parts.
    assert most <= work.steps <= 12 * most + 40


def test_lengths_are_those_that_lists_start_with() -> None:
    made = program(
        """\
        allwrite:
          int[] xs = [1, 2]
          int[] ys
        local:
          Map<int, int> m = {1: 2}
        assume: length(ys) == 7
        Go:
          eff: xs[0] = ys[0] + m[1]
        """
    )
    lengths = {name: length for (_, _, name), length in starting_lengths(made).items()}
    assert lengths == {"xs": 2, "ys": 7, "m": 1}


def test_sizes_of_types() -> None:
    made = program(
        """\
        def Pair:
          int a
          pos p
        allread:
          Pair[] pairs
        local:
          Pair[3] three
          List<Pair> few = []
          Map<int, Pair> known = {}
        Go:
          eff: pairs[pid] = three[0]
        """
    )
    (agent,) = made.agents
    types = [d.variable.type for d in (*agent.locals, *made.allread)]
    sizes = TypeSizes(5)
    assert [sizes.of(t).parts for t in types] == [12, 4, 5, 20]
    assert [sizes.of(t).depth for t in types] == [4, 4, 4, 4]


def test_a_program_of_too_many_places_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    made = program("local:\n  int x = 0\nGo:\n  eff: x = x + 1\n")
    monkeypatch.setattr("koord.syntax.analysis.work.MOST_NODES", 5)
    (found,) = excesses(made, (0,))
    assert found.code == "K247"
    assert isinstance(made, core.Program)
