"""``koord run``: the table, how a run ends, the trace it leaves, and runs by hand."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import pytest

from koord.cli import main as frame
from koord.cli import run
from koord.cli.exits import Exit
from koord.cli.terminal import cells

EXAMPLES = Path(__file__).parents[2] / "specs/examples"

SUM = """\
allwrite:
  int total = 0
local:
  bool done = false
Add:
  pre: not done
  eff:
    atomic: total = total + pid
    done = true
    stdout << "total " << total
End:
  pre: done and total * 2 == numAgents * (numAgents - 1)
  eff: stop
invariant Bounded: total * 2 <= numAgents * (numAgents - 1)
"""

RACE = """\
allwrite:
  int count = 0
local:
  bool done = false
Add:
  pre: not done
  eff:
    count = count + 1
    done = true
invariant Counted: (forall i: done@i) implies count == numAgents
"""

FAULT = """\
local:
  int[] xs = [1, 2]
  int x = 0
Look:
  pre: true
  eff: x = xs[x] + x
"""

FREE = """\
using Rail:
  sensors:
    float x
  contract Slow:
    ensures: x' == x + 1
local:
  string name = "a\\tb"
Idle:
  pre: false
  eff: name = ""
assume: Rail.x == 2 * pid + 1
"""

KINDS = """\
agent Car:
  local:
    int fuel = 2
  Drive:
    pre: fuel > 0
    eff: fuel = fuel - 1
agent Drone:
  local:
    int height = 0
  Climb:
    pre: true
    eff: height = height + 1
"""


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the programs, and the one that commands run in."""
    monkeypatch.chdir(tmp_path)
    for name, text in (
        ("sum", SUM),
        ("race", RACE),
        ("fault", FAULT),
        ("free", FREE),
        ("kinds", KINDS),
    ):
        (tmp_path / f"{name}.krd").write_text(text, encoding="utf-8")
    return tmp_path


