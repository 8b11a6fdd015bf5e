"""``koord verify --certificate`` and ``koord recheck`` from the command line."""

from __future__ import annotations

import builtins
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.recheck import checking
from koord.verify.certificates import digest
from tests.recheck.certificates import document_of
from tests.sampling import first

pytest.importorskip("cvc5")

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"


@pytest.fixture
def certificate(tmp_path: Path) -> Path:
    path = tmp_path / "proof.json"
    path.write_text(json.dumps(document_of("leader_elect.krd", 2)))
    return path


def test_a_proof_is_confirmed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program, path = str(EXAMPLES / "leader_elect.krd"), str(tmp_path / "proof.json")
    assert main(["verify", program, "--robots", "2", "--certificate", path]) == Exit.OK
    capsys.readouterr()
    assert main(["recheck", path, "--program", program]) == Exit.OK
    said = capsys.readouterr().out
    about = f"{program}: 2 robots, δ = 0.1 s"
    assert said.startswith(f"{about}\n  the text in the certificate, which is {program}: SHA-256 ")
    assert "8 of 8 obligations for every number of robots are met" in said
    everyone = (
        "shown for every number of robots, in every round:\n  invariant Best: forall i: voted"
    )
    assert everyone in said
    assert "claimed, and not shown" not in said
    assert "for 2 robots" not in said
    assert "obligations about whole runs of every number of robots are met" in said
    assert "\nshown for every number of robots, of every fair run:\n  eventually Decided" in said
    assert "\nrelying on:\n  runs are fair to robots" in said
    assert "not covered" not in said
    assert "\nconfirmed; cvc5 " in said


#: What holds of two robots, and of no other number.
OF_TWO = """\
invariant Two: candidate < 2
eventually One: candidate == 1
"""


@pytest.mark.slow
def test_what_holds_for_the_robots_at_hand_is_told_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, path = tmp_path / "two.krd", str(tmp_path / "proof.json")
    text = (EXAMPLES / "leader_elect.krd").read_text(encoding="utf-8")
    program.write_text(f"{text}\n{OF_TWO}", encoding="utf-8")
    assert main(["verify", str(program), "--robots", "2", "--certificate", path]) == Exit.OK
    assert "not in the certificate: One: it is about whole runs" in capsys.readouterr().err
    assert main(["recheck", path, "--json"]) == Exit.OK
    found = json.loads(capsys.readouterr().out)
    shown_for = {claim["name"]: claim["shown_for"] for claim in found["claims"]}
    assert shown_for["Agree"] == "every number of robots"
    assert shown_for["Two"] == "these robots"
    (two,) = (claim for claim in found["claims"] if claim["name"] == "Two")
    assert two["statement"] == "invariant Two: candidate < 2"
    assert [one["name"] for one in found["not_covered"]] == ["One"]
    assert {one["every_number"] for one in found["obligations"]} == {True, False}


