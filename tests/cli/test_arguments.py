from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Callable
from contextlib import suppress
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.api.robots import FleetSize
from koord.cli import arguments
from koord.cli.arguments import (
    check_files,
    delta,
    fleet,
    number,
    pace,
    seconds,
    setting,
    settings,
)
from koord.cli.exits import Exit
from koord.cli.main import main


def test_a_fleet() -> None:
    assert fleet("3") == FleetSize(3)
    assert fleet("Car=2,Drone=1") == FleetSize(3, (("Car", 2), ("Drone", 1)))
    assert fleet("Car=2,Drone=0").total == 2


@pytest.mark.parametrize(
    ("convert", "text", "reason"),
    [
        (fleet, "0", "from 1 to 10000"),
        (fleet, "-3", "from 1 to 10000"),
        (fleet, "three", "not a whole number"),
        (fleet, "3.0", "not a whole number"),
        (fleet, "", "not a whole number"),
        (fleet, "9" * 5000, "too long a number"),
        (fleet, "1e2", "not a whole number"),
        (fleet, "Car=2,3", "no kind of robot"),
        (fleet, "Car=2,Car=1", "given twice"),
        (fleet, "Car=", "not a whole number"),
        (fleet, "Car=0,Drone=0", "1 to 10000 robots, not 0"),
        (fleet, "A=9000,B=9000", "not 18000"),
        (arguments.rounds, "-1", "from 0"),
        (arguments.rounds, "2.5", "not a whole number"),
        (arguments.seed, "-1", "from 0"),
        (seconds, "0", "not more than 0"),
        (seconds, "-5", "not more than 0"),
        (seconds, "1e400", "from 1e-9 to 1e9 seconds"),
        (seconds, "1e-400", "from 1e-9 to 1e9 seconds"),
        (seconds, "nan", "not a number"),
        (pace, "1e400", "from 1e-9 to 1e9"),
        (pace, "0", "not more than 0"),
        (seconds, "inf", "not a number"),
        (delta, "0", "not more than 0"),
        (delta, "1/0", "divides by zero"),
        (delta, "1e400", "from 1e-9 to 1e5 seconds"),
        (delta, "1e-400", "from 1e-9 to 1e5 seconds"),
        (delta, "1000000001", "from 1e-9 to 1e5 seconds"),
        (delta, "nan", "not a number"),
        (delta, "inf", "not a number"),
        (number, "1e999", "does not lie between"),
        (number, "1e9999999999", "too long a number"),
        (number, "0x10", "not a number"),
        (setting, "tasks", "write tasks=value"),
        (setting, "=4", "not the name of a param"),
        (setting, "a b=4", "not the name of a param"),
        (setting, "x=", "no value"),
        (setting, "x=no-ne", "'no-ne' is not a value"),
        (setting, "x=1 2", "'2' is too much"),
        (setting, "x=[1, 2", "not closed"),
        (setting, "x=[1 2]", "a comma is missing before '2'"),
        (setting, "x=[1,", "not closed"),
        (setting, "x=[,]", "',' is not a value"),
        (setting, "x=[]]", "']' is too much"),
        (setting, 'x="a', "a quote is not closed"),
        (setting, "x=" + "[" * 5000, "nested more than 20"),
    ],
)
def test_a_wrong_value_is_refused_with_the_reason(
    convert: Callable[[str], object], text: str, reason: str
) -> None:
    with pytest.raises(ArgumentTypeError, match=r"\S") as error:
        convert(text)
    assert reason in str(error.value)


@pytest.mark.parametrize("words", [["--delta", "-1/2"], ["--delta", "-5e-1"], ["--delta=-1/2"]])
def test_a_negative_number_is_told_from_a_flag(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", "app.krd", *words]) == Exit.BAD_INPUT
    assert "argument --delta: δ must be positive: '-" in capsys.readouterr().err
    assert main(["verify", "app.krd", "--timeout", "-1/2"]) == Exit.BAD_INPUT
    assert "'-1/2' is not more than 0 seconds" in capsys.readouterr().err


def test_a_flag_is_no_number(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "app.krd", "--delta", "--json"]) == Exit.BAD_INPUT
    assert "--delta: expected one argument" in capsys.readouterr().err


def test_numbers_are_exact() -> None:
    assert number("0.1") == Fraction(1, 10)
    assert number("-.5") == Fraction(-1, 2)
    assert number("1e-3") == Fraction(1, 1000)
    assert delta("1/30") == Fraction(1, 30)
    assert seconds("90") == 90.0
    assert seconds("1.5s") == 1.5


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("4", 4),
        ("-4", -4),
        ("0.25", Fraction(1, 4)),
        ("true", True),
        ("False", False),
        ('"a, b"', "a, b"),
        ("pick", "pick"),
        ("[pick, drop]", ("pick", "drop")),
        ("[]", ()),
        ("[1, 2.5,true]", (1, Fraction(5, 2), True)),
        ("[[1],[2, 3]]", ((1,), (2, 3))),
        (" [ 1 , 2 ] ", (1, 2)),
    ],
)
def test_the_values_of_set(text: str, value: object) -> None:
    name, got = setting(f"x={text}")
    assert name == "x"
    assert got == value
    assert type(got) is type(value)


def test_one_name_has_one_value() -> None:
    assert settings([("a", 1), ("b", 2), ("a", 1)]) == {"a": 1, "b": 2}
    with pytest.raises(ArgumentTypeError, match="gives a two values"):
        settings([("a", 1), ("a", 2)])


def test_standard_input_is_read_once() -> None:
    check_files(["-", "a.krd"])
    with pytest.raises(ArgumentTypeError, match="named twice"):
        check_files(["-", "a.krd", "-"])


@given(st.text())
def test_any_text_is_a_value_or_refused(text: str) -> None:
    for convert in (fleet, number, setting, arguments.value, seconds):
        with suppress(ArgumentTypeError):
            assert convert(text) is not None
