"""``koord replay``: legal or not, and where."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest

from koord.api.traces import read_trace
from koord.cli import main as frame
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.traces import run_codec
from koord.traces.codec import encode
from koord.traces.names import Names
from koord.verify import witness

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

PROGRAM = """\
allwrite:
  int total = 0
local:
  bool done = false
Add:
  pre: not done
  eff:
    atomic: total = total + pid
    done = true
invariant Bounded: total < 100
"""

#: What the trace is a run of, as text and as JSON.
OF = "  a run of sum.krd: 3 robots, δ = 0.1 s\n"
PROBLEM: dict[str, object] = {
    "robots": 3,
    "kinds": None,
    "delta": "1/10",
    "in_text": {"robots": None, "kinds": None, "delta": None},
    "params": {},
    "tasks": None,
    "properties": [],
}


@pytest.fixture
def trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Any:
    """The JSON of a run of three rounds."""
    monkeypatch.chdir(tmp_path)
    Path("sum.krd").write_text(PROGRAM, encoding="utf-8")
    assert frame.main(["run", "sum.krd", "--rounds", "3", "--trace", "t.json"]) == Exit.OK
    capsys.readouterr()
    return json.loads(Path("t.json").read_text("utf-8"))


def replayed(
    capsys: pytest.CaptureFixture[str], trace: object, *words: str
) -> tuple[int, str, str]:
    Path("t.json").write_text(json.dumps(trace), encoding="utf-8")
    code = frame.main(["replay", "t.json", *words])
    streams = capsys.readouterr()
    return code, streams.out, streams.err


def test_a_legal_trace(trace: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """[REPLAY]"""
    assert replayed(capsys, trace) == (
        Exit.OK,
        "t.json: legal: 13 steps, 3 rounds, exact numbers\n" + OF,
        "",
    )


def test_the_first_illegal_step_is_named(trace: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """[REPLAY] [SELECT]: rule, round, robot, event."""
    trace["run"]["rounds"][1]["events"][0] = "Add"
    code, out, _ = replayed(capsys, trace)
    assert code == Exit.VIOLATED
    assert out == (
        "t.json: round 2, robot 0, event Add: not legal by SELECT\n"
        + OF
        + "  the pre of Add does not hold for robot 0\n"
    )


def test_what_differs_is_shown(trace: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """[REPLAY] [CONFIG]: by the rules, and as recorded."""
    trace["run"]["rounds"][2]["after"]["store"]["allwrite"]["total"] = 7
    code, out, _ = replayed(capsys, trace)
    assert code == Exit.VIOLATED
    assert out == (
        "t.json: round 3, the environment's turn: not legal by ENV-TRANS\n"
        + OF
        + "  the configuration recorded is another\n"
        "                                by the rules  recorded\n"
        "  total                         3             7\n"
        "  the copy of total of robot 0  3             7\n"
        "  the copy of total of robot 1  3             7\n"
        "  the copy of total of robot 2  3             7\n"
    )


def test_a_wrong_start(trace: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """[REPLAY] [INIT]"""
    trace["run"]["initial"]["robots"][1]["locals"]["done"] = True
    code, out, _ = replayed(capsys, trace)
    assert code == Exit.VIOLATED
    assert out.startswith("t.json: the start: not legal by INIT\n")
    assert "done of robot 1  false         true" in out


def test_the_answer_as_json(trace: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """[REPLAY]: rounds count from 0, as in traces."""
    code, out, _ = replayed(capsys, trace, "--json")
    assert (code, json.loads(out)) == (
        Exit.OK,
        {
            "version": 1,
            "program": "sum.krd",
            "problem": PROBLEM,
            "legal": True,
            "steps": 13,
            "rounds": 3,
            "refused": None,
        }
        | {"slack": 0.0, "trusted": [], "cut_off": False, "compiled": None},
    )
    trace["run"]["rounds"][1]["after"]["robots"][1]["locals"]["done"] = False
    code, out, _ = replayed(capsys, trace, "--json")
    found = json.loads(out)
    assert code == Exit.VIOLATED
    assert (found["legal"], found["rounds"]) == (False, 1)
    assert found["refused"] == {
        "rule": "ENV-TRANS",
        "round": 1,
        "robot": None,
        "event": None,
        "reason": "the configuration recorded is another",
        "differences": [{"robot": 1, "location": "done", "expected": "true", "recorded": "false"}],
    }


def test_the_compiled_program_runs_it_too(trace: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """[RERUN]"""
    code, out, _ = replayed(capsys, trace, "--compiled")
    assert code == Exit.OK
    assert out.endswith("\n  the compiled program does the same, state for state\n")
    code, out, _ = replayed(capsys, trace, "--compiled", "--json")
    assert (code, json.loads(out)["compiled"]) == (
        Exit.OK,
        {"agrees": True, "departs": None, "unjudged": None},
    )
    trace["run"]["rounds"][2]["after"]["store"]["allwrite"]["total"] = 7
    code, out, _ = replayed(capsys, trace, "--compiled", "--json")
    assert (code, json.loads(out)["compiled"]) == (Exit.VIOLATED, None)  # it is no run at all


def test_where_the_compiled_program_departs_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """[RERUN]: 0.1 + 0.1 + 0.1 is 0.3 in exact numbers alone."""
    monkeypatch.chdir(tmp_path)
    text = "local:\n  float x = 0.0\n  bool is_three = false\n"
    text += "Add:\n  eff:\n    x = x + 0.1\n    is_three = x == 0.3\n"
    text += "invariant Never: not is_three\n"
    Path("x.krd").write_text(text, encoding="utf-8")
    flags = ["--robots", "1", "--trace", "t.json"]
    assert frame.main(["verify", "x.krd", *flags, "--json"]) == Exit.VIOLATED
    (claim,) = (
        c for c in json.loads(capsys.readouterr().out)["reports"][0]["claims"] if c["violated"]
    )
    reason = "it comes to another configuration; it computes with doubles, "
    reason += "and the recording is of exact numbers"
    told = {
        "round": 3,
        "reason": reason,
        "differences": [
            {"robot": 0, "location": "is_three", "recorded": "true", "compiled": "false"}
        ],
    }
    assert claim["violated"]["compiled"] == {"agrees": False, "departs": told, "unjudged": None}
    assert frame.main(["replay", "t.json", "--compiled"]) == Exit.VIOLATED
    assert capsys.readouterr().out == (
        "t.json: legal: 6 steps, 3 rounds, exact numbers\n"
        "  a run of x.krd: 1 robot, δ = 0.1 s\n"
        "  it breaks Never, as it says\n"
        f"  the compiled program departs at round 3: {reason}\n"
        "                       recorded  compiled\n"
        "  is_three of robot 0  true      false\n"
    )
    assert frame.main(["replay", "t.json", "--compiled", "--json"]) == Exit.VIOLATED
    assert json.loads(capsys.readouterr().out)["compiled"]["departs"] == told | {"round": 2}


def test_the_rounds_are_shown_on_demand(trace: Any, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = replayed(capsys, trace, "--show")
    assert code == Exit.OK
    assert "round 2, to t = 0.2 s\n  1     Add   total: 0 → 1, done: false → true\n" in out
    assert out.endswith("\n\nt.json: legal: 13 steps, 3 rounds, exact numbers\n" + OF)


def test_another_program_behind_the_trace(trace: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """[REPLAY]: the same program laid out otherwise does; a changed one does not."""
    Path("other.krd").write_text("# moved\n\n" + PROGRAM, encoding="utf-8")
    assert replayed(capsys, trace, "--program", "other.krd")[0] == Exit.OK
    Path("other.krd").write_text(PROGRAM.replace("+ pid", "+ 2 * pid"), encoding="utf-8")
    code, out, _ = replayed(capsys, trace, "--program", "other.krd")
    assert code == Exit.VIOLATED
    assert "round 2, the environment's turn" in out
    Path("other.krd").write_text(PROGRAM.replace("done", "ready"), encoding="utf-8")
    code, _, err = replayed(capsys, trace, "--program", "other.krd")
    assert code == Exit.BAD_INPUT
    assert "error K914" in err
    assert "the trace may be of another program than other.krd: leave out `--program`" in err
    Path("other.krd").write_text("local:\n  int x = y\n", encoding="utf-8")
    code, _, err = replayed(capsys, trace, "--program", "other.krd")
    assert code == Exit.BAD_INPUT
    assert "other.krd:2:11: error K2" in err
    assert "  2 |   int x = y\n" in err
    Path("other.krd").write_text("invariant P: x > 0\n", encoding="utf-8")
    code, _, err = replayed(capsys, trace, "--program", "other.krd")
    assert (code, "K904" in err) == (Exit.BAD_INPUT, True)


def test_a_program_mended_by_hand_is_told_apart(
    trace: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """[TRACE]: text and digest must agree."""
    trace["program"]["text"] += "\n# later\n"
    code, _, err = replayed(capsys, trace)
    assert code == Exit.BAD_INPUT
    assert err.startswith("t.json: error K915: $.program.text: ")
    assert "= help: undo the change, or name the program behind `--program`" in err


@pytest.mark.parametrize(
    ("text", "code"),
    [("", "K910"), ("{", "K910"), ("[1, 2]", "K911"), ('{"format": "koord trace"}', "K913")],
)
def test_what_is_no_trace(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, code: str
) -> None:
    """[TRACE]: exit 2, and as JSON where JSON was asked for."""
    path = tmp_path / "t.json"
    path.write_text(text, encoding="utf-8")
    assert frame.main(["replay", str(path)]) == Exit.BAD_INPUT
    streams = capsys.readouterr()
    assert f"error {code}: " in streams.err
    assert streams.out == ""
    assert frame.main(["replay", str(path), "--json"]) == Exit.BAD_INPUT
    assert json.loads(capsys.readouterr().out)["diagnostics"][0]["code"] == code


def test_a_trace_from_standard_input(
    trace: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    raw = json.dumps(trace).encode()
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(raw), encoding="utf-8"))
    assert frame.main(["replay", "-"]) == Exit.OK
    assert capsys.readouterr().out.startswith("<stdin>: legal")


def test_a_run_into_a_fault_is_legal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """[REPLAY] [FAULT]: and the end is told."""
    monkeypatch.chdir(tmp_path)
    Path("f.krd").write_text("local:\n  int x\nGo:\n  pre: true\n  eff: x = x + 1\n", "utf-8")
    assert frame.main(["run", "f.krd", "--trace", "t.json"]) == Exit.VIOLATED
    capsys.readouterr()
    assert frame.main(["replay", "t.json"]) == Exit.OK
    out = capsys.readouterr().out
    assert "it ends in a fault of robot 0: read of an unset value (f.krd:5:12)" in out


def test_what_would_not_be_legal_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A counterexample with robots that move behind its fault, as a mistake of koord's."""
    monkeypatch.setattr(witness, "until", lambda recording, last: recording)
    file, kept = tmp_path / "slip.krd", tmp_path / "slip.json"
    file.write_text("local:\n  int n = 0\nGo:\n  pre: 1 / n > 0\n  eff:\n    n = 1\n")
    asked = ["verify", str(file), "--engine", "bmc"]
    assert frame.main([*asked, "--trace", str(kept)]) == Exit.VIOLATED  # [0032]
    told = capsys.readouterr()
    assert "violated in round 1" in told.out
    assert "not legal when it is read again: [FAULT]" in told.err
    assert not kept.exists()
    monkeypatch.undo()
    assert frame.main([*asked, "--trace", str(kept)]) == Exit.VIOLATED
    assert frame.main(["replay", str(kept)]) == Exit.OK


