"""The arguments of ``koord verify`` and ``koord run``, and what precedes the engines."""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from msgspec.structs import replace

import koord
from koord.api.programs import Program
from koord.api.robots import AS_STATED, FleetSize
from koord.api.run import Policy
from koord.api.verify import Engine, Options
from koord.cli import main as frame
from koord.cli import run, verified, verify, watching
from koord.cli.exits import Exit
from tests.sampling import first

GOOD = "local:\n  int x = 0\ngo:\n  pre: x < 3\n  eff: x = x + 1\ninvariant Small: x <= 3\n"


@pytest.fixture
def program(tmp_path: Path) -> str:
    path = tmp_path / "good.krd"
    path.write_text(GOOD, encoding="utf-8")
    return str(path)


def test_each_property_may_have_a_time_limit(
    program: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["verify", program, "--property-timeout"]
    assert frame.main([*words, "600"]) == Exit.OK
    assert "Small     holds" in capsys.readouterr().out
    assert frame.main([*words, "1e-9"]) == Exit.UNKNOWN
    assert "unknown" in capsys.readouterr().out
    assert frame.main([*words, "0"]) == Exit.BAD_INPUT
    assert frame.main([*words, "1", "--jobs", "0"]) == Exit.BAD_INPUT


def test_every_flag_of_verify_arrives(monkeypatch: pytest.MonkeyPatch, program: str) -> None:
    seen: list[tuple[list[str], argparse.Namespace, Options]] = []

    def engine(
        programs: Sequence[Program],
        arguments: argparse.Namespace,
        options: Options,
        *lists: object,
    ) -> Exit:
        seen.append(([loaded.source.name for loaded in programs], arguments, options))
        return Exit.UNKNOWN

    monkeypatch.setattr(verify, "_verified", engine)
    words = ["verify", program, "--robots", "Car=2,Drone=1", "--rounds", "5", "--delta", "1/3"]
    words += ["--engine", "bmc", "--property", "Small", "--timeout", "2.5", "--seed", "9"]
    words += ["--max-violations", "4", "--explain", "--rests-on", "--instants"]
    words += ["--jobs", "3"]
    words += ["--trace", f"{program}.json", "--json"]
    assert frame.main(words) == Exit.UNKNOWN
    ((names, arguments, options),) = seen
    assert names == [program]
    assert arguments.robots == (FleetSize(3, (("Car", 2), ("Drone", 1))),)
    assert (arguments.delta, arguments.trace) == (Fraction(1, 3), f"{program}.json")
    assert (arguments.explain, arguments.json) == (True, True)
    assert (arguments.certificate, arguments.plot, arguments.found) == (None, None, None)
    left_s = options.left_s
    assert left_s is not None
    assert 0 < left_s <= 2.5
    assert replace(options, ends_at=None) == Options(
        rounds=5,
        engine=Engine.BMC,
        properties=("Small",),
        property_timeout_s=None,
        jobs=3,
        max_violations=4,
        seed=9,
        rests_on=True,
        instants=True,
    )


def test_the_defaults_are_those_of_the_documentation(
    monkeypatch: pytest.MonkeyPatch, program: str
) -> None:
    seen: list[tuple[argparse.Namespace, Options]] = []

    def engine(
        loaded: object, arguments: argparse.Namespace, options: Options, *lists: object
    ) -> Exit:
        seen.append((arguments, options))
        return Exit.OK

    monkeypatch.setattr(verify, "_verified", engine)
    assert frame.main(["verify", program]) == Exit.OK
    ((arguments, options),) = seen
    assert (arguments.robots, options.rounds, options.engine) == ((AS_STATED,), 20, Engine.AUTO)
    assert (options.properties, options.ends_at, arguments.trace) == ((), None, None)
    assert 1 <= options.jobs <= (os.cpu_count() or 1)


def test_several_programs_end_with_the_gravest_code(
    monkeypatch: pytest.MonkeyPatch, program: str
) -> None:
    codes = [Exit.OK, Exit.VIOLATED, Exit.UNKNOWN]
    monkeypatch.setattr(verify, "verify_each", lambda questions, *options: iter(questions))
    monkeypatch.setattr(verified, "tell", lambda report, arguments, told: codes.pop())
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
    seen: list[argparse.Namespace] = []

    def machine(loaded: Program, arguments: argparse.Namespace) -> Exit:
        seen.append(arguments)
        return Exit.OK

    monkeypatch.setattr(run, "_run", machine)
    words = ["run", program, "--robots", "2", "--rounds", "0", "--seed", "4"]
    words += ["--policy", "random", "--interactive", "--trace", f"{program}.json", "--delta", "2"]
    assert frame.main(words) == Exit.OK
    (given,) = seen
    assert (given.robots, given.rounds, given.delta) == (FleetSize(2), 0, Fraction(2))
    assert (given.policy, given.seed, given.interactive) == (Policy.RANDOM.value, 4, True)
    assert given.trace == f"{program}.json"


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


# --- reports --------------------------------------------------------------------------------------

RACE = """\
allwrite:
    int x = 0
local:
    int y = 0
Up:
    pre: x < 3
    eff: x = x + 1
Never:
    pre: x < 0
    eff: y = 1
assume: numAgents > 0
invariant Signed: x >= 0
invariant Vain: forall i: y@i == 1 implies x < 0
invariant Short: x < 2
"""

SCHEMA = Path(koord.__file__).parent / "api" / "schemas" / "verdicts.schema.json"


@pytest.fixture
def race(tmp_path: Path) -> str:
    path = tmp_path / "race.krd"
    path.write_text(RACE, encoding="utf-8")
    return str(path)


def valid(text: str) -> list[dict[str, object]]:
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    found = json.loads(text)
    Draft202012Validator(schema).validate(found)
    reports: list[dict[str, object]] = found["reports"]
    return reports


def test_the_schema_describes_every_report(
    capsys: pytest.CaptureFixture[str], race: str, program: str
) -> None:
    assert frame.main(["verify", "--json", "--rounds", "3", race, program]) == Exit.VIOLATED
    first, second = valid(capsys.readouterr().out)
    assert (first["program"], first["outcome"]) == (race, "violated")
    assert second["program"] == program
    told = {v["subject"]: v["certain"] for v in first["vacuities"]}  # type: ignore[attr-defined]
    assert told == {"Never": True, "Vain": True}


def test_what_proofs_rest_on_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "app.krd"
    path.write_text(
        "local:\n  int x\n  int y\n\nGo:\n  pre: x < 9\n  eff: x = x + 1\n\n"
        "assume: forall i: y@i == 0\nassume: forall i: x@i == 0\n"
        "invariant Low: forall i: x@i >= 0\n",
        encoding="utf-8",
    )
    assert frame.main(["verify", str(path), "--rests-on"]) == Exit.OK
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    needed = lines.index("what holds in every round rests on:")
    spare = lines.index("and not on:")
    assert lines[needed + 1].endswith("assume: forall i: x@i == 0")
    assert lines[spare + 1].endswith("assume: forall i: y@i == 0")
    assert frame.main(["verify", str(path), "--rests-on", "--json"]) == Exit.OK
    (report,) = valid(capsys.readouterr().out)
    told: Any = report["rests_on"]
    assert [premise["place"] for premise in told["needed"]] == [f"{path}:10:9"]
    assert [premise["place"] for premise in told["spare"]] == [f"{path}:9:9"]


def test_worst_paths_are_told_by_event(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "app.krd"
    path.write_text(
        "local:\n  int x = 0\n  List<int> seen = []\n"
        "Go:\n  pre: x < 9\n  eff:\n    if x > 5:\n      x = x + x\n    else:\n      x = 6\n"
        "Sum:\n  pre: x > 100\n  eff:\n    for k in seen:\n      x = x + k\n"
        "invariant Low: forall i: x@i >= 0\n",
        encoding="utf-8",
    )
    assert frame.main(["verify", str(path), "--wcet"]) in (Exit.OK, Exit.VACUOUS)
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    at = next(k for k, line in enumerate(lines) if line.startswith("execution times"))
    go, way, total, why = lines[at + 1 : at + 5]
    assert re.fullmatch(r"Go\s+≤\s+\d+ steps  median \d+ µs, longest \d+ µs of \d+ turns", go)
    assert way == "worst path: line 7 then"
    assert re.fullmatch(r"Sum\s+≥\s+\d+ steps  never ran", total)
    assert why == "no bound: what the loop at line 14 goes through may grow"
    file = str(path)
    for words in ([file, "--robots", "1..3"], [file, "--robots", "any"], [file, file]):
        assert frame.main(["verify", "--wcet", *words]) == Exit.BAD_INPUT
        assert "--wcet takes one program and one number of robots" in capsys.readouterr().err


@pytest.mark.slow
def test_a_sweep_is_a_row_for_each_number_of_robots(
    capsys: pytest.CaptureFixture[str], race: str
) -> None:
    words = ["verify", race, "--robots", "1..3", "--rounds", "3"]
    assert frame.main(words) == Exit.VIOLATED
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[3:]]
    assert [row[:5] for row in rows] == [
        ["1", "violated", "in", "round", "2"],
        ["2", "violated", "in", "round", "1"],
        ["3", "violated", "in", "round", "1"],
    ]
    few = ["verify", race, "--robots", "1..2", "--rounds", "3", "--property", "Short"]
    assert frame.main([*few, "--json"]) == Exit.VIOLATED
    reports = valid(capsys.readouterr().out)
    assert [report["robots"] for report in reports] == [1, 2]


@pytest.mark.parametrize("kind", first(1, ["svg", "png", "pdf"]))
def test_a_sweep_is_drawn(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, race: str, kind: str
) -> None:
    pytest.importorskip("matplotlib")
    path = tmp_path / f"times.{kind}"
    words = ["verify", race, "--robots", "1..2", "--rounds", "1", "--property", "Short"]
    words += ["--plot", str(path)]
    assert frame.main(words) == Exit.VIOLATED
    starts = {"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}
    assert path.read_bytes().startswith(starts[kind])
    assert "violated in round 2" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--robots", "3..2"], "'3..2' has no number of robots; write 2..3"),
        (["--robots", "1..2", "--trace", "t.json"], "--trace takes one number of robots at a time"),
        (["--plot", "t.svg"], "--plot takes one program and a sweep"),
        (["--robots", "1..2", "--plot", "t.doc"], "'t.doc' is no picture"),
        (["--robots", "1..2", "--plot", "/none/t.svg"], "there is no folder /none"),
    ],
)
def test_sweeps_that_cannot_be(
    capsys: pytest.CaptureFixture[str], race: str, words: list[str], told: str
) -> None:
    assert frame.main(["verify", race, *words]) == Exit.BAD_INPUT
    assert told in capsys.readouterr().err


