"""`koord merge` and `koord deploy --trace`, as they are called."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import pytest

from koord.api import deployed_parts
from koord.api.merge import Merged
from koord.api.merge import merge as api_merge
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.source import whole_file
from tests.refinement.part_files import lines_of, part_files, write_lines
from tests.sampling import first

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"
SUM = str(EXAMPLES / "sum_of_ids.krd")

COUNT = (
    "allwrite:\n  int sum = 0\nlocal:\n  int mine = 0\n"
    "Add:\n  eff:\n    atomic:\n      sum = sum + 1\n    mine = sum\n    stdout << mine\n"
)

Captured = pytest.CaptureFixture[str]


@pytest.fixture
def three(tmp_path: Path) -> str:
    path = tmp_path / "three.yaml"
    path.write_text("num_robots: 3\ndelta: 0.02\n", encoding="utf-8")
    return str(path)


def merge(folder: Path, *parts: Path, words: tuple[str, ...] = ()) -> int:
    return main(["merge", *map(str, parts), "-o", str(folder / "run.json"), *words])


# --- merging --------------------------------------------------------------------------------------


def test_parts_are_merged_to_what_replay_takes(tmp_path: Path, capsys: Captured) -> None:
    assert merge(tmp_path, *part_files(tmp_path / "parts", COUNT)) == Exit.OK
    run = tmp_path / "run.json"
    assert capsys.readouterr().out == f"{run}: 12 rounds of 3 robots, every step legal\n"
    assert main(["replay", str(run)]) == Exit.OK


def test_what_is_missing_is_told(tmp_path: Path, capsys: Captured) -> None:
    files = part_files(tmp_path / "parts", COUNT)
    files[0].write_bytes(files[0].read_bytes()[:-7])
    write_lines(files[1], [one for one in lines_of(files[1]) if one.get("round", 0) < 4])
    assert merge(tmp_path, *files[:2]) == Exit.UNKNOWN
    assert capsys.readouterr().out.splitlines()[1:] == [
        "  robot 0: it ends in the middle of a line after round 12",
        "  robot 1: it tells nothing after round 4",
        "  there is no part of 2: what is not known is as the program allows",
    ]


def test_rounds_of_which_nobody_tells_are_told(tmp_path: Path, capsys: Captured) -> None:
    (file,) = part_files(tmp_path / "parts", COUNT, robots=1)
    lines = [one for one in lines_of(file) if (one["told"], one.get("round")) != ("acted", 4)]
    write_lines(file, lines)
    assert merge(tmp_path, file) == Exit.UNKNOWN
    told = "  no part tells of round 5: 4 rounds of 12 are in the trace\n"
    assert capsys.readouterr().out.endswith(told)


def test_a_property_that_is_broken_is_told(tmp_path: Path, capsys: Captured) -> None:
    files = part_files(tmp_path / "parts", f"{COUNT}invariant Small: sum < 5\n")
    assert merge(tmp_path, *files) == Exit.VIOLATED
    said = "  it breaks Small in round 5, in the turn of robot 1\n"
    assert said in capsys.readouterr().out
    assert main(["replay", str(tmp_path / "run.json")]) == Exit.VIOLATED
    assert said in capsys.readouterr().out
    assert main(["replay", str(tmp_path / "run.json"), "--json"]) == Exit.VIOLATED
    broken = json.loads(capsys.readouterr().out)["broken"]
    assert broken == {"kind": "property", "name": "Small", "round": 4, "robot": 1}


def test_a_step_that_no_rule_allows_is_told(tmp_path: Path, capsys: Captured) -> None:
    files = part_files(tmp_path / "parts", COUNT)
    lines = lines_of(files[1])
    stood = next(one for one in lines if (one["told"], one.get("round")) == ("stood", 5))
    stood["robot"]["locals"]["mine"] = 77
    write_lines(files[1], lines)
    assert merge(tmp_path, *files) == Exit.VIOLATED
    assert "not legal by ENV-TRANS in round 5" in capsys.readouterr().out
    assert main(["replay", str(tmp_path / "run.json")]) == Exit.VIOLATED


def test_two_decisions_of_a_round_are_a_violation(tmp_path: Path, capsys: Captured) -> None:
    """(I-AGREE)"""
    files = part_files(tmp_path / "parts", COUNT)
    lines = lines_of(files[2])
    acted = next(one for one in lines if (one["told"], one.get("round")) == ("acted", 5))
    acted["digest"] = acted["digest"][::-1]
    write_lines(files[2], lines)
    assert merge(tmp_path, *files) == Exit.VIOLATED
    said = "error K919: robots 0 and 2 acted on different decisions in round 6"
    assert said in capsys.readouterr().err
    assert not (tmp_path / "run.json").exists()


def test_input_that_is_none_is_told(tmp_path: Path, capsys: Captured) -> None:
    files = part_files(tmp_path / "parts", COUNT)
    assert merge(tmp_path, files[0], Path(SUM)) == Exit.BAD_INPUT
    assert f"{SUM}:1:1: error K910" in capsys.readouterr().err
    assert merge(tmp_path, tmp_path / "nothing", words=("--json",)) == Exit.BAD_INPUT
    assert json.loads(capsys.readouterr().out)["diagnostics"][0]["code"] == "K901"
    words = ["merge", str(files[0]), "-o", str(files[0])]
    assert main(words) == Exit.BAD_INPUT
    assert "it is read by the same command" in capsys.readouterr().err


def test_the_answer_as_json(tmp_path: Path, capsys: Captured) -> None:
    files = part_files(tmp_path / "parts", COUNT)
    assert merge(tmp_path, *files[1:], words=("--json",)) == Exit.UNKNOWN
    found = json.loads(capsys.readouterr().out)
    assert (found["rounds"], found["missing"], found["refused"]) == (12, [0], None)
    assert found["parts"][0] == {
        "pid": 1,
        "name": str(files[1]),
        "rounds": 12,
        "end": "left",
        "missed": 0,
    }


def test_a_recording_that_is_damaged_is_told(tmp_path: Path, capsys: Captured) -> None:
    pytest.importorskip("mcap")
    path = tmp_path / "run.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    assert merge(tmp_path, path) == Exit.BAD_INPUT
    assert "error K910: the recording is damaged" in capsys.readouterr().err


# --- robots on this machine -----------------------------------------------------------------------


def test_a_run_of_all_robots_is_judged(three: str, tmp_path: Path, capsys: Captured) -> None:
    run = tmp_path / "run.json"
    words = ["deploy", SUM, three, "--all-local", "--rounds", "6", "--trace", str(run)]
    assert main(words) == Exit.OK
    assert f"{run}: 6 rounds of 3 robots, every step legal\n" in capsys.readouterr().out
    assert main(["replay", str(run)]) == Exit.OK
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.json", "three.yaml"]


def test_what_robots_break_is_told(three: str, tmp_path: Path, capsys: Captured) -> None:
    program, run = tmp_path / "count.krd", tmp_path / "run.json"
    program.write_text(f"{COUNT}invariant Small: sum < 5\n", encoding="utf-8")
    words = ["deploy", str(program), three, "--all-local", "--rounds", "8", "--trace", str(run)]
    assert main([*words, "--json"]) == Exit.VIOLATED
    trace = json.loads(capsys.readouterr().out)["trace"]
    assert (trace["rounds"], trace["broken"]["name"]) == (8, "Small")


def test_starts_are_as_the_program_assumes(three: str, tmp_path: Path, capsys: Captured) -> None:
    """[PROP-ASSUME]"""
    program, run = tmp_path / "p.krd", tmp_path / "run.json"
    text = "local:\n  int x\nUp:\n  eff:\n    x = x + 1\nassume: forall i: x@i == 3\n"
    program.write_text(text, encoding="utf-8")
    words = ["deploy", str(program), three, "--all-local", "--rounds", "3", "--trace", str(run)]
    assert main(words) == Exit.OK, capsys.readouterr()
    assert json.loads(run.read_text("utf-8"))["run"]["initial"]["robots"][1]["locals"]["x"] == 3


def test_a_trace_that_cannot_be_written_is_told_before_robots_run(
    three: str, tmp_path: Path, capsys: Captured
) -> None:
    words = ["deploy", SUM, three, "--all-local", "--trace", str(tmp_path / "no" / "run.json")]
    assert main(words) == Exit.BAD_INPUT
    assert "error K903" in capsys.readouterr().err


@pytest.mark.parametrize("number", first(1, [signal.SIGINT, signal.SIGTERM]), ids=lambda n: n.name)
def test_the_trace_of_a_run_that_is_ended_is_whole(
    three: str, tmp_path: Path, number: signal.Signals
) -> None:
    run = tmp_path / "run.json"
    words = ["deploy", SUM, three, "--all-local", "--trace", str(run)]
    process = subprocess.Popen(
        [sys.executable, "-m", "koord", *words], stdout=subprocess.PIPE, text=True
    )
    part = tmp_path / "run.json.parts" / "2.jsonl"
    end_s = time.monotonic() + 30
    while not (part.exists() and part.read_bytes().count(b'"acted"') > 5):
        assert time.monotonic() < end_s
        time.sleep(0.02)
    process.send_signal(number)
    out, _ = process.communicate(timeout=30)
    assert process.returncode == (Exit.INTERRUPTED if number is signal.SIGINT else Exit.TERMINATED)
    assert "every step legal" in out
    assert main(["replay", str(run)]) == Exit.OK
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.json", "three.yaml"]


@pytest.mark.parametrize("flag", first(1, ["--trace", "--record"]))
def test_what_was_told_in_a_run_that_is_killed_is_kept(
    three: str, flag: str, tmp_path: Path, capsys: Captured
) -> None:
    """Journals that nobody can use any more are not."""
    if flag == "--record":
        pytest.importorskip("mcap")
    file, temporary = tmp_path / "run", tmp_path / "temporary"
    temporary.mkdir()
    words = ["deploy", SUM, three, "--all-local", "--restart", flag, str(file)]
    process = subprocess.Popen(
        [sys.executable, "-m", "koord", *words],
        env={**os.environ, "TMPDIR": str(temporary)},
        stdout=subprocess.DEVNULL,
    )
    parts, end_s = [tmp_path / f"run.parts/{pid}.jsonl" for pid in range(3)], time.monotonic() + 30
    while not all(part.exists() and part.read_bytes().count(b'"acted"') > 5 for part in parts):
        assert time.monotonic() < end_s
        time.sleep(0.02)

    def journals() -> list[str]:
        found = f"koord-{os.getuid()}"  # where `koord estop` finds robots
        return [path.name[:6] for path in temporary.iterdir() if path.name != found]

    assert journals() == ["koord-"]
    process.kill()
    process.wait()
    while journals() or not all(b'"left"' in part.read_bytes() for part in parts):
        assert time.monotonic() < end_s
        time.sleep(0.02)
    assert main([*words, "--rounds", "2"]) == Exit.OK
    aside = tmp_path / "run.parts.1"
    assert f"what its robots told is in {aside}, for `koord merge`" in capsys.readouterr().out
    assert not (tmp_path / "run.parts").exists()
    assert merge(tmp_path, *aside.iterdir()) == Exit.OK


def test_what_a_trace_cannot_tell_is_left_beside_it(
    three: str, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    def merging(files: Iterable[Path], **_: object) -> Merged:
        """Merge parts of which none tells of a round in the middle."""
        for file in files:
            lines = lines_of(file)
            write_lines(
                file, [one for one in lines if (one["told"], one.get("round")) != ("acted", 4)]
            )
        return api_merge(files)

    monkeypatch.setattr(deployed_parts, "merge", merging)
    run = tmp_path / "run.json"
    words = ["deploy", SUM, three, "--all-local", "--rounds", "6", "--trace", str(run)]
    assert main(words) == Exit.UNKNOWN
    assert f"all that robots told is in {run}.parts\n" in capsys.readouterr().out
    assert len(list(tmp_path.glob("run.json.parts/*.jsonl"))) == 3


def test_the_recording_of_a_run_makes_the_same_trace(
    three: str, tmp_path: Path, capsys: Captured
) -> None:
    pytest.importorskip("mcap")
    run, record = tmp_path / "run.json", tmp_path / "run.mcap"
    words = ["deploy", SUM, three, "--all-local", "--rounds", "6", "--record", str(record)]
    assert main([*words, "--trace", str(run)]) == Exit.OK
    again = tmp_path / "again.json"
    assert main(["merge", str(record), "-o", str(again)]) == Exit.OK
    assert again.read_bytes() == run.read_bytes()


def test_a_program_that_is_too_large_to_be_judged_is_recorded(
    three: str, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mcap")
    found = (Diagnostic("K920", Severity.ERROR, whole_file("p.krd"), "it is too large"),)
    monkeypatch.setattr(deployed_parts, "excesses", lambda program, kinds: found)
    words = ["deploy", SUM, three, "--all-local", "--rounds", "2"]
    assert main([*words, "--record", str(tmp_path / "run.mcap")]) == Exit.OK
    assert main(["merge", str(tmp_path / "run.mcap"), "-o", str(tmp_path / "x")]) == Exit.BAD_INPUT
    assert "the recording has no parts of a run" in capsys.readouterr().err
    assert main([*words, "--trace", str(tmp_path / "run.json")]) == Exit.BAD_INPUT
    assert "it is too large" in capsys.readouterr().err
    assert not (tmp_path / "run.json.parts").exists()
