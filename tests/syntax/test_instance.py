"""The instance that a program states: how many robots it is meant for, and how long a round is."""

from __future__ import annotations

from fractions import Fraction

import pytest

from koord.syntax import core
from tests.syntax.elaborating import errors, only, program

GO = """
Go:
  eff: stop
"""

KINDS = """
agent Car:
  {car}
  Drive:
    eff: stop
agent Drone:
  {drone}
  Fly:
    eff: stop
"""


def kinds(car: str, drone: str, above: str = "") -> str:
    return f"{above}\n{KINDS.format(car=car, drone=drone)}"


def test_a_program_that_states_nothing_is_meant_for_nothing() -> None:
    assert program(GO).instance == core.Instance((), None)
    assert program(GO).instance.used_delta_s == Fraction(1, 10)


@pytest.mark.parametrize("name", ["numAgents", "Nsys"])
def test_the_number_of_robots_is_stated(name: str) -> None:
    assert program(f"param int {name} = 4{GO}").instance.kinds == (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("text", "delta_s"),
    [("param float delta = 0.1", Fraction(1, 10)), ("param int delta = 40", 40)],
)
def test_the_length_of_a_round_is_stated_exactly(text: str, delta_s: Fraction) -> None:
    assert program(f"{text}{GO}").instance.delta_s == delta_s


def test_what_is_stated_may_be_said_by_params() -> None:
    text = f"param int side = 2\nparam int numAgents = side * side\n{GO}"
    assert len(program(text).instance.kinds) == 4
    assert len(program(text, side=3).instance.kinds) == 9


def test_names_keep_their_meaning() -> None:
    """They stand for the run's own number and length, whatever is stated."""
    made = program("""
        param int numAgents = 4
        param float delta = 40
        local:
          float x = 0
        Go:
          eff: x = numAgents + delta
    """)
    assert made.parameters == ()
    (assigned,) = made.agents[0].events[0].effect
    assert isinstance(assigned, core.Assign)
    assert "NumAgents" in repr(assigned.value)
    assert "Delta" in repr(assigned.value)


def test_each_kind_of_robot_states_its_own_number() -> None:
    text = kinds("param int numAgents = 1", "param int numAgents = 2")
    assert program(text).instance.kinds == (0, 1, 1)
    assert program(kinds("param int numAgents = 0", "param int Nsys = 1")).instance.kinds == (1,)


def test_a_number_of_all_robots_is_dealt_to_the_kinds() -> None:
    text = kinds("", "", "param int numAgents = 3")
    assert program(text).instance.kinds == (0, 1, 0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"param int numAgents = 0{GO}", "must be from 1 to 10000, not 0"),
        (f"param int numAgents = 10001{GO}", "must be from 1 to 10000, not 10001"),
        (f"param float numAgents = 3{GO}", "`numAgents` is an `int`"),
        (f"param bool delta = true{GO}", "`delta` is a `float`"),
        (f"param float delta = 0{GO}", "a round is longer than 0 seconds"),
        (f"param float delta = -0.5{GO}", "a round is longer than 0 seconds"),
        (f"param float delta = 1000000000.5{GO}", "a round takes from 1e-9 to 1e5 seconds"),
        (f"param float delta = 1e-10{GO}", "a round takes from 1e-9 to 1e5 seconds"),
        (f"param int numAgents{GO}", "`numAgents` has no value"),
        (kinds("param int numAgents = 1", ""), "of kind Drone is not stated"),
        (
            kinds("param int numAgents = 0", "param int numAgents = 0"),
            "there must be 1 to 10000 robots together, not 0",
        ),
        (
            kinds("param int numAgents = 10000", "param int numAgents = 10000"),
            "there must be 1 to 10000 robots together, not 20000",
        ),
        (
            kinds("param int numAgents = 1", "param int numAgents = 1", "param int numAgents = 2"),
            "for all kinds together, and for one by itself",
        ),
        (kinds("param float delta = 1", ""), "a round is as long for all kinds of robot"),
    ],
)
def test_what_cannot_be_is_told(text: str, message: str) -> None:
    found = only(text)
    assert found.code == "K250"
    assert message in found.message


def test_it_is_stated_once() -> None:
    assert errors(f"param int numAgents = 2\nparam int Nsys = 2{GO}") == ["K208"]
    assert errors(f"param float delta = 2\nparam float delta = 2{GO}") == ["K208"]


def test_it_is_known_before_the_run() -> None:
    assert errors(f"param int numAgents = numAgents + 1{GO}") == ["K226"]
    assert errors(f"param int numAgents = pid{GO}") != []


@pytest.mark.parametrize(
    ("name", "other"), [("numAgents", "robots="), ("Nsys", "robots="), ("delta", "delta_s=")]
)
def test_arguments_of_their_own_choose_another(name: str, other: str) -> None:
    found = only(f"param float delta = 2\nparam int numAgents = 2{GO}", **{name: 4})
    assert found.code == "K236"
    assert found.hint == f"say it with `{other}`"


def test_other_names_of_the_language_are_still_no_params() -> None:
    assert errors(f"param int pid = 2{GO}") == ["K209"]
    assert errors("local:\n  int numAgents = 3\nGo:\n  eff: stop\n") == ["K209"]