TWICE = """
local:
  int x
  int y
Break:
  pre: y == 0
  eff: x = 1
Wait:
  pre: y < 2
  eff: y = y + 1
Ruin:
  pre: y == 2
  eff: x = 2
assume: forall i: x@i == 0 and y@i == 0
invariant Whole: forall i: x@i == 0
eventually Never: forall i: x@i == 7
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "told", "ways"),
    first(
        1,
        [
            (["5", "--rounds", "3"], "2 ways to break it: there is no other within the bound", 2),
            (["2", "--rounds", "3"], "2 of 2 ways", 2),
            (["5", "--rounds", "2"], "1 way to break it: there is no other within the bound", 1),
        ],
    ),
)
def test_how_many_ways_there_are_is_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, words: list[str], told: str, ways: int
) -> None:
    path = tmp_path / "twice.krd"
    path.write_text(TWICE, encoding="utf-8")
    asked = ["verify", str(path), "--robots", "1", "--max-violations", *words]
    assert frame.main(asked) == Exit.VIOLATED
    out = capsys.readouterr().out
    assert told in out
    assert ("there is no other" in out) == ("there is no other" in told)
    assert "1 way to break it; there may be more: of runs without end one is looked for" in out
    assert frame.main([*asked, "--json"]) == Exit.VIOLATED
    (report,) = valid(capsys.readouterr().out)
    claims: Any = report["claims"]
    found = {claim["name"]: claim["ways"] for claim in claims}
    complete = "there is no other" in told
    assert found["Whole"] == {"found": ways, "complete": complete, "reason": None}
    assert found["no fault"] is None
    assert found["Never"]["complete"] is False


# --- watching -------------------------------------------------------------------------------------


def test_a_program_is_verified_again_when_it_is_saved(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, race: str
) -> None:
    """Also if it was wrong or gone in between, as while an editor saves it."""
    mended = RACE.replace("invariant Short: x < 2\n", "").replace("eff: x =", "eff: atomic: x =")
    texts = iter([RACE + "invariant Wrong: z\n", None, mended])

    def edit(seconds: float) -> None:
        text = next(texts, "")
        if text == "":
            raise KeyboardInterrupt
        path = Path(race)
        if text is None:
            path.unlink()
        else:
            path.write_text(text, encoding="utf-8")

    monkeypatch.setattr(verify, "watched", partial(watching.watched, pause=edit))
    assert frame.main(["verify", race, "--rounds", "3", "--watch"]) == Exit.VACUOUS
    streams = capsys.readouterr()
    outcomes = [line.split(":")[0] for line in streams.out.splitlines() if " claims, " in line]
    assert outcomes == ["violated", "holds, but vacuously"]
    assert "error K2" in streams.err
    assert streams.err.count("watching; Ctrl-C ends it") == 3


def test_standard_input_cannot_be_watched(capsys: pytest.CaptureFixture[str]) -> None:
    assert frame.main(["verify", "-", "--watch"]) == Exit.BAD_INPUT
    assert "--watch needs files" in capsys.readouterr().err


# --- between rounds -------------------------------------------------------------------------------

CROSSING = Path(__file__).parents[2] / "specs" / "examples" / "broken" / "crossing.krd"


@pytest.mark.slow
def test_instants_are_told_like_any_claim(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """[ENV-INSTANT]: as JSON by the schema, with a trace of the run in which it happens."""
    trace = tmp_path / "t.json"
    words = [
        "verify",
        str(CROSSING),
        "--robots",
        "2",
        "--instants",
        "--json",
        "--trace",
        str(trace),
    ]
    assert frame.main(words) == Exit.VIOLATED
    (report,) = valid(capsys.readouterr().out)
    told: Any = report["claims"]
    claims = {claim["name"]: claim["outcome"] for claim in told}
    assert claims["Apart"] == "holds"
    assert claims["Apart between rounds"] == "violated"
    assert frame.main(["replay", str(trace)]) == Exit.OK
    assert "legal" in capsys.readouterr().out


def test_an_instant_is_shown_with_its_time(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["verify", str(CROSSING), "--robots", "2", "--instants"]
    words += ["--property", "Apart between rounds"]
    assert frame.main(words) == Exit.VIOLATED
    shown = capsys.readouterr().out
    assert "s into the environment's turn" in shown
    assert "violated: 1 of 1 claim" in shown


def test_programs_without_sensors_have_no_instants(
    capsys: pytest.CaptureFixture[str], program: str
) -> None:
    assert frame.main(["verify", program, "--instants"]) == Exit.OK
    assert "no invariant reads a sensor" in capsys.readouterr().err


# --- vacuity --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_branches_that_exclude_each_other_promised_at_once_are_vacuous(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A post-condition as the conjunction of its branches: all runs end where it is wanted."""
    path = tmp_path / "branches.krd"
    text = """
using Body:
  sensors:
    float x = 0.0
  actuators:
    bool up = false
  contract Moves:
    ensures: up and x' == x + 1.0
    ensures: not up and x' == x - 1.0
Flip:
  eff: Body.up = not Body.up
invariant Small: Body.x <= 3.0
"""
    path.write_text(text, encoding="utf-8")
    assert frame.main(["verify", str(path)]) == Exit.VACUOUS
    assert "vacuous: contracts: no run gets through round 1" in capsys.readouterr().out
    branches = text.replace("up and x' ==", "up implies x' ==")
    path.write_text(branches, encoding="utf-8")
    assert frame.main(["verify", str(path), "--rounds", "5"]) == Exit.VIOLATED


