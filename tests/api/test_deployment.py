"""Deployments from Python, as a user asks for them."""

from __future__ import annotations

import errno
import json
import threading
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path

import pytest
from msgspec.structs import replace

import koord
from koord.api.deployed import FleetHeard
from koord.cli import deploy
from koord.cli.exits import Exit
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.deploy.recording import DeploymentRecord
from koord.syntax.diagnostics import refusal
from tests.deployed.fleet import free_port

COUNT = koord.Source("count.krd", "local:\n  int x = 0\nUp:\n  pre: x < 3\n  eff: x = x + 1\n")
TWO = koord.read_configuration(koord.Source("two.yaml", "num_robots: 2\ndelta: 0.05\n"))


def one_robot() -> RunConfiguration:
    """A fleet of one, at a port of its own: the one that nobody states may be another test's."""
    text = (
        f"num_robots: 1\ndelta: 0.05\nudp_port: {free_port()}\n"
        "network: {key: 00112233445566778899aabbccddeeff}\n"
    )
    return koord.read_configuration(koord.Source("one.yaml", text))


def test_all_robots_run_as_processes(capfd: pytest.CaptureFixture[str]) -> None:
    heard: list[koord.Progress] = []
    deployed = koord.deploy(COUNT, TWO, rounds=6, as_fast_as_possible=True, progress=heard.append)
    assert capfd.readouterr() == ("", "")
    assert deployed.ok
    assert [status.ran for status in deployed.statuses.values()] == [3, 3]
    document = json.loads(deployed.to_json())
    assert [robot["round"] for robot in document["robots"]] == [6, 6]
    assert "2 of 2 robots: 6 rounds, 6 events" in repr(deployed)
    assert "<td>6</td>" in deployed._repr_html_()
    assert all(isinstance(told, FleetHeard) for told in heard)


def test_a_run_is_judged(tmp_path: Path) -> None:
    run = tmp_path / "run.json"
    deployed = koord.deploy(COUNT, TWO, rounds=6, as_fast_as_possible=True, trace=run)
    assert deployed.ok
    assert deployed.merged is not None
    assert deployed.merged.trace.rounds == 6
    assert koord.replay(run).legal
    assert koord.load_trace(run).encoded() == deployed.merged.trace.encoded()
    assert list(tmp_path.iterdir()) == [run]
    breaking = koord.Source("few.krd", COUNT.text + "invariant Few: forall i: x@i < 2\n")
    deployed = koord.deploy(breaking, TWO, rounds=6, as_fast_as_possible=True, trace=run)
    assert deployed.is_complete
    assert not deployed.ok
    assert deployed.merged is not None
    assert deployed.merged.broken is not None


@pytest.mark.parametrize("insists", [False, True])
def test_who_does_not_wait_for_the_judge_keeps_what_robots_told(
    insists: bool, tmp_path: Path
) -> None:
    run, stop, said = tmp_path / "run.json", koord.Cancellation(), list[str]()

    def hear(told: koord.Progress) -> None:
        if not isinstance(told, FleetHeard):
            said.append(told.message)
        if said and insists:
            raise KeyboardInterrupt
        if told.message.startswith("judging, round 3 of 6"):
            stop.cancel()

    deployed = koord.deploy(
        COUNT, TWO, rounds=6, as_fast_as_possible=True, trace=run, progress=hear, cancellation=stop
    )
    assert deployed.interrupted
    (left,) = deployed.unmerged
    assert f"what robots told is in {run}.parts" in left.message
    assert left.hint == f"koord merge {run}.parts/*.jsonl -o {run}"
    assert not run.exists()
    assert koord.merge(tmp_path.glob("run.json.parts/*.jsonl")).ok
    assert said[-1].startswith("reading" if insists else "judging")


