"""``koord check-refinement``: programs, generated ones, and what a wrong compiler looks like."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from msgspec.structs import replace

from koord.api import refinement
from koord.cli import main as frame
from koord.cli.exits import Exit
from koord.refinement import running
from koord.refinement.cases import Tried, ever_smaller
from koord.runtime.compile import compiled
from koord.syntax import core

TEXT = (
    "allwrite:\n  int sum = 0\nlocal:\n  int n = 0\n"
    "Up:\n  pre: n < 3\n  eff:\n    atomic:\n      sum = sum + 2\n    n = n + 1\n"
)


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "app.krd").write_text(TEXT, "utf-8")
    return "app.krd"


@pytest.fixture
def _wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """A compiler that adds one where two should be added."""

    def wrongly(program: core.Program) -> str:
        return compiled(program).replace("+ 2", "+ 1")

    monkeypatch.setattr(running, "compiled", wrongly)


@pytest.fixture
def _hang_ups_count() -> Iterator[None]:
    """The tests may run under nohup, where hang-ups are ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


def koord(*arguments: str) -> int:
    return frame.main(["check-refinement", *arguments])


def test_a_program_is_checked(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert koord(file, "--runs", "6") == Exit.OK
    about, engine, network, udp = capsys.readouterr().out.splitlines()
    assert about == "app.krd: δ = 0.1 s"
    assert engine.startswith("engine: 6 runs, 48 rounds, ")
    assert network.startswith("network: 1 run, 8 rounds, ")
    assert udp.startswith("udp: 1 run, 8 rounds, ")
    assert list(Path().glob("refinement-*")) == []


def test_programs_are_generated(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--runs", "5", "--rounds", "2", "--json", "--target", "engine"]
    assert koord(*words) == Exit.OK
    told = json.loads(capsys.readouterr().out)
    assert [(one["target"], one["runs"]) for one in told["targets"]] == [("engine", 5)]
    assert told["failure"] is None
    assert koord(*words) == Exit.OK
    assert json.loads(capsys.readouterr().out) == told
    assert koord(*words, "--seed", "1") == Exit.OK
    assert json.loads(capsys.readouterr().out) != told


@pytest.mark.parametrize("faults", ["loss", "chaos"])
def test_faults_make_robots_skip(
    file: str, faults: str, capsys: pytest.CaptureFixture[str]
) -> None:
    skips = []
    for words in ([], ["--faults", faults]):
        for target in ("engine", "network"):
            assert koord(file, "--runs", "6", "--target", target, "--json", *words) == Exit.OK
            (told,) = json.loads(capsys.readouterr().out)["targets"]
            assert told["target"] == target
            skips.append(told["skips"])
    assert skips[2] > skips[0]
    assert skips[3] > skips[1]


@pytest.mark.usefixtures("_wrong")
@pytest.mark.parametrize("target", ["engine", "network", "udp"])
def test_a_run_that_is_refused_is_shown_and_kept(
    file: str, target: str, capsys: pytest.CaptureFixture[str]
) -> None:
    page = ["--html", "refused.html"]
    assert koord(file, "--runs", "6", "--seed", "3", "--target", target, *page) == Exit.VIOLATED
    shown = Path("refused.html").read_text("utf-8")
    assert '"headline":"round 1: not legal"' in shown
    assert '"name":"sum","expected":"2","found":"1"' in shown
    out = capsys.readouterr().out
    assert f"refused: app.krd: 1 robot, δ = 0.1 s, {target}" in out
    assert "[ENV-TRANS] round 1: the configuration recorded is another" in out
    assert "sum: by the rules 2, recorded 1" in out
    (kept,) = Path().glob("refinement-*.json")
    assert f"saved as {kept}" in out
    assert frame.main(["replay", str(kept)]) == Exit.VIOLATED


@pytest.mark.usefixtures("_wrong")
def test_a_generated_program_that_is_refused_is_kept_whole(
    file: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(refinement, "TRIES", 5)
    assert koord("--runs", "200", "--rounds", "3", "--json") == Exit.VIOLATED
    failure = json.loads(capsys.readouterr().out)["failure"]
    kept = Path(failure["saved"]).read_text("utf-8")
    assert koord("--case", str(failure["seed"]), "--rounds", "3") == Exit.VIOLATED
    for part in ("# compiled", "# the core program", "# the recording", str(failure["seed"])):
        assert part in kept


KILLED = """
import os, signal, sys
from koord.refinement import running
from koord.api import refinement
from koord.cli.main import main
from koord.runtime.compile import compiled

def killed(*given, **named):
    os.kill(os.getpid(), signal.SIGKILL)
    yield

if __name__ == "__main__":
    running.compiled = lambda program: compiled(program).replace("+ 2", "+ 1")
    refinement.ever_smaller = killed
    sys.exit(main(sys.argv[1:]))
"""


def test_what_is_found_is_kept_before_it_is_made_smaller(tmp_path: Path) -> None:
    (tmp_path / "app.krd").write_text(TEXT, "utf-8")
    (tmp_path / "killed.py").write_text(KILLED, "utf-8")
    words = ["check-refinement", "app.krd", "--runs", "6", "--seed", "3", "--target", "engine"]
    ran = subprocess.run([sys.executable, "killed.py", *words], cwd=tmp_path, check=False)
    assert ran.returncode == -signal.SIGKILL
    (kept,) = tmp_path.glob("refinement-*")
    assert frame.main(["replay", str(kept)]) == Exit.VIOLATED


@pytest.mark.usefixtures("_wrong", "_hang_ups_count")
@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGINT, Exit.INTERRUPTED),
        (signal.SIGTERM, Exit.TERMINATED),
        (signal.SIGHUP, Exit.HUNG_UP),
    ],
)
def test_who_ends_it_while_it_is_made_smaller_has_what_was_found(
    file: str,
    number: int,
    code: Exit,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def ended(one: Tried, *given: object, **named: object) -> Iterator[Tried]:
        yield replace(one, case=replace(one.case, rounds=1))
        os.kill(os.getpid(), number)
        yield from ever_smaller(one, *given, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(refinement, "ever_smaller", ended)
    assert koord(file, "--runs", "6", "--target", "engine", "--json") == code
    told = capsys.readouterr()
    failure = json.loads(told.out)["failure"]
    assert failure["rounds"] == 1
    assert f"refused and kept: {failure['saved']}" in told.err
    assert frame.main(["replay", failure["saved"]]) == Exit.VIOLATED


@pytest.mark.usefixtures("_wrong")
@pytest.mark.parametrize("words", [(), ("app.krd", "--set", "step=2", "--delta", "1/3")])
def test_the_command_that_is_shown_runs_it_again(
    file: str,
    words: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(refinement, "TRIES", 0)
    Path(file).write_text(
        "param int step = 1\n" + TEXT.replace("sum + 2", "sum + step + 2"), "utf-8"
    )
    flags = ["--runs", "200", "--rounds", "3", "--target", "engine", "--json"]
    assert koord(*words, *flags) == Exit.VIOLATED
    failure = json.loads(capsys.readouterr().out)["failure"]
    start, command, *again = shlex.split(failure["again"])
    assert (start, command) == ("koord", "check-refinement")
    Path(failure["saved"]).unlink()
    assert koord(*again, "--json") == Exit.VIOLATED
    assert json.loads(capsys.readouterr().out)["failure"] == failure | {
        "again": shlex.join(["koord", command, *again])
    }


def test_a_folder_that_is_not_there_is_told_before_anything_runs(
    file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert koord(file, "--save", "nowhere") == Exit.BAD_INPUT
    assert "there is no folder" in capsys.readouterr().err


@pytest.mark.parametrize("runs", ["0", "-1", "x", "1.5", "9999999999"])
def test_a_number_of_runs_is_one(runs: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert koord("--runs", runs) == Exit.BAD_INPUT
    assert "--runs" in capsys.readouterr().err


def test_a_case_is_of_a_generated_program(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert koord("--case", "5") == Exit.OK
    assert capsys.readouterr().out.startswith("engine: 1 run, ")
    assert koord("--case", "5", file) == Exit.BAD_INPUT


def test_a_program_with_errors_is_not_run(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(file).write_text("local:\n  int n = true\n", "utf-8")
    assert koord(file) == Exit.BAD_INPUT
    assert "K204" in capsys.readouterr().err
    assert koord(file, "--json") == Exit.BAD_INPUT
    told = json.loads(capsys.readouterr().out)["diagnostics"]
    assert "K204" in [diagnostic["code"] for diagnostic in told]