@pytest.mark.parametrize("engine", ["auto", "bmc"])
def test_what_is_kept_is_read_whatever_is_in_it(
    engine: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Params, another δ, a file of properties, answers of functions, maps, large numbers."""
    file, more = tmp_path / "much.krd", tmp_path / "more.krd"
    file.write_text(
        "param int much = 1\n"
        "def fun f(Map<bool, int> m, pos p) -> pos[]: extern\n"
        "using Unit:\n  sensors:\n    bool go\n"
        "allwrite:\n  Map<bool, int> m = {true: 1, false: 2}\n  int top = 0\n"
        "local:\n  pos[] way\n  float x = 0.1\n"
        "Go:\n  pre: go\n  eff:\n    atomic:\n      way = f(m, pos(0.1, 0.2, 0.3))\n"
        "      m[false] = much\n      top = top + much\n      x = x / 3\n"
    )
    more.write_text("invariant Low: top < 2 * much\n")
    for suffix in ("json", "itf.json"):
        kept = tmp_path / f"kept.{suffix}"
        words = ["verify", str(file), "--with", str(more), "--set", f"much={2**70}"]
        words += ["--delta", "1/7", "--robots", "2", "--engine", engine, "--trace", str(kept)]
        assert frame.main(words) == Exit.VIOLATED
        capsys.readouterr()
        assert frame.main(["replay", str(kept), "--compiled"]) == Exit.OK
        said = capsys.readouterr().out
        assert "it breaks Low, as it says" in said
        assert "the compiled program does the same" in said


@pytest.mark.parametrize("command", ["run", "sim"])
def test_each_round_of_a_run_is_encoded_once(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """[TRACE]: what has grown is completed, and is the text that a whole run has."""
    monkeypatch.setattr("koord.api.growing.PERIOD_S", 0.0)
    monkeypatch.setattr("koord.cli.run._PERIOD_S", 0.0)
    encoded = run_codec.encode_configuration
    seen: list[int] = []

    def counted(names: Names, configuration: Configuration[Constant]) -> Any:
        seen.append(configuration.round)
        return encoded(names, configuration)

    monkeypatch.setattr(run_codec, "encode_configuration", counted)
    path = tmp_path / "t.json"
    limit = ["--rounds", "9"] if command == "run" else ["--rounds", "9", "--no-html"]
    program = EXAMPLES / ("hvac.krd" if command == "run" else "follow_path.krd")
    assert main([command, str(program), *limit, "--trace", str(path)]) == Exit.OK
    monkeypatch.undo()
    assert sorted(n for n in seen if n > 0) == list(range(1, 10))
    raw = path.read_bytes()
    assert encode(read_trace(raw, "t.json", None)) == raw
    assert not (tmp_path / "t.part.json").exists()


def test_what_koord_writes_may_be_larger_than_what_people_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "t.json"
    program = str(EXAMPLES / "leader_elect.krd")
    assert main(["run", program, "--rounds", "5", "--trace", str(path)]) == Exit.OK
    monkeypatch.setattr("koord.api.files.LARGEST_FILE", 1000)
    assert path.stat().st_size > 1000
    assert main(["replay", str(path)]) == Exit.OK
    assert "legal" in capsys.readouterr().out