@pytest.fixture
def koord(
    write: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Koord:
    return Koord(capsys, monkeypatch)


class Koord:
    """The command line: what it prints, and its exit code."""

    def __init__(self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        self.capsys = capsys
        self.monkeypatch = monkeypatch
        self.err = ""

    def __call__(self, *words: str, typed: str | None = None) -> tuple[int, str]:
        if typed is not None:
            self.monkeypatch.setattr("sys.stdin", io.StringIO(typed))
        code = frame.main(list(words))
        streams = self.capsys.readouterr()
        self.err = streams.err
        return code, streams.out


# --- the table ----------------------------------------------------------------------------------


def test_a_run_as_a_table(koord: Koord) -> None:
    """[EVENT-TRANS] [ATOMIC] [OUTPUT] [STOP]: who ran what, what changed, who lost a lock."""
    code, out = koord("run", "sum.krd", "--robots", "2", "--rounds", "9")
    assert code == Exit.OK
    assert out == (
        "sum.krd: 2 robots, δ = 0.1 s, policy first, seed 0\n"
        "start\n"
        "  all  total = 0\n"
        "  0    done = false\n"
        "  1    done = false\n"
        "round 1, to t = 0.1 s\n"
        "  0  Add   done: false → true\n"
        "           stdout << total 0\n"
        "  1  skip  Add lost its lock\n"
        "round 2, to t = 0.2 s\n"
        "  1  Add   total: 0 → 1, done: false → true\n"
        "           stdout << total 1\n"
        "  0  skip\n"
        "round 3, to t = 0.3 s\n"
        "  0  End  status: running → stopped\n"
        "  1  End  status: running → stopped\n"
        "\n"
        "done: 3 rounds, and then every robot has stopped, no fault; 1 invariant held\n"
    )


def test_what_holds_nothing_is_named_last(koord: Koord, write: Path) -> None:
    """[ATOM]: of all that a robot has, in one clause."""
    text = "using Motion\nlocal:\n  int a\n  int b = 1\n  int c\n"
    text += "Go:\n  eff: a = b\n       c = a\n       Motion.target = pos(a, b, c)\n"
    (write / "some.krd").write_text(text, encoding="utf-8")
    _, out = koord("run", "some.krd", "--robots", "1", "--rounds", "1")
    assert "  0  b = 1, a, c and Motion.target are unset\n" in out
    (write / "one.krd").write_text("local:\n  int a\nGo:\n  eff: a = 1\n", encoding="utf-8")
    _, out = koord("run", "one.krd", "--robots", "1", "--rounds", "1")
    assert "  0  a is unset\n" in out


def test_rounds_in_which_nothing_happens_are_told_together(koord: Koord) -> None:
    """[SKIP]"""
    code, out = koord("run", "race.krd", "--robots", "1", "--rounds", "7")
    assert code == Exit.OK
    assert "round 1, to t = 0.1 s\n  0  Add  count: 0 → 1, done: false → true\n" in out
    assert "rounds 2 to 7: everyone skips, nothing changes\n" in out


def test_a_violation_ends_the_run_and_is_shown_in_the_text(koord: Koord) -> None:
    """[PROP-INVARIANT]: exit 1, with the step that broke it."""
    code, out = koord("run", "race.krd", "--robots", "2")
    assert code == Exit.VIOLATED
    assert out.endswith(
        "\n"
        "violated: Counted does not hold, in round 1, after robot 1 ran Add\n"
        "  race.krd:10:1\n"
        "  10 | invariant Counted: (forall i: done@i) implies count == numAgents\n"
        "     | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^\n"
    )


def test_a_fault_ends_the_run_and_is_shown_in_the_text(koord: Koord) -> None:
    """[FAULT]: exit 1, with its place."""
    code, out = koord("run", "fault.krd", "--robots", "1")
    assert code == Exit.VIOLATED
    assert "  0  Look  x: 0 → 1\n" in out
    assert "  0  Look  x: 1 → 3\n" in out
    assert "  fault: robot 0: index out of range\n" in out
    assert "\nfault: index out of range of robot 0, in round 3\n  fault.krd:6:" in out
    assert "  6 |   eff: x = xs[x] + x\n" in out


def test_readings_and_models_are_changes_of_the_environment(koord: Koord) -> None:
    """[ENV-TRANS] [ENV-CONTRACT] [PROP-ASSUME]"""
    code, out = koord("run", "free.krd", "--robots", "2", "--rounds", "2", "--delta", "1/3")
    assert code == Exit.OK
    assert "Rail.x = 3\n" in out
    assert "round 2, to t = 2/3 s\n" in out
    assert re.search(r"^  env +Rail.x@0: 2 → 3, Rail.x@1: 4 → 5$", out, re.M)
    assert "\t" not in out


def test_assumptions_that_nothing_meets_end_in_an_error(koord: Koord, write: Path) -> None:
    """[PROP-ASSUME]: exit 2, with the line."""
    (write / "odd.krd").write_text(FREE + "assume: Rail.x < 0\n", encoding="utf-8")
    code, out = koord("run", "odd.krd")
    assert code == Exit.BAD_INPUT
    assert "error K920: no initial configuration was found" in koord.err
    assert "assume: Rail.x" in koord.err
    assert out.count("\n") == 1


def test_an_assumption_that_is_false_beforehand_is_told_at_once(koord: Koord, write: Path) -> None:
    """[PROP-ASSUME]: of so many robots; nothing is tried."""
    assumed = "assume: forall i: Rail.x@i >= 0 and numAgents > 4\n"
    (write / "few.krd").write_text(FREE + assumed, encoding="utf-8")
    code, _ = koord("run", "few.krd", "--robots", "4")
    assert code == Exit.BAD_INPUT
    assert "this assumption is false of 4 robots, whatever the variables start with" in koord.err
    assert "few.krd:12:37" in koord.err
    assert koord("run", "few.krd", "--robots", "5", "--rounds", "1")[0] == Exit.OK


def test_kinds_of_robots(koord: Koord) -> None:
    """[CONFIG]"""
    code, out = koord("run", "kinds.krd", "--robots", "Car=1,Drone=2", "--rounds", "1")
    assert code == Exit.OK
    assert out.startswith("kinds.krd: 3 robots (1 Car, 2 Drone), δ = 0.1 s")
    assert "  0 Car    Drive  fuel: 2 → 1\n" in out
    assert "  2 Drone  Climb  height: 0 → 1\n" in out
    code, _ = koord("run", "kinds.krd", "--robots", "Boat=1")
    assert code == Exit.BAD_INPUT
    assert "there is no agent Boat here; there are Car, Drone" in koord.err


def test_params_are_set(koord: Koord, write: Path) -> None:
    (write / "p.krd").write_text(
        "param int most = 1\nlocal:\n  int x = most\nGo:\n  pre: true\n  eff: x = x + most\n",
        encoding="utf-8",
    )
    code, out = koord("run", "p.krd", "--set", "most=20", "--rounds", "1", "--robots", "1")
    assert code == Exit.OK
    assert "x: 20 → 40" in out


def test_the_random_policy_hangs_on_the_seed(koord: Koord) -> None:
    """[EVENT-TRANS]"""
    words = ("run", "sum.krd", "--policy", "random", "--rounds", "8")
    first = koord(*words, "--seed", "1")
    assert koord(*words, "--seed", "1") == first
    assert any(koord(*words, "--seed", str(seed))[1][80:] != first[1][80:] for seed in range(2, 6))


def test_doubles_on_demand(koord: Koord, write: Path) -> None:
    """[DOMAIN]"""
    (write / "d.krd").write_text(
        "local:\n  float x = 0.1\nGo:\n  pre: true\n  eff: x = x * 3\n", encoding="utf-8"
    )
    exact = koord("run", "d.krd", "--robots", "1", "--rounds", "1", "--json")[1]
    double = koord(
        "run", "d.krd", "--robots", "1", "--rounds", "1", "--json", "--numbers", "double"
    )
    assert '"x": "3/10"' in exact
    assert '"x": 0.30000000000000004' in double[1]


@pytest.mark.parametrize("name", ["hvac", "task", "waypoints", "follow_path", "fischer"])
def test_tables_fit_a_hundred_columns(
    koord: Koord, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(EXAMPLES)  # headings name files, whose paths may be of any length
    code, out = koord("run", f"{name}.krd", "--rounds", "5", "--robots", "4")
    assert code in (Exit.OK, Exit.VIOLATED)
    assert max(cells(line) for line in out.splitlines()) <= 100
    assert "\x1b" not in out
    assert all(line == line.rstrip() for line in out.splitlines())


def test_no_rounds_show_the_start(koord: Koord) -> None:
    """[INIT]"""
    code, out = koord("run", "sum.krd", "--rounds", "0")
    assert code == Exit.OK
    assert out.endswith("\n\ndone: 0 rounds, no fault; 1 invariant held\n")


# --- traces -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["t.json", "t.itf.json"])
def test_a_trace_is_written_and_replays(koord: Koord, write: Path, name: str) -> None:
    """[TRACE] [REPLAY]"""
    assert koord("run", "sum.krd", "--trace", name)[0] == Exit.OK
    document = json.loads((write / name).read_text("utf-8"))
    assert ("vars" in document) == name.endswith(".itf.json")
    code, out = koord("replay", name)
    assert (code, out) == (
        Exit.OK,
        f"{name}: legal: 17 steps, 4 rounds, exact numbers\n"
        "  a run of sum.krd: 3 robots, δ = 0.1 s\n",
    )


def test_json_is_the_trace(koord: Koord, write: Path) -> None:
    """[TRACE]: byte for byte what --trace writes, so that it can be piped into replay."""
    code, out = koord("run", "race.krd", "--json", "--trace", "t.json", "--set", "x=1")
    assert code == Exit.BAD_INPUT
    assert json.loads(out)["errors"] == 1
    code, out = koord("run", "race.krd", "--json", "--trace", "t.json")
    assert code == Exit.VIOLATED
    assert out == (write / "t.json").read_text("utf-8")
    assert json.loads(out)["run"]["violation"]["name"] == "Counted"


def test_properties_travel_with_the_trace(koord: Koord, write: Path) -> None:
    """[TRACE]"""
    (write / "props.krd").write_text("invariant Three: total < 3\n", encoding="utf-8")
    code, out = koord("run", "sum.krd", "--with", "props.krd", "--trace", "t.json")
    assert code == Exit.VIOLATED
    assert (
        "violated: Three does not hold, in round 3, after robot 2 ran Add\n  props.krd:1:1" in out
    )
    (write / "props.krd").unlink()
    (write / "sum.krd").unlink()
    code, out = koord("replay", "t.json")
    assert code == Exit.OK
    assert "it breaks Three, as it says" in out


def test_a_run_that_is_interrupted_keeps_its_trace(
    koord: Koord, write: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """[RECORDING]: Ctrl-C ends it in good order, even inside a round."""

    class Impatient:
        requested = True

        def __enter__(self) -> Impatient:
            return self

        def __exit__(self, *story: object) -> None:
            return None

    monkeypatch.setattr(run, "Interruption", Impatient)
    code, out = koord("run", "sum.krd", "--trace", "t.json")
    assert code == Exit.INTERRUPTED
    assert "interrupted after 0 rounds" in out
    document = json.loads((write / "t.json").read_text("utf-8"))
    assert document["run"]["rounds"] == []
    assert koord("replay", "t.json")[0] == Exit.OK


# --- by hand ------------------------------------------------------------------------------------


def test_turns_are_picked_by_number(koord: Koord) -> None:
    """[EVENT-TRANS] [SELECT]: in any order, with the rest left to the runtime's choice."""
    words = ("run", "sum.krd", "--interactive", "--robots", "3", "--rounds", "2")
    code, out = koord(*words, "--trace", "t.json", typed="5\n2\n\n1\nr\n")
    assert code == Exit.OK
    assert re.findall(r"^ +\d+  robot .*$", out, re.M)[:6] == [
        "    1  robot 0: Add",
        "    2  robot 0: skip",
        "    3  robot 1: Add",
        "    4  robot 1: skip",
        "    5  robot 2: Add",
        "    6  robot 2: skip",
    ]
    document = json.loads(Path("t.json").read_text("utf-8"))
    first, second = document["run"]["rounds"]
    # Robots 0 and 1 may not add any more in the first round: they are told, and can only skip.
    assert (first["order"], first["events"]) == ([2, 1, 0], [None, None, "Add"])
    assert out.count("       robot 0: Add (its lock is taken)\n") == 2
    assert (second["order"], second["events"]) == ([0, 1, 2], ["Add", None, None])
    assert koord("replay", "t.json")[0] == Exit.OK


def test_steps_are_taken_back(koord: Koord) -> None:
    """[RECORDING]: across the end of a round too."""
    typed = "u\n1\n1\nu\nu\nu\n2\nq\n"
    words = ("run", "sum.krd", "--interactive", "--robots", "2", "--trace", "t.json")
    code, out = koord(*words, typed=typed)
    assert code == Exit.OK
    assert out.count("undone") == 2
    assert out.count("there is nothing to undo") == 2
    (only,) = json.loads(Path("t.json").read_text("utf-8"))["run"]["rounds"]
    assert (only["order"], only["events"], only["cut"]) == ([0], [None, None], True)


def test_a_violation_can_be_played_into(koord: Koord) -> None:
    """[PROP-INVARIANT]"""
    code, out = koord("run", "race.krd", "--interactive", "--robots", "2", typed="1\n1\n")
    assert code == Exit.VIOLATED
    assert "violated: Counted does not hold, in round 1, after robot 1 ran Add" in out


@pytest.mark.parametrize("typed", ["", "q\n", "h\ns\nnonsense\n0\n99\n-1\n" + "9" * 50 + "\n"])
def test_the_end_of_the_input_ends_the_run(koord: Koord, typed: str) -> None:
    code, out = koord("run", "sum.krd", "--interactive", typed=typed)
    assert code == Exit.OK
    assert out.endswith("done: 0 rounds, no fault; 1 invariant held\n")
    if "nonsense" in typed:
        assert out.count("is none of the numbers") == 5
        assert "  u          undo the last step\n" in out


def test_hand_and_json_do_not_go_together(koord: Koord) -> None:
    assert koord("run", "sum.krd", "--interactive", "--json")[0] == Exit.BAD_INPUT
    assert "--interactive and --json do not go together" in koord.err


# --- the instance that a program states -----------------------------------------------------------

MEANT = """\
param float delta = 0.5
agent Car:
  param int numAgents = 2
  Drive:
    eff: stop
agent Drone:
  param int numAgents = 1
  Fly:
    eff: stop
"""


def test_what_a_program_states_counts_where_no_flag_does(koord: Koord, write: Path) -> None:
    (write / "meant.krd").write_text(MEANT, encoding="utf-8")
    for words, said in (
        ((), "3 robots (2 Car, 1 Drone), δ = 0.5 s"),
        (("--robots", "3"), "3 robots (2 Car, 1 Drone) (in another order in the text), δ = 0.5 s"),
        (
            ("--robots", "4", "--delta", "3"),
            "4 robots (2 Car, 2 Drone) (3 robots (2 Car, 1 Drone) in the text), "
            "δ = 3 s (0.5 s in the text)",
        ),
        (("--robots", "Car=0,Drone=1"), "1 robot (0 Car, 1 Drone) (3 robots"),
    ):
        assert koord("run", "meant.krd", *words)[1].startswith(f"meant.krd: {said}")
    assert "  0 Car " in koord("run", "meant.krd")[1]
    assert "  1 Car " in koord("run", "meant.krd")[1]
    assert "  1 Drone " in koord("run", "meant.krd", "--robots", "3")[1]  # dealt in turn


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("Step:\n    pre: x * y != 3\n    eff: z = 1", "x, y"),
        ("Step:\n    eff:\n        if x * x != 3:\n            y = 2", "x"),
        ("Step:\n    eff: stdout << y * y", "y"),
        ("Step:\n    eff: z = x * y", "z"),
        ("invariant Low: forall i: x@i * x@i != 7", "x"),
    ],
)
def test_wherever_a_number_grows_too_long_its_variables_are_named(
    tmp_path: Path,
    text: str,
    names: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("koord.semantics.domain.LONGEST_NUMBER_BITS", 500)
    start = "".join(f"    int {name} = {10**99}\n" for name in "xy")
    file = tmp_path / "long.krd"
    file.write_text(f"local:\n{start}    int z = 0\n{text}\n", "utf-8")
    assert frame.main(["run", str(file), "--robots", "1", "--rounds", "2"]) == Exit.BAD_INPUT
    assert f"an exact number in {names} has grown to more than 500 bits" in capsys.readouterr().err
