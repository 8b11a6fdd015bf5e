"""The arguments of ``koord verify`` and ``koord run``, and what precedes the engines."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import pytest

from koord.cli import main as frame
from koord.cli import run, verify
from koord.cli.arguments import Fleet
from koord.cli.exits import Exit
from koord.cli.inputs import LoadedProgram

GOOD = "local:\n  int x = 0\ngo:\n  pre: x < 3\n  eff: x = x + 1\ninvariant Small: x <= 3\n"


@pytest.fixture
def program(tmp_path: Path) -> str:
    path = tmp_path / "good.krd"
    path.write_text(GOOD, encoding="utf-8")
    return str(path)


def test_every_flag_of_verify_arrives(monkeypatch: pytest.MonkeyPatch, program: str) -> None:
    seen: list[tuple[str, verify.Request]] = []

    def engine(loaded: LoadedProgram, request: verify.Request) -> Exit:
        seen.append((loaded.source.name, request))
        return Exit.UNKNOWN

    monkeypatch.setattr(verify, "_verify", engine)
    words = ["verify", program, "--robots", "Car=2,Drone=1", "--rounds", "5", "--delta", "1/3"]
    words += ["--engine", "bmc", "--property", "Small", "--timeout", "2.5", "--seed", "9"]
    words += ["--explain", "--trace", f"{program}.json", "--json"]
    assert frame.main(words) == Exit.UNKNOWN
    assert seen == [
        (
            program,
            verify.Request(
                fleet=Fleet(3, (("Car", 2), ("Drone", 1))),
                rounds=5,
                delta_s=Fraction(1, 3),
                engine=verify.Engine.BMC,
                properties=("Small",),
                timeout_s=2.5,
                seed=9,
                trace=f"{program}.json",
                explain=True,
                as_json=True,
            ),
        )
    ]


def test_the_defaults_are_those_of_the_documentation(
    monkeypatch: pytest.MonkeyPatch, program: str
) -> None:
    seen: list[verify.Request] = []

    def engine(loaded: LoadedProgram, request: verify.Request) -> Exit:
        seen.append(request)
        return Exit.OK

    monkeypatch.setattr(verify, "_verify", engine)
    assert frame.main(["verify", program]) == Exit.OK
    (request,) = seen
    assert (request.fleet, request.rounds, request.engine) == (Fleet(3), 20, verify.Engine.AUTO)
    assert (request.properties, request.timeout_s, request.trace) == ((), None, None)


def test_several_programs_end_with_the_gravest_code(
    monkeypatch: pytest.MonkeyPatch, program: str
) -> None:
    codes = [Exit.OK, Exit.VIOLATED, Exit.UNKNOWN]
    monkeypatch.setattr(verify, "_verify", lambda loaded, request: codes.pop())
    assert frame.main(["verify", program, program, program]) == Exit.VIOLATED
    assert codes == []


def test_errors_of_the_program_come_before_the_engine(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, program: str
) -> None:
    broken = tmp_path / "broken.krd"
    broken.write_text("local:\n  int x = y\n", encoding="utf-8")
    for command in ("verify", "run"):
        assert frame.main([command, str(broken)]) == Exit.BAD_INPUT
        streams = capsys.readouterr()
        assert f"{broken}:2:11: error K2" in streams.err
        assert streams.out == ""
    assert frame.main(["verify", "--json", program, str(broken)]) == Exit.BAD_INPUT
    assert json.loads(capsys.readouterr().out)["errors"] == 1


def test_a_file_of_properties_alone_is_nothing_to_work_on(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    properties = tmp_path / "props.krd"
    properties.write_text("invariant Small: x <= 3\n", encoding="utf-8")
    for command in ("verify", "run"):
        assert frame.main([command, str(properties)]) == Exit.BAD_INPUT
        assert "props.krd: error K904: there is no program" in capsys.readouterr().err


def test_a_trace_that_cannot_be_written_is_told_before_the_work(
    capsys: pytest.CaptureFixture[str], program: str
) -> None:
    for command in ("verify", "run"):
        assert frame.main([command, program, "--trace", "/none/t.json"]) == Exit.BAD_INPUT
        assert "/none/t.json: error K903: cannot be written" in capsys.readouterr().err


def test_every_flag_of_run_arrives(monkeypatch: pytest.MonkeyPatch, program: str) -> None:
    seen: list[run.Request] = []

    def machine(loaded: LoadedProgram, request: run.Request) -> Exit:
        seen.append(request)
        return Exit.OK

    monkeypatch.setattr(run, "_run", machine)
    words = ["run", program, "--robots", "2", "--rounds", "0", "--seed", "4"]
    words += ["--policy", "random", "--interactive", "--trace", f"{program}.json", "--delta", "2"]
    assert frame.main(words) == Exit.OK
    assert seen == [
        run.Request(
            fleet=Fleet(2),
            rounds=0,
            delta_s=Fraction(2),
            policy=run.Policy.RANDOM,
            seed=4,
            interactive=True,
            trace=f"{program}.json",
        )
    ]


def test_a_misspelt_property_is_no_verdict(
    capsys: pytest.CaptureFixture[str], program: str
) -> None:
    assert frame.main(["verify", program, "--property", "Smal"]) == Exit.BAD_INPUT
    streams = capsys.readouterr()
    assert "--property: there is no 'Smal'; there are Small, " in streams.err
    assert streams.out == ""


def test_a_lost_update_is_shown_in_the_text_and_replays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """[LOST-UPDATE] [REPLAY]: with the statement that updates."""
    monkeypatch.chdir(tmp_path)
    text = "allwrite:\n  int n = 0\nAdd:\n  eff: n = n + 1\ninvariant Any: n >= 0\n"
    Path("add.krd").write_text(text, encoding="utf-8")
    words = ["verify", "add.krd", "--robots", "2", "--rounds", "2", "--trace", "t.json"]
    assert frame.main(words) == Exit.VIOLATED
    out = capsys.readouterr().out
    assert "updates what it read before robot" in out
    assert "add.krd:4:8\n  4 |   eff: n = n + 1\n    |        ^^^^^^^^^" in out
    assert frame.main(["replay", "t.json"]) == Exit.OK
    assert "  it loses an update of n, as it says\n" in capsys.readouterr().out