def test_the_verdict_as_json(certificate: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recheck", str(certificate), "--json"]) == Exit.OK
    said = json.loads(capsys.readouterr().out)
    assert said["verdict"] == "confirmed"
    assert {one["answer"] for one in said["obligations"]} == {"met"}
    assert [one["name"] for one in said["obligations"]][:2] == [
        "initiation: no fault",
        "initiation",
    ]


def test_a_lemma_that_is_missing_is_told(
    certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads(certificate.read_text())
    document["invariant"] = [c for c in document["invariant"] if c["name"] != "Best"]
    certificate.write_text(json.dumps(document))
    assert main(["recheck", str(certificate)]) == Exit.VIOLATED
    said = capsys.readouterr().out
    assert "does not follow: event " in said
    assert "candidate = " in said
    assert "\nrefuted: " in said


def test_another_program_is_refused(certificate: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = str(EXAMPLES / "hvac.krd")
    assert main(["recheck", str(certificate), "--program", program]) == Exit.BAD_INPUT
    assert "K941" in capsys.readouterr().err


def test_what_is_no_certificate_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recheck", str(EXAMPLES / "hvac.krd")]) == Exit.BAD_INPUT
    assert "K940: not a JSON document" in capsys.readouterr().err


def test_a_construct_that_is_not_rechecked_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, path = tmp_path / "maps.krd", tmp_path / "proof.json"
    program.write_text(
        "local:\n    Map<int, int> seen = {}\n    int n = 0\n\n"
        "Step:\n    pre: n < 2\n    eff:\n        for k, v in seen: n = n + v\n"
        "        n = n + 1\n\n"
        "invariant Small: n <= 2\n"
    )
    assert main(["verify", str(program), "--robots", "2", "--certificate", str(path)]) in (
        Exit.OK,
        Exit.VACUOUS,
    )
    capsys.readouterr()
    assert main(["recheck", str(path)]) == Exit.UNKNOWN
    assert "unknown: going through a map" in capsys.readouterr().out


def test_scripts_that_cannot_be_read_are_named(
    certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads(certificate.read_text())
    document["obligations"][1] |= {"smt2": "garbage", "sha256": digest("garbage")}
    certificate.write_text(json.dumps(document))
    assert main(["recheck", str(certificate)]) == Exit.BAD_INPUT
    said = capsys.readouterr()
    name = "consecution of the program turns"
    story = f"error K941: the script '{name}' cannot be read: it has text that is in no command"
    assert story in said.err
    assert "confirmed" not in said.out + said.err


def test_scripts_that_are_not_settled_are_named(
    certificate: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checking, "SECOND_OPINION_S", 0.0)
    assert main(["recheck", str(certificate)]) == Exit.UNKNOWN
    said = capsys.readouterr().out
    assert "0 of 3 scripts in the certificate are agreed with" in said
    assert "  initiation: not settled: there was no time left to ask" in said
    assert "unknown: the script 'initiation' in the certificate: there was no time left" in said
    assert main(["recheck", str(certificate), "--json"]) == Exit.UNKNOWN
    found = json.loads(capsys.readouterr().out)
    assert found["scripts"][0] == {
        "name": "initiation",
        "answer": "unknown",
        "reason": "there was no time left to ask",
    }


def test_without_cvc5_the_cure_is_told(
    certificate: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found: Callable[..., Any] = builtins.__import__

    def missing(name: str, *arguments: Any, **named: Any) -> Any:
        if name == "cvc5":
            raise ImportError(name)
        return found(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", missing)
    assert main(["recheck", str(certificate)]) == Exit.BAD_INPUT
    said = capsys.readouterr().err
    assert "K942" in said
    assert "koord[recheck]" in said


def test_nothing_to_certify_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program, path = tmp_path / "bad.krd", tmp_path / "proof.json"
    program.write_text(
        "local:\n    int n = 0\n\nStep:\n    eff:\n        n = 1 / n\n\ninvariant Zero: n == 1\n"
    )
    main(["verify", str(program), "--robots", "1", "--rounds", "2", "--certificate", str(path)])
    assert "nothing to certify" in capsys.readouterr().err
    assert not path.exists()


def test_values_that_are_not_the_text_s_are_part_of_what_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, path = tmp_path / "k.krd", str(tmp_path / "proof.json")
    program.write_text(
        "param int k = 2\nlocal:\n    int n = 0\nassume: k < 9\n"
        "Step:\n    pre: n < k\n    eff: n = n + 1\n"
        "invariant Small: n <= 1\n"
    )
    flags = ["--set", "k=1", "--delta", "1/3", "--robots", "2"]
    assert main(["verify", str(program), *flags, "--certificate", path]) == Exit.OK
    capsys.readouterr()
    assert main(["recheck", path, "--program", str(program)]) == Exit.OK
    said = capsys.readouterr().out
    assert said.startswith(f"{program}: 2 robots, δ = 1/3 s, k = 1 (2 in the text)\n")
    assert "\n  param k = 1 (2 in the text)\n" in said
    assert "\n  invariant Small: n <= 1\n" in said
    assert "\nrelying on:\n  assume: k < 9\n" in said
    assert main(["recheck", path, "--json"]) == Exit.OK
    problem = json.loads(capsys.readouterr().out)["problem"]
    assert (problem["robots"], problem["delta"]) == (2, "1/3")
    assert problem["params"] == {"k": {"value": 1, "in_text": 2}}


NOTHING_BEGINS = """\
local:
    int n = 0
assume: n > 0
assume: n < 0
Step:
    eff: n = n + 1
invariant Small: n <= 2
"""

NO_ROUND_ENDS = """\
using Room:
    sensors:
        int warm
    contract Up:
        ensures: warm' > warm
    contract Down:
        ensures: warm' < warm
local:
    int n = 0
assume: warm == 0
Step:
    eff: n = n + 1
invariant Small: n <= 1
"""


@pytest.mark.parametrize(
    ("text", "why"),
    first(
        1,
        [
            (NOTHING_BEGINS, "no configuration satisfies what is assumed of the start"),
            (NO_ROUND_ENDS, "no round can end: nothing satisfies the contracts"),
        ],
    ),
    ids=["assumptions", "contracts"],
)
def test_what_holds_of_nothing_is_confirmed_and_said_to_be_vacuous(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, why: str
) -> None:
    program, path = tmp_path / "none.krd", str(tmp_path / "proof.json")
    program.write_text(text)
    main(["verify", str(program), "--robots", "2", "--certificate", path])
    capsys.readouterr()
    assert main(["recheck", path]) == Exit.VACUOUS
    said = capsys.readouterr().out
    assert f"\nvacuous: {why}\nconfirmed, but vacuously; cvc5 " in said
    assert "\n  invariant Small: n <= " in said


def test_statements_of_one_kind_of_robot_are_certified(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, path = tmp_path / "kinds.krd", str(tmp_path / "proof.json")
    program.write_text(
        "agent Car:\n    local:\n        int n = 0\n    Step:\n        pre: n < 2\n"
        "        eff: n = n + 1\n    invariant Small: n <= 2\n"
        "agent Drone:\n    local:\n        int m = 0\n    Up:\n        pre: m < 3\n"
        "        eff: m = m + 1\ninvariant Both: forall Drone i: m@i <= 3\n"
    )
    assert main(["verify", str(program), "--robots", "2", "--certificate", path]) == Exit.OK
    capsys.readouterr()
    assert main(["recheck", path]) == Exit.OK
    assert "  agent Car:\n      invariant Small: n <= 2\n" in capsys.readouterr().out
