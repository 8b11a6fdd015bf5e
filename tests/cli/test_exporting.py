"""``koord verify --export``: what is refused, with the exports that do take the program."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NoReturn

import pytest

from koord.api import export
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.semantics.every_number import NotFiniteError
from koord.syntax.source import NOWHERE
from koord.verify.export import smtlib as verify_exporting

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: A question about all maps that a function may be asked about, which the program writes in parts:
#: no formula says that.
UNSAID = """
def fun f(Map<int, int> m) -> int: extern
    ensures: forall int k: f(m) >= 0 or k < 0
local:
    Map<int, int> seen = {}
    int x = 0
Step:
    eff:
        seen[1] = 2
        x = f(seen)
invariant Fine: forall i: x@i >= 0
"""


def told(capsys: pytest.CaptureFixture[str], path: Path, flag: str, *words: str) -> tuple[int, str]:
    """The exit code, and what is said on the side."""
    asked = ["verify", str(path), "--robots", "2", "--rounds", "2", "--export", flag, *words]
    code = main(asked)
    return code, capsys.readouterr().err


def named(text: str) -> list[str]:
    """The exports that the last hint says to take a program."""
    return re.findall(r"`--export (\w+)`", re.findall(r"= help: (.*)", text)[-1])


QUICK = ("hvac", "shortest_path", "broken/crossing")
REST = [
    name
    for path in [*EXAMPLES.glob("*.krd"), *EXAMPLES.glob("broken/*.krd")]
    if (name := str(path.relative_to(EXAMPLES).with_suffix(""))) not in QUICK
]


@pytest.mark.parametrize(
    "name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in sorted(REST))]
)
def test_every_example_is_written_or_refused_with_an_export_that_takes_it(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = EXAMPLES / f"{name}.krd"
    for flag in export.FORMATS:
        file = tmp_path / f"Out.{flag}"
        code, said = told(capsys, path, flag, "-o", str(file))
        assert file.exists() == (code == Exit.OK)
        if code == Exit.OK:
            continue
        assert code == Exit.BAD_INPUT
        assert re.search(rf"{re.escape(path.name)}:\d+:\d+: error K94[34]: ", said)
        others = named(said)
        assert "smt2" in others
        for other in others:
            assert told(capsys, path, other, "-o", str(tmp_path / f"of.{other}"))[0] == Exit.OK


def test_what_no_export_says_is_named_with_its_place(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "unsaid.krd"
    path.write_text(UNSAID, encoding="utf-8")
    code, said = told(capsys, path, "smt2")
    assert (code, "of infinitely many values" in said) == (Exit.OK, True)  # as a circuit says it

    def no_circuit(*_: object) -> NoReturn:
        raise NotFiniteError(NOWHERE, "the program is of a test")

    monkeypatch.setattr(verify_exporting, "circuit_of", no_circuit)
    for flag in export.FORMATS:
        code, said = told(capsys, path, flag)
        assert code == Exit.BAD_INPUT
        assert f"{path}:" in said
        assert ("K943" in said) == (flag == "tla")
        assert named(said) == []
        assert "no other export takes this program" in said


def test_where_that_is_not_soon_known_nothing_is_said_of_others(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export, "_TRIED_S", 0.0)
    code, said = told(capsys, EXAMPLES / "task.krd", "tla")
    assert code == Exit.BAD_INPUT
    assert "= help: leave modules out\n" in said


def test_nothing_is_written_when_the_time_is_up(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path, file = EXAMPLES / "delivery.krd", tmp_path / "out.aag"
    code, said = told(capsys, path, "aiger", "--timeout", "0.001", "-o", str(file))
    assert (code, said) == (Exit.UNKNOWN, "koord verify: the time was up, and nothing is written\n")
    assert not file.exists()


def test_properties_are_there_or_refused(capsys: pytest.CaptureFixture[str]) -> None:
    path = EXAMPLES / "leader_elect.krd"
    code, said = told(capsys, path, "smt2", "--property", "Nobody")
    assert code == Exit.BAD_INPUT
    assert "there is no 'Nobody'; there are Best, " in said
    code, said = told(capsys, path, "smt2", "--property", "Decided")
    assert code == Exit.BAD_INPUT
    assert "'Decided' is about whole runs, which exports leave out" in said
    code, said = told(capsys, path, "smt2")
    assert (code, said) == (
        Exit.OK,
        "koord verify: not in the file: Decided: it is about whole runs\n",
    )


def test_values_that_a_circuit_does_not_follow_are_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "counts.krd"
    path.write_text("local:\n  int x = 0\nUp:\n  eff: x = x + 1\ninvariant P: forall i: x@i >= 0\n")
    code, said = told(capsys, path, "aiger")
    assert code == Exit.OK
    assert said.startswith("koord verify: followed in a range only, so a violation with a value")
    assert said.endswith(": x\n")
    assert told(capsys, path, "smt2") == (Exit.OK, "")
