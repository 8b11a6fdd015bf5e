"""The playground's worker, as far as it is Python: requests and answers, without a browser."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from typing import Any

import pytest

from playground.answering import Request, answer, answered, params_of, robots_of
from tests.api.test_story_page import data_of
from tests.loading import EXAMPLES

EARLY = (EXAMPLES / "broken" / "leader_elect_early.krd").read_text("utf-8")
WHOLE = (EXAMPLES / "leader_elect.krd").read_text("utf-8")


def asked(do: str, text: str, **more: object) -> dict[str, Any]:
    """What the page hears, as it hears it."""
    told: list[str] = []
    request = json.dumps({"do": do, "text": text, **more})
    found: dict[str, Any] = json.loads(answer(request, lambda line, marks: told.append(line)))
    assert told[0] == "reading the program"
    return found


def test_a_program_without_mistakes_is_checked() -> None:
    found = asked("check", WHOLE)
    assert (found["outcome"], found["problems"], found["page"]) == ("done", [], "")
    assert found["summary"] == "no mistakes found"


@pytest.mark.parametrize("do", ["check", "verify", "run"])
def test_mistakes_are_told_with_their_place_whatever_was_asked(do: str) -> None:
    found = asked(do, WHOLE.replace("not voted", "not votde"))
    (problem,) = found["problems"]
    assert found["outcome"] == "refused"
    assert (problem["severity"], problem["code"]) == ("error", "K201")
    line = WHOLE.splitlines()[problem["line"] - 1]
    assert line[problem["column"] - 1 :].startswith("voted")
    assert problem["end_column"] - problem["column"] == len("votde")
    assert "voted" in problem["hint"]


def test_a_verification_has_verdicts_at_their_lines_and_a_page_of_the_counterexample() -> None:
    found = asked("verify", EARLY, robots="3", rounds=10)
    assert (found["outcome"], found["summary"]) == ("violated", "violated: Agree")
    marks = {mark["name"]: mark for mark in found["marks"]}
    assert marks["Agree"]["kind"] == "violated"
    assert EARLY.splitlines()[marks["Agree"]["line"] - 1].startswith("invariant Agree")
    assert marks["no fault"]["kind"] == "holds"
    data = data_of(found["page"])
    assert data["verifications"][0]["report"]["outcome"] == "violated"
    assert [story["title"] for story in data["stories"]] == ["Agree"]


def test_what_holds_is_said_of_every_claim() -> None:
    found = asked("verify", WHOLE, robots="any")
    assert (found["outcome"], found["summary"]) == ("holds", "holds, every claim")
    assert {mark["kind"] for mark in found["marks"]} == {"holds"}


def test_a_run_has_a_page_of_its_turns() -> None:
    found = asked("run", WHOLE, robots="2", rounds=4)
    assert found["outcome"] == "done"
    (story,) = data_of(found["page"])["stories"]
    assert story["moments"][-1]["round"] == 4


def test_a_run_that_breaks_a_claim_says_so() -> None:
    found = asked("run", EARLY, robots="3", policy="random", seed=3)
    assert found["outcome"] == "violated"
    assert "Agree" in found["summary"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"robots": "many"}, "robots: 'many' is no number"),
        ({"robots": "-3"}, "robots: '-3' is no number"),
        ({"robots": "any"}, "robots: a run needs a number of robots"),
        ({"robots": "0"}, "robots: there must be 1 to"),
        ({"robots": "Car=2"}, "robots: there is no agent Car here"),
        ({"rounds": 0}, "rounds: a number from 1 to 1000"),
    ],
)
def test_what_does_not_fit_a_program_is_told(more: dict[str, Any], said: str) -> None:
    found = asked("run", WHOLE, **more)
    (problem,) = found["problems"]
    assert found["outcome"] == "refused"
    assert problem["message"].startswith(said)
    assert found["summary"] == problem["message"]


def test_properties_alone_are_no_program() -> None:
    found = asked("verify", "invariant Yes: true\n")
    assert found["outcome"] == "refused"
    assert "only properties" in found["problems"][-1]["message"]


def test_robots_of_several_kinds_are_read() -> None:
    assert robots_of(" Car=2, Drone = 1 ") == {"Car": 2, "Drone": 1}
    assert robots_of("") is None


#: What Python has on a machine, and not in a browser, and what koord needs elsewhere only.
MISSING = (
    *("multiprocessing", "_multiprocessing", "_posixshmem", "fcntl", "resource", "termios"),
    *("curses", "pty", "tty", "readline", "ssl", "_ssl", "sqlite3"),
    *("yaml", "rich", "pygments", "numpy", "scipy", "llvmlite", "cvc5", "mcap", "msgpack"),
)


def test_all_is_answered_where_there_are_no_processes_and_no_threads() -> None:
    """As in a browser: neither can be made, and what is for them cannot be imported."""
    script = f"""
