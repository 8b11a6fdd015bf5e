"""Params that are set to extremes: it works, or a message says where and what to do instead."""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main

PROGRAM = """
param float f = 1
param int n = 3
local:
  float x = 0
  int k = 0
Step:
  pre: k < 3
  eff:
    x = x + f * f
    k = k + n
invariant Low: forall i: x@i >= 0
"""

COMMANDS = {
    "check": [],
    "run": ["--rounds", "2", "--robots", "1"],
    "verify": ["--rounds", "2", "--robots", "1", "--jobs", "1", "--engine", "induction"],
    "compile": ["-o", "out.py"],
    "check-refinement": ["--runs", "1", "--rounds", "2"],
    "sim": ["--rounds", "2", "--no-html"],
}

#: Those for which floats are doubles.
COMPILING = {"compile", "check-refinement", "sim"}

WORK = ("f=1e-400", "f=-1e-400", "f=1e154", f"n={2**200}", f"n=-{2**200}", "n=-5")
TOO_LARGE = ("f=1e400", "f=-1e308")
REFUSED = {
    "f=1e401": "'1e401' does not lie between 1e-400 and 1e400",
    "f=1e-401": "does not lie between 1e-400 and 1e400",
    "f=nan": "K237",
    "f=inf": "K237",
    "f=-inf": "'-inf' is not a value",
    "n=1e400": "K237",
    "n=0.5": "K237",
    "n=" + 10_000 * "9": "is too long a number: write at most 100 digits",
    "f=" + 10_000 * "9": "is too long a number: write at most 100 digits",
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("p.krd").write_text(PROGRAM, encoding="utf-8")


def slow_unless_compiling(name: str) -> list[pytest.MarkDecorator]:
    return [] if name in ("compile", "run") else [pytest.mark.slow]


@pytest.mark.parametrize("value", [*WORK, *TOO_LARGE])
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=slow_unless_compiling(name)) for name in COMMANDS]
)
def test_extreme_values_work_or_are_refused_with_their_place(
    name: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main([name, "p.krd", "--set", value, *COMMANDS[name]])
    said = capsys.readouterr().err
    if name in COMPILING and value in TOO_LARGE:
        assert code == Exit.BAD_INPUT
        assert "p.krd:10:13: error K925: a number of this program is larger than any double" in said
        assert not Path("out.py").exists()
    else:
        assert code == Exit.OK, said


@pytest.mark.parametrize("value", REFUSED, ids=lambda value: value[:8])
@pytest.mark.parametrize("name", ["check", "compile"])
def test_what_is_no_value_is_refused_shortly(
    name: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([name, "p.krd", "--set", value, *COMMANDS[name]]) == Exit.BAD_INPUT
    printed = capsys.readouterr()
    said = printed.out + printed.err
    assert REFUSED[value] in said
    assert len(said) < 1_000


def test_a_violation_stands_where_the_compiled_program_has_no_such_number(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("p.krd").write_text(PROGRAM.replace(">= 0", "< 1"), encoding="utf-8")
    words = ["verify", "p.krd", "--set", "f=1e400", "--robots", "1", "--rounds", "2", "--jobs", "1"]
    assert main(words) == Exit.VIOLATED
    assert "a number is larger than any double" in capsys.readouterr().out
