"""``koord deploy``, ``koord config`` and ``koord schema``, as they are called."""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path

import pytest

from koord.api.deploy_request import DeployRequest
from koord.cli import deploy
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.exits import Exit
from koord.cli.main import main

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"
SUM = str(EXAMPLES / "sum_of_ids.krd")


@pytest.fixture
def three(tmp_path: Path) -> str:
    path = tmp_path / "three.yaml"
    path.write_text("num_robots: 3\ndelta: 0.02\n", encoding="utf-8")
    return str(path)


def test_all_robots_run_on_this_machine(three: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["deploy", SUM, three, "--all-local", "--rounds", "6"])
    out, err = capsys.readouterr()
    assert code == Exit.OK, err
    assert out.startswith(f"{SUM}: 3 robots, δ = 0.02 s\n6 rounds of 3 robots: ")
    # One that begins sooner may speak before another one is in the run.
    assert re.search(r"dropped: (nothing|\d+ before this robot was in a run)\n", out)


@pytest.mark.slow
def test_a_run_is_recorded(three: str, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    path = tmp_path / "run.mcap"
    assert main(["deploy", SUM, three, "--all-local", "--rounds", "6", "--record", str(path)]) == 0
    with path.open("rb") as file:
        messages = [
            (channel.topic, json.loads(message.data))
            for _, channel, message in reader.make_reader(file).iter_messages()
        ]
    rounds = {(topic, m["round"]) for topic, m in messages if topic.startswith("/robots/")}
    assert rounds >= {(f"/robots/{pid}", r) for pid in range(3) for r in range(-1, 6)}
    assert any(topic == "/status" for topic, _ in messages)


@pytest.mark.slow
def test_a_fault_ends_the_run_for_all(
    three: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "fault.krd"
    program.write_text(
        "local:\n    int n = 3\nCount:\n    pre: true\n    eff: n = 6 / (pid - 1)\n",
        encoding="utf-8",
    )
    code = main(["deploy", str(program), three, "--all-local", "--rounds", "50"])
    out, err = capsys.readouterr()
    assert code == Exit.VIOLATED, out + err
    assert "division by zero" in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "--pid I for one robot, or --all-local"),
        (["--all-local", "--pid", "1"], "--pid I for one robot, or --all-local"),
        (["--pid", "1"], "no key in common"),
    ],
)
def test_what_is_missing_is_told(
    three: str, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["deploy", SUM, three, *words]) == Exit.BAD_INPUT
    assert said in capsys.readouterr().err


def test_a_pid_that_nobody_has_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "c.yaml"
    config.write_text("num_robots: 2\nnetwork: {key: sixteen letters ok}\n", encoding="utf-8")
    assert main(["deploy", SUM, str(config), "--pid", "2"]) == Exit.BAD_INPUT
    err = capsys.readouterr().err
    assert "K932" in err
    assert "the pids are 0 to 1" in err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--pid", "3"], "error K932: there is no robot 3\n  = help: the pids are 0 to 2"),
        (["--pid", "-1"], "there is no robot -1"),
        (["--all-local", "--state", "c.yaml"], "it is a file, and not a folder"),
        (
            ["--all-local", "--trace", "run"],
            "run.parts: error K903: cannot be written: it is a file",
        ),
        (["--all-local", "--trace", "r", "--record", "./r"], "--record: this is the file of the"),
        (["--all-local", "--record", "c.yaml"], "it is read by the same command"),
        (["--all-local", "--with", "p.krd", "--trace", "p.krd"], "it is read by the same command"),
    ],
)
def test_wrong_words_are_told_before_robots_run(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("mcap")
    monkeypatch.chdir(tmp_path)
    Path("c.yaml").write_text("num_robots: 3\n", encoding="utf-8")
    for name in ("run.parts", "p.krd"):
        Path(name).touch()
    before = {path.name for path in tmp_path.iterdir()}
    assert main(["deploy", SUM, "c.yaml", *words]) == Exit.BAD_INPUT
    assert said in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == before


def test_functions_that_robots_do_not_have_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    mapping, config = str(EXAMPLES / "mapping.krd"), str(EXAMPLES / "mapping.yaml")
    assert main(["deploy", mapping, config, "--all-local"]) == Exit.BAD_INPUT
    assert "pickFrontierPos" in capsys.readouterr().err


def test_kinds_that_the_program_does_not_have_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "c.yaml"
    config.write_text("agents: [{pid: 0, kind: Boat}]\n", encoding="utf-8")
    program = str(EXAMPLES / "cars_and_drones.krd")
    assert main(["deploy", program, str(config), "--all-local"]) == Exit.BAD_INPUT
    assert "kind Boat" in capsys.readouterr().err


def test_an_address_of_another_machine_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(
        "agents: [{pid: 0, on_device: a}]\ndevices: {a: {ip: 192.0.2.1}}\n"
        "network: {key: sixteen letters ok, transport: unicast}\n",
        encoding="utf-8",
    )
    words = ["deploy", SUM, str(config), "--pid", "0", "--state", str(tmp_path)]
    assert main(words) == Exit.BAD_INPUT
    err = capsys.readouterr().err
    assert "K933" in err
    assert "192.0.2.1" in err


# --- configurations -------------------------------------------------------------------------------


def test_a_good_configuration_is_told_in_a_line(
    three: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "check", three]) == Exit.OK
    assert "3 robots (CAR), multicast to 239.255.75.1, rounds of 0.02 s" in capsys.readouterr().out