import os, sys, threading

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {MISSING!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

def none(*_):
    raise OSError("not in a browser")

sys.meta_path.insert(0, Missing())
import ctypes, subprocess
sys.platform = "emscripten"
os.fork = os.posix_spawn = none
threading.Thread.start = none

from pathlib import Path
from playground.answering import Request, answered, load_engines
load_engines()
for name in ("leader_elect", "broken/leader_elect_early", "broken/leader_elect_restless"):
    text = (Path({str(EXAMPLES)!r}) / f"{{name}}.krd").read_text("utf-8")
    for do in ("check", "verify", "run"):
        print(name, do, answered(Request(do, text, "3"), lambda *told: None).outcome)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    outcomes = [line.split()[-1] for line in done.stdout.splitlines()]
    assert outcomes[:3] == ["done", "holds", "done"]
    assert outcomes[3:6] == ["done", "violated", "violated"]
    assert outcomes[6:] == ["done", "violated", "done"]


def test_progress_is_told_and_verdicts_as_they_are_found() -> None:
    told: list[tuple[str, str]] = []
    answered(Request("verify", EARLY, "2"), lambda line, marks: told.append((line, marks)))
    assert told[0] == ("reading the program", "")
    assert told[-1][0] == "drawing what was found"
    known = [json.loads(marks) for _, marks in told if marks]
    assert {mark["name"]: mark["kind"] for mark in known[-1]} == {
        "no fault": "holds",
        "Agree": "violated",
    }
    (agree,) = (mark for mark in known[-1] if mark["name"] == "Agree")
    assert EARLY.splitlines()[agree["line"] - 1].startswith("invariant Agree")


def test_requests_are_those_that_the_page_makes() -> None:
    """The page sends no more than is read, so that nothing it says is lost."""
    with pytest.raises(Exception, match=re.escape("unknown field `colour`")):
        asked("check", WHOLE, colour="red")


PARAMS = """\
param int most = 3
local:
    int x = 0
Step:
    pre: x < most
    eff: x = x + 1
invariant Few: forall i: x@i <= 3
"""


def test_params_policy_and_seed_are_those_that_are_asked_for() -> None:
    assert asked("verify", PARAMS, robots="2")["outcome"] == "holds"
    assert asked("verify", PARAMS, robots="2", params="most=4")["outcome"] == "violated"
    assert asked("run", PARAMS, robots="2", params="most = 9", rounds=8)["outcome"] == "violated"
    pages = [
        asked("run", PARAMS, robots="3", rounds=4, policy="random", seed=seed)["page"]
        for seed in (1, 1, 2)
    ]
    assert data_of(pages[0]) == data_of(pages[1]) != data_of(pages[2])


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("", {}),
        ("a=1, b = [1,2],c=true,", {"a": 1, "b": (1, 2), "c": True}),
        ("mode=busy", {"mode": "busy"}),
    ],
)
def test_params_are_read(text: str, values: dict[str, Any]) -> None:
    assert params_of(text) == values


@pytest.mark.parametrize("text", ["4", "a=", "a=1 b=2", "a=[1", "=3"])
def test_params_that_are_none_are_told(text: str) -> None:
    found = asked("check", PARAMS, params=text)
    assert found["outcome"] == "refused"
    assert found["problems"][0]["message"].startswith("params: ")


def test_a_param_that_is_not_there_is_told() -> None:
    found = asked("check", PARAMS, params="least=1")
    assert found["outcome"] == "refused"
    assert "least" in found["problems"][0]["message"]