@pytest.mark.parametrize("flag", ["--trace", "--certificate", "--save-invariants", "-o"])
def test_a_program_is_not_written_over(
    program: str, capsys: pytest.CaptureFixture[str], flag: str
) -> None:
    export = ["--export", "smt2"] if flag == "-o" else []
    assert frame.main(["verify", program, flag, program, *export]) == Exit.BAD_INPUT
    assert "it is read by the same command" in capsys.readouterr().err
    assert Path(program).read_text("utf-8") == GOOD


def test_an_output_without_an_export_is_refused(
    program: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert frame.main(["verify", program, "-o", f"{program}.smt2"]) == Exit.BAD_INPUT
    assert "-o says where --export writes to" in capsys.readouterr().err


def test_robots_from_here_on_without_an_end(
    program: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert frame.main(["verify", program, "--robots", "2.."]) == Exit.BAD_INPUT
    assert "'2..' is no sweep; write 2..10, or any" in capsys.readouterr().err


def timeless(text: str) -> Any:
    """What was printed as JSON, without times."""

    def without(found: Any) -> Any:
        if isinstance(found, dict):
            return {key: without(value) for key, value in found.items() if key != "seconds"}
        return [without(each) for each in found] if isinstance(found, list) else found

    return without(json.loads(text))


@pytest.mark.slow
@pytest.mark.parametrize(
    "flags",
    first(
        1,
        [(["--robots", "1..2"],), (["--robots", "2", "--engine", "bmc", "--max-violations", "2"],)],
    ),
    ids=["numbers of robots", "programs"],
)
def test_what_is_printed_does_not_hang_on_how_many_processes_there_are(
    flags: Sequence[str], program: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.krd"
    other.write_text(GOOD + "invariant Wrong: x <= 1\ninvariant Rare: x < 3\n", encoding="utf-8")
    told = []
    for jobs in ("1", "3"):
        words = ["verify", program, str(other), *flags, "--json", "--jobs", jobs]
        assert frame.main(words) == Exit.VIOLATED
        told.append(timeless(capsys.readouterr().out))
    assert told[0] == told[1]
    robots = {(report["program"], report["robots"]) for report in told[0]["reports"]}
    assert len(robots) == len(told[0]["reports"]) == (4 if "1..2" in flags else 2)


def test_a_misspelt_name_is_told_by_whichever_process_meets_it(
    program: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["verify", program, "--robots", "1..3", "--property", "Smal", "--jobs", "2"]
    assert frame.main(words) == Exit.BAD_INPUT
    assert "there is no 'Smal'" in capsys.readouterr().err


@pytest.mark.slow
def test_instants_may_have_a_time_limit_for_each_property(
    capsys: pytest.CaptureFixture[str],
) -> None:
    crossing = str(Path(__file__).parents[2] / "specs/examples/broken/crossing.krd")
    words = ["verify", crossing, "--robots", "2", "--rounds", "3", "--instants", "--json"]
    told = []
    for more in ((), ("--property-timeout", "600", "--jobs", "2")):
        assert frame.main([*words, *more]) == Exit.VIOLATED
        told.append(timeless(capsys.readouterr().out))
    assert told[0]["reports"][0]["claims"] == told[1]["reports"][0]["claims"]


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are kept by Linux")
@pytest.mark.parametrize("megabytes", [65, 85])
def test_too_little_memory_is_told(tmp_path: Path, megabytes: int) -> None:
    """Not even the engines can be loaded: no crash, and no mistake of koord's."""
    (tmp_path / "p.krd").write_text("local:\n    int x = 0\n\nA:\n    eff: x = 1\n")
    text = (
        f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({megabytes}_000_000,) * 2);"
        "from koord.cli.main import main; raise SystemExit(main(['verify', 'p.krd']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", text], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == Exit.NO_MEMORY
    assert done.stderr.startswith("koord: there is too little memory to go on: it may have")
    assert done.stderr.count("\n") == 1


def test_an_engine_that_fails_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the reasons, in a line of its own and as JSON; the exit code is that of the verdicts."""
    from koord.verify.engines.bits.engine import BitsEngine

    def work(self: BitsEngine, ledger: object, task: object) -> None:
        raise AssertionError("made to fail")

    monkeypatch.setattr(BitsEngine, "work", work)
    path = tmp_path / "p.krd"
    path.write_text("local:\n    int x = 0\n\nA:\n    eff: x = 1\n\ninvariant P: x < 2\n")
    assert frame.main(["verify", str(path), "--engine", "bits"]) == Exit.UNKNOWN
    shown = capsys.readouterr().out
    assert "      bits failed: AssertionError: made to fail (" in shown
    assert "  failed: bits, others were asked instead: AssertionError: made to fail (" in shown
    assert "this is a mistake in koord" in shown
    assert frame.main(["verify", str(path), "--engine", "bits", "--json"]) == Exit.UNKNOWN
    (report,) = json.loads(capsys.readouterr().out)["reports"]
    assert report["failures"]  # claims that are asked on slices of their own fail by themselves
    for failure in report["failures"]:
        assert failure["who"] == "bits"
        assert failure["what"] == "AssertionError: made to fail"
        assert failure["place"].startswith("koord/verify/")


# --- kept verdicts --------------------------------------------------------------------------------


def test_what_is_kept_is_told_as_such(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, race: str, tmp_path: Path
) -> None:
    """Only with --cache, or while files are watched: otherwise verdicts are found anew."""
    monkeypatch.setenv("KOORD_CACHE", str(tmp_path / "kept"))
    asked = ["verify", race, "--rounds", "3"]
    codes = [frame.main([*asked, *more]) for more in ([], ["--cache"], ["--cache"], [])]
    assert len(set(codes)) == 1
    told = capsys.readouterr().out.split("\n\n")
    marked = [" kept\n" in f"{table}\n" for table in told if "no fault" in table]
    assert marked == [False, False, True, False]
    assert frame.main([*asked, "--cache", "--json"]) == codes[0]
    (report,) = json.loads(capsys.readouterr().out)["reports"]
    assert all(claim["kept"] for claim in report["claims"])


def test_the_cache_is_shown_and_cleared(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, race: str, tmp_path: Path
) -> None:
    folder = tmp_path / "kept"
    monkeypatch.setenv("KOORD_CACHE", str(folder))
    assert frame.main(["cache"]) == Exit.OK
    assert capsys.readouterr().out == f"{folder}: 0 entries, 0.0 MiB\n"
    frame.main(["verify", race, "--rounds", "3", "--cache"])
    capsys.readouterr()
    assert frame.main(["cache", "--json"]) == Exit.OK
    use = json.loads(capsys.readouterr().out)
    assert use["entries"] > 0
    assert frame.main(["cache", "--clear"]) == Exit.OK
    assert f"removed {use['entries']} entries" in capsys.readouterr().out
    assert not folder.exists()


def test_a_damaged_entry_is_told_of_and_found_out_anew(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, race: str, tmp_path: Path
) -> None:
    monkeypatch.setenv("KOORD_CACHE", str(tmp_path / "kept"))
    code = frame.main(["verify", race, "--rounds", "3", "--cache"])
    for path in (tmp_path / "kept").rglob("*.json"):
        path.write_text("nothing")
    capsys.readouterr()
    assert frame.main(["verify", race, "--rounds", "3", "--cache"]) == code
    streams = capsys.readouterr()
    assert "a kept verdict is damaged, and was removed" in streams.err
    assert " kept\n" not in streams.out