def test_robots_go_on_where_their_recording_cannot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mcap")
    record, honest, flushed = tmp_path / "run.mcap", DeploymentRecord.flush, count()

    def flush(recording: DeploymentRecord) -> None:
        if next(flushed):
            raise OSError(errno.ENOSPC, "No space left on device")
        honest(recording)

    monkeypatch.setattr(DeploymentRecord, "flush", flush)
    deployed = koord.deploy(COUNT, TWO, rounds=12, record=record)
    assert deployed.is_complete
    assert not deployed.ok
    (early,) = deployed.unmerged
    assert early.message.startswith("the recording ends early, as it cannot be written: No space")
    assert early.hint == f"what robots told is left in {record}.parts"
    assert koord.merge(tmp_path.glob("run.mcap.parts/*.jsonl")).trace.rounds == 12
    assert record.read_bytes().endswith(b"\x89MCAP0\r\n"), "it is whole up to there"


def test_what_robots_told_outlives_a_trace_that_cannot_be_written(tmp_path: Path) -> None:
    run = tmp_path / "run.json"

    def hear(told: koord.Progress) -> None:
        if not isinstance(told, FleetHeard):
            run.mkdir(exist_ok=True)

    deployed = koord.deploy(
        COUNT, TWO, rounds=6, as_fast_as_possible=True, trace=run, progress=hear
    )
    assert [one.code for one in deployed.unmerged] == ["K903"]
    assert deployed.left == f"{run}.parts"
    assert koord.merge(tmp_path.glob("run.json.parts/*.jsonl")).ok


def test_a_robot_keeps_its_part(tmp_path: Path) -> None:
    alone = one_robot()
    part, state = tmp_path / "part.jsonl", tmp_path / "state"
    assert koord.deploy(COUNT, alone, pid=0, rounds=4, state=state, trace=part).ok
    merged = koord.merge([part])
    assert merged.ok
    assert merged.trace.rounds == 4


@pytest.mark.parametrize(
    ("codes", "interrupted", "code"),
    [
        ((), False, Exit.OK),
        (("K918",), False, Exit.BAD_INPUT),
        (("K918",), True, Exit.INTERRUPTED),
        (("K919",), True, Exit.VIOLATED),
    ],
)
def test_what_is_not_merged_has_an_exit_code(
    codes: tuple[str, ...], interrupted: bool, code: Exit
) -> None:
    deployed = koord.deploy(COUNT, TWO, rounds=1, as_fast_as_possible=True)
    unmerged = tuple(refusal(one, "0.jsonl", "so it is").diagnostics[0] for one in codes)
    ended = replace(deployed, interrupted=interrupted, unmerged=unmerged)
    assert ended.ok == (code is Exit.OK)
    assert deploy._ended(ended) == code


def test_a_deployment_is_cancelled_from_another_thread() -> None:
    stop = koord.Cancellation()

    def hear(told: koord.Progress) -> None:
        if told.round:
            stop.cancel()

    deployed = koord.deploy(COUNT, TWO, progress=hear, cancellation=stop)
    assert deployed.interrupted
    assert not deployed.ok


def test_several_deployments_go_on_at_a_time() -> None:
    def deploy(rounds: int) -> tuple[bool, list[int]]:
        deployed = koord.deploy(COUNT, TWO, rounds=rounds, as_fast_as_possible=True)
        return deployed.ok, [status.round for status in deployed.statuses.values()]

    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(deploy, (5, 7))) == [(True, [5, 5]), (True, [7, 7])]


def test_one_robot_runs_in_this_process(tmp_path: object) -> None:
    alone = one_robot()
    found: list[koord.Deployed] = []

    def deploy() -> None:
        found.append(koord.deploy(COUNT, alone, pid=0, rounds=3, state=str(tmp_path)))

    thread = threading.Thread(target=deploy)
    thread.start()
    thread.join(30)
    assert [one.ok for one in found] == [True]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"pid": 0}, "no key in common"),
        ({"record": "none/run.mcap"}, "no folder"),
        ({"delta_s": -1}, "δ must be"),
    ],
)
def test_what_is_wrong_is_raised_as_diagnostics(arguments: dict[str, object], said: str) -> None:
    with pytest.raises(koord.KoordError, match=said):
        koord.deploy(COUNT, TWO, **arguments)  # type: ignore[arg-type]