def test_a_bad_configuration_is_told_with_its_lines(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text("num_robots: 3\nseeed: 4\ndelta: x\n", encoding="utf-8")
    assert main(["config", "check", str(path)]) == Exit.BAD_INPUT
    out = capsys.readouterr().out
    assert f"{path}:2:1: error K931: there is no field `seeed` here" in out
    assert "did you mean `seed`?" in out
    assert f"{path}:3:8: error K931" in out


def test_the_schema_is_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == Exit.OK
    schema = json.loads(capsys.readouterr().out)
    assert "num_robots" in json.dumps(schema)


# --- the protocol by itself -----------------------------------------------------------------------


@pytest.mark.slow
def test_the_protocol_can_be_checked_by_itself(capsys: pytest.CaptureFixture[str]) -> None:
    words = [
        "check-refinement",
        "--target",
        "protocol",
        "--faults",
        "chaos",
        "--runs",
        "8",
        "--json",
    ]
    assert main(words) == Exit.OK
    document = json.loads(capsys.readouterr().out)
    assert document["runs"] == 8
    assert document["broken"] == []
    assert {one["what"] for one in document["explored"] if one["complete"]} == {
        "one round",
        "two rounds",
    }


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--target", "protocol", SUM], "takes no file"),
        (["--target", "protocol", "--case", "1"], "no case"),
        (["--target", "moon"], "invalid choice"),
    ],
)
def test_flags_of_the_protocol_s_check_stand_together(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check-refinement", *words]) == Exit.BAD_INPUT
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_a_run_in_which_all_robots_stop_is_done(
    three: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "stop.krd"
    program.write_text("Stop:\n    pre: true\n    eff: stop\n", encoding="utf-8")
    assert main(["deploy", str(program), three, "--all-local", "--rounds", "500"]) == Exit.OK
    assert "all robots have stopped" in capsys.readouterr().out


def test_rounds_are_as_long_as_the_program_states_if_the_configuration_does_not_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, config = tmp_path / "p.krd", tmp_path / "c.yaml"
    text = "param int numAgents = 3\nparam float delta = 0.03\nGo:\n    eff: stop\n"
    program.write_text(text, encoding="utf-8")
    config.write_text("num_robots: 2\n", encoding="utf-8")
    words = ["deploy", str(program), str(config), "--all-local", "--rounds", "2", "--json"]
    assert main(words) == Exit.OK
    out, err = capsys.readouterr()
    for one in json.loads(out)["robots"]:  # datagrams have 20 to 1,400 bytes
        assert one["arrived"] > 0
        assert 20 * one["sent"] <= one["sent_bytes"] <= 1_400 * one["sent"]
        assert 20 * one["arrived"] <= one["arrived_bytes"] <= 1_400 * one["arrived"]
    assert "K936: the program is meant for 3 robots; here are 2 robots" in err
    assert "δ" not in err
    arguments = argparse.Namespace(
        file=str(program),
        config=str(config),
        settings=[],
        properties=[],
        delta=None,
        site=None,
    )
    wanted = deploy.prepare(arguments, DeployRequest(rounds=2), DiagnosticReport())
    assert wanted is not None
    _, job = wanted
    assert (job.delta_s, job.pace_s) == (0.03, 0.03)
