"""Worst paths: bounds of what turns take, and the branches that take it."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from koord.sampling.sampled_inputs import SampledInputs
from koord.semantics.domain import EXACT
from koord.semantics.turns import program_turn
from koord.syntax.analysis.worst_paths import AgentPaths, EventPaths, worst_paths
from koord.syntax.budget import ENDLESS, Budget
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System
from tests.semantics.driving import drive
from tests.syntax.elaborating import program

EXAMPLES = Path(__file__).resolve().parents[2] / "specs" / "examples"


def of(text: str, robots: int = 3) -> AgentPaths:
    (found,) = worst_paths(System(program(text), (0,) * robots))
    return found


def effect(body: str, robots: int = 3) -> EventPaths:
    inside = "\n".join(f"    {line}" for line in body.splitlines())
    (found,) = of(
        "def fun longer(int a) -> int:\n"
        "  if a > 0:\n"
        "    return 1\n"
        "  int b = a + a + a\n"
        "  return b * b\n"
        "def fun twice(int a) -> int: extern\n  ensures: result == 2 * a\n"
        "allread:\n  int[] told = 0\n"
        "local:\n  int x = 0\n  List<int> grows = [1, 2]\n"
        f"Go:\n  eff:\n{inside}\n",
        robots,
    ).events
    return found


def test_the_longer_branch_counts_and_not_both() -> None:
    short, long = effect("x = 1"), effect("x = x + x + x + x")
    both = effect("if x > 0:\n  x = 1\nelse:\n  x = x + x + x + x")
    one = effect("if x > 0:\n  x = x + x + x + x")
    other = effect("if x > 0:\n  x = 1\nelse:\n  x = 1")
    assert both.steps == one.steps
    assert both.steps - other.steps == long.steps - short.steps
    assert [branch.is_true for branch in both.effect.branches] == [False]
    assert [branch.is_true for branch in one.effect.branches] == [True]


def test_branches_that_are_not_taken_have_none_below() -> None:
    body = "if x > 0:\n  x = 1\nelse:\n  if x < 0:\n    x = x + x\n  else:\n    x = 2"
    first, second = effect(body).effect.branches
    assert (first.is_true, second.is_true) == (False, True)
    body = "if x > 0:\n  x = x + x + x + x + x + x\nelse:\n  if x < 0:\n    x = x"
    (only,) = effect(body).effect.branches
    assert only.is_true


@pytest.mark.parametrize("robots", [1, 4, 9])
def test_loops_over_robots_grow_with_them(robots: int) -> None:
    found = [effect("for k = 0, numAgents:\n  x = x + told[k]", n) for n in (robots, robots + 1)]
    assert all(each.is_bound for each in found)
    one = effect("x = x + told[0]", robots).effect
    assert found[1].steps - found[0].steps == one.steps


def test_what_may_grow_has_no_bound() -> None:
    loop = "for k in grows:\n  x = x + k"
    assert effect(loop).effect.endless
    assert not effect(loop).is_bound
    assert effect(f"if x > 0:\n  x = 1\nelse:\n  if x < 0:\n    x = x\n{loop}").effect.endless
    counted = "for k = 0, length(grows):\n  x = x + 1"
    assert not effect(counted).is_bound
    assert effect("for k in [1, 2, 3]:\n  x = x + k").is_bound
    # Also where the worst path does not go: there it might be the worst.
    hidden = "if x > 0:\n  for k in grows:\n    x = 1\nelse:\n  x = x + x + x + x + x + x + x + x"
    assert not effect(hidden).is_bound


def test_what_is_outside_of_the_program_has_no_bound() -> None:
    assert effect("x = twice(x)").effect.unknown == ("twice",)
    assert not effect("x = twice(x)").is_bound
    assert effect("x = longer(x)").is_bound


def test_branches_of_functions_belong_to_the_path() -> None:
    (branch,) = effect("x = longer(x)").effect.branches
    assert branch.span.line == 2
    # Both branches end the function: what stands behind the `if` counts with either.
    assert branch.is_true


def test_a_turn_has_all_guards_and_the_longest_effect() -> None:
    text = (
        "local:\n  int x = 0\n"
        "A:\n  pre: x == 0\n  eff: x = 1\n"
        "B:\n  pre: x == 1 and x != 2\n  eff: x = x + x + x\n"
        "{}C:\n  pre: x == 2\n  eff: x = 0\n"
    )
    plain, urgent = of(text.format("")), of(text.format("urgent "))
    a, b, c = plain.events
    guards = a.guard.steps + b.guard.steps + c.guard.steps
    assert plain.turn_steps == guards + b.effect.steps
    assert urgent.turn_steps == guards + b.effect.steps + c.effect.steps


class Counting(Budget, eq=False):
    """Counts the statements and trips that the rules take."""

    spent: int = 0

    def spend(self, steps: int = 1) -> None:
        self.spent += steps


@pytest.mark.parametrize("name", ["leader_elect", "fischer", "lineform", "sum_of_ids", "traffic"])
def test_no_turn_of_a_run_takes_more(name: str) -> None:
    """Of what the rules count, which is some of the steps."""
    made = load(Source(f"{name}.krd", (EXAMPLES / f"{name}.krd").read_text("utf-8"))).program
    assert made is not None
    driven, counting, ran = drive(made, 3), Counting(ENDLESS.is_over), 0
    (paths,), (agent,) = worst_paths(driven.run.system), made.agents
    assert paths.is_bound
    system = replace(driven.run.system, budget=counting)
    for _ in range(8):
        for robot in range(3):
            enabled = driven.run.enabled(robot)
            for position in enabled:
                counting.spent = 0
                state = driven.configuration.robots[robot]
                inputs = driven.run.inputs
                assert isinstance(inputs, SampledInputs)
                program_turn(EXACT, system, robot, state, position, inputs)
                assert 0 < counting.spent <= paths.events[position].steps
                ran += 1
            taken = driven.configuration.taken
            free = [k for k in enabled if not agent.events[k].lock_classes & taken]
            if free:
                driven.go(robot, agent.events[free[0]].name)
            else:
                driven.skip(robot)
        driven.env()
    assert ran >= 3
