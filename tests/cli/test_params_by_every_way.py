"""A value of a param is the same, or is refused, whichever way it comes to a program."""

from __future__ import annotations

import json
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Any

import pytest

from koord.cli import arguments
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.runtime.configuration.checking import load
from koord.runtime.configuration.model import params
from koord.syntax.diagnostics import KoordError
from koord.syntax.literals import MOST_DIGITS, MOST_PLACES
from koord.syntax.source import Source

PROGRAM = """
param {type} k = 3
local:
  {type} x = k
Go:
  pre: x < k
  eff: x = k
invariant Same: forall i: x@i == k
invariant Other: forall i: x@i != k
"""

EDGES = [*(2**n + d for n in (31, 63) for d in (-1, 0, 1)), 2**200, 10**MOST_DIGITS - 1]

INTS = [str(sign * n) for n in (0, 1, *EDGES) for sign in (1, -1)]
FLOATS = ["0.0", "1e-300", "-1.0e-300", "1e300", "1.0e+300", f"1e{MOST_PLACES}", "1.0e-400"]
FLOATS += ["0.1234567890123456789012345", "12345678901234567890123.5", "0.1", "-.5", "5."]
REFUSED = ["1.0e+401", "1e401", "1e-401", "9" * (MOST_DIGITS + 1), "9" * 5_000, "1e1000000000"]
REFUSED += ["0x10", "1_000", ".nan", ".inf", "-.inf", "~"]
#: Words, which are no numbers: the program refuses them.
WORDS = ["nan", "inf"]


def configuration(text: str) -> Source:
    return Source("c.yaml", f"num_robots: 1\npositions: {{0: [0, 0]}}\nparams:\n  k: {text}\n")


@pytest.mark.parametrize("text", [*INTS, *FLOATS, *WORDS, "010", "true", "[1, 1e300]", '"1e3"'])
def test_a_configuration_says_what_the_flag_says(text: str) -> None:
    assert params(load(configuration(text))) == {"k": arguments.value(text)}


@pytest.mark.parametrize("text", REFUSED, ids=lambda text: text[:12])
def test_what_the_flag_refuses_a_configuration_refuses(text: str) -> None:
    with pytest.raises(ArgumentTypeError) as by_flag:
        arguments.value(text)
    with pytest.raises(KoordError) as by_file:
        params(load(configuration(text)))
    (told,) = by_file.value.diagnostics
    assert (told.span.file, told.span.line) == ("c.yaml", 4)
    assert told.message in str(by_flag.value) or told.code == "K930" or told.hint


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(type_: str, text: str) -> None:
    Path("p.krd").write_text(PROGRAM.format(type=type_), "utf-8")
    Path("c.yaml").write_text(configuration(text).text, "utf-8")


def verified(text: str) -> int:
    words = ["verify", "p.krd", "--set", f"k={text}", "--robots", "1", "--rounds", "1"]
    return main([*words, "--engine", "induction", "--trace", "t.json", "--certificate", "c.json"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("type_", "text"),
    [
        ("int", "0"),
        ("int", str(2**63)),
        ("int", f"-{2**200}"),
        ("float", "1e-300"),
        ("float", "1e300"),
    ],
)
def test_every_command_takes_extremes(
    type_: str, text: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(type_, text)
    assert verified(text) == Exit.VIOLATED
    assert "Same holds in every round" in " ".join(capsys.readouterr().out.split())
    assert main(["config", "check", "c.yaml"]) == Exit.OK
    assert main(["sim", "p.krd", "c.yaml", "--no-html", "--rounds", "1"]) == Exit.VIOLATED
    assert "broken: invariant Other" in capsys.readouterr().out
    flags = ["--all-local", "--rounds", "1", "--as-fast-as-possible"]
    codes = [main(words) for words in (["deploy", "p.krd", "c.yaml", *flags], ["replay", "t.json"])]
    # It is watched, and at once it is told that Other does not hold.
    assert codes == [Exit.VIOLATED, Exit.OK], capsys.readouterr()
    assert main(["recheck", "c.json"]) == Exit.OK


def edited(name: str, value: Any) -> None:
    """Give the param of a kept file another value."""
    found = json.loads(Path(name).read_text("utf-8"))
    holder = found["params"] if "params" in found else found["parameters"]
    holder["k"] = value
    Path(name).write_text(json.dumps(found), "utf-8")


@pytest.mark.parametrize("places", [MOST_PLACES, MOST_PLACES + 1])
def test_what_is_kept_has_no_other_numbers(
    places: int, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written("int", "3")
    assert verified("3") == Exit.VIOLATED
    edited("t.json", {"int": str(10**places)})
    edited("c.json", 10**places)
    capsys.readouterr()
    for words in (["replay", "t.json"], ["recheck", "c.json"]):
        assert (main(words) == Exit.BAD_INPUT) == (places > MOST_PLACES)
        printed = capsys.readouterr()
        said = printed.out + printed.err
        assert ("`k` is an `int`, but it is set to" in said) == (places > MOST_PLACES), said
