"""Robots on their own computers: every error of SSH, copies, signals, lost connections.

The other side is asyncssh's server in this process; `tests/cli/test_remote.py` has OpenSSH's.
"""

from __future__ import annotations

import io
import json
import re
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import asyncssh
import pytest
from msgspec import to_builtins

import koord
from koord.api.deployed import Deployed
from koord.api.preflight import Preflight
from koord.runtime.configuration.keys import VARIABLE
from koord.runtime.deploy.status import unheard
from koord.runtime.records import RecordFile, read_messages
from koord.runtime.remote import computer, computers
from koord.syntax.diagnostics import KoordError
from tests.runtime.platform.ssh_servers import FakeComputer, FakeFleet

PROGRAM = "specs/examples/leader_elect.krd"

CONFIGURATION = """\
agents: [{pid: 0, on_device: a}, {pid: 1, on_device: b}, {pid: 2, on_device: c}]
devices:
  a: {ip: 127.0.0.1}
  b: {ip: 127.0.0.2}
  c: {ip: 127.0.0.3}
network: {transport: unicast, key_file: robots.key}
"""

KEY = "9ae3e22c78d0a354a3d8889b08c82cbd9da4fd3ba946007d5a1e1585468f28bf"

PATIENCE_S = 20.0


def report(pid: int, **changes: object) -> str:
    """What `koord deploy --pid I --json` prints of a robot that has done its rounds."""
    robot = {**to_builtins(unheard(pid)), "round": 5, "ran": 2, "is_over": True, "drops": {}}
    told = {"format": "koord-deployed", "version": 1, "robots": [{**robot, **changes}]}
    return json.dumps({**told, "broken": [], "unwatched": []})


def checks(pid: int, finding: str, text: str) -> str:
    """What `--preflight --json` prints."""
    found = [{"name": "pose", "finding": finding, "text": text, "cure": ""}]
    return json.dumps({"version": 1, "ok": True, "robots": [{"pid": pid, "checks": found}]})


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(computer, "_LOOK_S", 0.02)
    monkeypatch.setattr(computer, "_AGAIN_S", 0.05)
    monkeypatch.setattr(computers, "_WAIT_S", 0.02)


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator[FakeFleet]:
    (tmp_path / "c.yaml").write_text(CONFIGURATION, "utf-8")
    (tmp_path / "robots.key").write_text(f"{KEY}\n", "utf-8")
    (tmp_path / "robots.key").chmod(0o600)
    with FakeFleet(tmp_path, 3) as made:
        for pid, one in enumerate(made.computers):
            one.acts(**{"deploy.json": report(pid), "preflight.json": checks(pid, "good", "there")})
        yield made


class Heard:
    """The lines that were heard of robots; ``when`` acts at the first that has a text."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._acts: list[tuple[str, Callable[[], object]]] = []

    def when(self, text: str, act: Callable[[], object]) -> None:
        self._acts.append((text, act))

    def hear(self, told: koord.Progress) -> None:
        self.lines.append(told.message)
        due = [one for one in self._acts if one[0] in told.message]
        for one in due:
            self._acts.remove(one)
            one[1]()


def deploy(fleet: FakeFleet, heard: Heard | None = None, **arguments: Any) -> Deployed:
    login = koord.Login(koord="~/koord", config=str(fleet.folder / "config"))
    listener = (heard or Heard()).hear
    arguments = {"login": login, "rounds": 5, "progress": listener, **arguments}
    return koord.deploy_remotely(PROGRAM, fleet.folder / "c.yaml", **arguments)


def refused(fleet: FakeFleet, **arguments: Any) -> str:
    """The errors of a deployment that is refused, with their cures. Nothing was started."""
    with pytest.raises(KoordError) as caught:
        deploy(fleet, **arguments)
    assert {one.code for one in caught.value.diagnostics} == {"K946"}
    assert not any(one.noted("words") for one in fleet.computers)
    return "\n".join(f"{one.message}; {one.hint}" for one in caught.value.diagnostics)


def until(condition: Callable[[], object]) -> None:
    ends_at = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < ends_at
        time.sleep(0.01)


# --- what goes well -------------------------------------------------------------------------------


def test_each_robot_is_started_with_the_same_settings(fleet: FakeFleet) -> None:
    """(P-SSH) (P-SSH-COPY)"""
    fleet.computers[1].acts(says="round 3\nhalf a")
    heard = Heard()
    done = deploy(fleet, heard, delta_s=0.2, loss=0.25, state="journals", run="of mine")
    assert done.is_complete
    assert [done.statuses[pid].ran for pid in range(3)] == [2, 2, 2]
    assert {"robot 1 | round 3", "robot 1 | half a"} <= set(heard.lines)
    for pid, one in enumerate(fleet.computers):
        flags = ["--rounds=5", "--delta=1/5", "--run=of mine"]
        flags += ["--state=../../../../journals", "--lose=0.25", "--json"]
        files = ["leader_elect.krd", "c.yaml"]
        assert one.noted("words") == ["deploy", *files, f"--pid={pid}", *flags]
        [program] = one.files("leader_elect.krd")
        assert program.read_text("utf-8") == Path(PROGRAM).read_text("utf-8")
        [key] = one.files("robots.key")
        assert key.read_text("utf-8") == KEY
        assert key.stat().st_mode & 0o777 == 0o600
        assert key.parent.stat().st_mode & 0o777 == 0o700
        assert key.parent.name == str(pid)


def test_a_key_of_the_environment_is_in_no_command_line(
    fleet: FakeFleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-SSH-COPY)"""
    key = "b3cac45e9768012fdce769678c37738e367281e4e10204442187ea70d5b5e667"
    monkeypatch.setenv(VARIABLE, key)
    deploy(fleet)
    for one in fleet.computers:
        assert one.noted("key") == [key]
        assert not any(key in word for word in one.noted("words"))
        [script] = one.files("deploy.sh")
        assert key not in script.read_text("utf-8")
        assert not one.files("robots.key")


def test_logs_are_kept(fleet: FakeFleet) -> None:
    """(P-SSH-GATHER)"""
    fleet.computers[2].acts(says="a remark\n")
    deploy(fleet, logs=fleet.folder / "logs")
    assert (fleet.folder / "logs" / "2.log").read_text("utf-8") == "a remark\n"
    assert (fleet.folder / "logs" / "0.log").read_text("utf-8") == ""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a run of three robots, with their parts."""
    folder = tmp_path_factory.mktemp("run")
    (folder / "c.yaml").write_text("num_robots: 3\nnetwork: {transport: unicast}\n", "utf-8")
    path = folder / "run.mcap"
    koord.deploy(
        PROGRAM, folder / "c.yaml", rounds=4, as_fast_as_possible=True, fresh=True, record=path
    )
    return path


def recorded(recording: Path, pid: int) -> tuple[str, bytes]:
    """The part of a robot, and a recording of that alone."""
    lines = [line for _, line in read_messages(recording.read_bytes(), f"/parts/{pid}")]
    file = io.BytesIO()
    record = RecordFile(file)
    for at, line in enumerate(lines):
        record.add(f"/parts/{pid}", ("koord.part", {"type": "object"}), line, 1000 * at + pid)
    record.close()
    return "".join(f"{line.decode()}\n" for line in lines), file.getvalue()


def test_parts_and_recordings_are_made_one(fleet: FakeFleet, recording: Path) -> None:
    """(P-SSH-GATHER)"""
    for pid, one in enumerate(fleet.computers):
        part, record = recorded(recording, pid)
        one.acts(part=part)
        (one.home / "record").write_bytes(record)
    trace, record_here = fleet.folder / "run.json", fleet.folder / "run.mcap"
    done = deploy(fleet, rounds=4, trace=trace, record=record_here)
    assert done.merged is not None
    assert done.merged.ok
    assert done.unmerged == ()
    assert koord.load_trace(trace).rounds == 4
    assert koord.merge([record_here]).ok
    topics = [topic for topic, _ in read_messages(record_here.read_bytes(), "/parts/")]
    assert topics[:4] == ["/parts/0", "/parts/1", "/parts/2", "/parts/0"]  # by their times
    assert not list(fleet.folder.glob("run.*.parts"))


def test_what_is_not_fetched_is_named_and_the_rest_is_made(
    fleet: FakeFleet, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-SSH-GATHER)"""
    monkeypatch.setattr(computers, "REACH_S", 0.5)
    lost, heard = fleet.computers[2], Heard()
    for pid, one in enumerate(fleet.computers):
        one.acts(part=recorded(recording, pid)[0])
    lost.waits()
    lost.acts(says="flies\n")
    heard.when("robot 2 | flies", lambda: fleet.cut(lost))
    done = deploy(fleet, heard, rounds=4, trace=fleet.folder / "run.json")
    assert done.merged is not None
    assert done.merged.missing == (2,)
    [untold] = done.unmerged
    assert untold.message.startswith("part.jsonl of robot 2 was not fetched")
    parts = fleet.folder / "run.json.parts"
    assert done.left == str(parts)
    assert sorted(one.name for one in parts.iterdir()) == ["0.jsonl", "1.jsonl"]


def test_recordings_that_are_damaged_are_left(fleet: FakeFleet, recording: Path) -> None:
    """(P-SSH-GATHER)"""
    for pid, one in enumerate(fleet.computers):
        (one.home / "record").write_bytes(recorded(recording, pid)[1][: -20 * pid or None])
    done = deploy(fleet, record=fleet.folder / "run.mcap")
    assert [one.code for one in done.unmerged] == ["K910"]
    assert len(list((fleet.folder / "run.mcap.parts").iterdir())) == 3
    assert not (fleet.folder / "run.mcap").exists()


def test_a_full_disk_here_is_named(fleet: FakeFleet, monkeypatch: pytest.MonkeyPatch) -> None:
    """(P-SSH-GATHER)"""
    (fleet.folder / "logs").mkdir()
    for pid in range(3):
        (fleet.folder / "logs" / f"{pid}.log.part").mkdir()  # cannot be written
    done = deploy(fleet, logs=fleet.folder / "logs")
    assert len(done.unmerged) == 3
    assert "logs/0.log cannot be written" in done.unmerged[0].message


# --- computers that cannot be used ----------------------------------------------------------------


def test_an_unknown_host_is_refused(fleet: FakeFleet) -> None:
    """(P-SSH)"""
    fleet.know(*fleet.computers[:2])
    said = refused(fleet)
    assert "robot 2 (127.0.0.3): its host key is not known here" in said
    assert "ssh-keygen -R 127.0.0.3" in said
    assert "robot 0" not in said


def test_so_is_one_whose_key_has_changed(fleet: FakeFleet) -> None:
    """(P-SSH)"""
    fleet.computers[0].host_key, before = fleet.computers[1].host_key, fleet.computers[0].host_key
    fleet.know(*fleet.computers)
    fleet.computers[0].host_key = before
    assert "robot 0 (127.0.0.1): its host key is not known here, or is another" in refused(fleet)


def test_host_keys_are_verified_whatever_is_configured(fleet: FakeFleet) -> None:
    """(P-SSH)"""
    config = fleet.folder / "config"
    text = config.read_text("utf-8")
    for unsafe in ("none", "/dev/null", f"{fleet.folder}/nothing"):
        changed = text.replace(
            f"UserKnownHostsFile {fleet.folder}/known", "StrictHostKeyChecking no\n"
        )
        config.write_text(f"{changed}  UserKnownHostsFile {unsafe}\n", "utf-8")
        assert "host key" in refused(fleet)


def test_a_key_that_is_not_accepted_is_refused(fleet: FakeFleet) -> None:
    """(P-SSH)"""
    asyncssh.generate_private_key("ssh-ed25519").write_private_key(fleet.folder / "id")
    said = refused(fleet)
    assert "robot 1 (127.0.0.2): none of your keys is accepted there; `ssh-copy-id" in said


def test_so_is_one_that_cannot_be_read(fleet: FakeFleet) -> None:
    """(P-SSH)"""
    fleet.key.write_private_key(fleet.folder / "locked", "pkcs8-pem", "a word")
    config = str(fleet.folder / "config")
    login = koord.Login(koord="~/koord", config=config, identity=str(fleet.folder / "locked"))
    assert "`ssh-add" in refused(fleet, login=login)
    login = koord.Login(koord="~/koord", config=config, identity=str(fleet.folder / "nowhere"))
    assert "nowhere" in refused(fleet, login=login)
    login = koord.Login(koord="~/koord", config=str(fleet.folder / "no config"))
    assert "no config" in refused(fleet, login=login)


def test_a_computer_without_koord_is_named(fleet: FakeFleet) -> None:
    """(P-SSH)"""
    (fleet.computers[1].home / "koord").unlink()
    said = refused(fleet)
    assert "robot 1 (127.0.0.2): there is no command ~/koord" in said
    assert "`koord=`" in said


def test_so_is_one_with_another_version(fleet: FakeFleet) -> None:
    """(P-SSH)"""
    fleet.computers[0].acts(version="0.0.7")
    said = refused(fleet)
    assert f"robot 0 (127.0.0.1): koord 0.0.7 is there, and {koord.__version__} here" in said
    assert f"pip install koord=={koord.__version__} there" in said


def test_so_is_one_that_is_not_reached(fleet: FakeFleet) -> None:
    """One of three: nothing is started on the others. (P-SSH)"""
    fleet.cut(fleet.computers[2])
    said = refused(fleet)
    assert "robot 2 (127.0.0.3): it cannot be reached" in said
    assert "is it on" in said


@pytest.mark.parametrize(
    ("disk", "story"),
    [
        ("full", "room on its disk"),
        ("forbidden", "may not write"),
        ("forgetful", "did not arrive as it is here"),
    ],
)
def test_files_that_do_not_arrive_are_named(fleet: FakeFleet, disk: str, story: str) -> None:
    """(P-SSH-COPY)"""
    fleet.computers[1].disk = disk
    said = refused(fleet)
    assert "robot 1 (127.0.0.2)" in said
    assert story in said
    assert "robot 0" not in said


def test_each_robot_needs_a_computer(fleet: FakeFleet) -> None:
    """(P-SSH)"""
    config = fleet.folder / "c.yaml"
    config.write_text(CONFIGURATION.replace("ip: 127.0.0.2", "port: 7000"), "utf-8")
    with pytest.raises(KoordError, match="K932 robot 1 has no computer"):
        deploy(fleet)


@pytest.mark.parametrize("key_file", ["../robots.key", "{folder}/robots.key"])
def test_a_key_lies_beside_the_configuration(fleet: FakeFleet, key_file: str) -> None:
    """(P-SSH-COPY)"""
    inside = fleet.folder / "inside"
    inside.mkdir()
    named = key_file.format(folder=fleet.folder)
    config = inside / "c.yaml"
    config.write_text(CONFIGURATION.replace("robots.key", named), "utf-8")
    login = koord.Login(config=str(fleet.folder / "config"))
    with pytest.raises(KoordError, match="does not lie beside the configuration"):
        koord.deploy_remotely(PROGRAM, config, login=login)


# --- while robots run -----------------------------------------------------------------------------


def under_way(one: FakeComputer) -> bool:
    return bool(one.noted("words"))


def test_robots_are_told_once_to_stop_safely(fleet: FakeFleet) -> None:
    """(P-SSH-STOP)"""
    stop, heard = koord.Cancellation(), Heard()
    for pid, one in enumerate(fleet.computers):
        one.waits()
        one.acts(says="flies\n", code="143", **{"deploy.json": report(pid, is_over=False)})

    def stop_all() -> None:
        until(lambda: all(map(under_way, fleet.computers)))
        stop.cancel()

    heard.when("flies", stop_all)
    done = deploy(fleet, heard, cancellation=stop)
    assert done.interrupted
    assert [one.noted("signals") for one in fleet.computers] == [["TERM"]] * 3
    assert "robot 0 | stops safely" in heard.lines
    assert len(done.statuses) == 3


def test_who_insists_tells_them_again(fleet: FakeFleet) -> None:
    """(P-SSH-STOP)"""
    heard = Heard()
    for one in fleet.computers:
        one.waits()
        one.acts(says="flies\n")

    def insist() -> None:
        until(lambda: all(map(under_way, fleet.computers)))
        raise KeyboardInterrupt

    heard.when("flies", insist)
    with pytest.raises(KeyboardInterrupt):
        deploy(fleet, heard)
    until(lambda: all(one.noted("signals") == ["TERM"] for one in fleet.computers))


def test_a_lost_connection_stops_nobody(fleet: FakeFleet) -> None:
    """(P-SSH-GOES-ON)"""
    heard, lost = Heard(), fleet.computers[1]
    lost.waits()
    lost.acts(says="flies\n")
    heard.when("robot 1 | flies", lambda: fleet.cut(lost))
    heard.when("robot 1 | the connection is lost", lambda: fleet.listen(lost))
    heard.when("robot 1 | connected again", lambda: lost.acts(go=""))
    done = deploy(fleet, heard)
    assert done.is_complete
    assert lost.noted("signals") == []
    assert heard.lines.count("robot 1 | flies") == 1  # and is not told again


def test_the_last_run_is_taken_up(fleet: FakeFleet) -> None:
    """(P-SSH-ATTACH)"""
    with pytest.raises(KoordError, match="no run was started there"):
        deploy(fleet, attach=True)
    deploy(fleet, run="earlier")
    heard = Heard()
    for one in fleet.computers:
        one.waits()
        one.acts(says="flies\n")

    def leave() -> None:
        until(lambda: all(one.noted("words").count("deploy") == 2 for one in fleet.computers))
        raise RuntimeError("the laptop is gone")

    heard.when("flies", leave)
    with pytest.raises(RuntimeError, match="the laptop is gone"):
        deploy(fleet, heard, run="later")
    assert not any(one.noted("signals") for one in fleet.computers)
    heard, stop = Heard(), koord.Cancellation()
    heard.when("flies", stop.cancel)
    done = deploy(fleet, heard, attach=True, cancellation=stop)
    assert any(re.fullmatch(r"the run [\w-]+-later", line) for line in heard.lines)
    assert [one.noted("signals") for one in fleet.computers] == [["TERM"]] * 3
    assert len(done.statuses) == 3


def test_a_process_that_is_gone_is_told(fleet: FakeFleet) -> None:
    """(P-SSH-END) (P-SSH-ATTACH)"""
    deploy(fleet)
    [code] = fleet.computers[1].files("deploy.code")
    code.unlink()  # as if its computer had lost its power
    done = deploy(fleet, attach=True)
    assert "its process is gone" in done.processes[1].story
    assert done.statuses[2].is_over


def test_who_is_lost_is_told_to_stop_when_it_is_reached(fleet: FakeFleet) -> None:
    """(P-SSH-STOP)"""
    heard, stop, lost = Heard(), koord.Cancellation(), fleet.computers[1]
    lost.waits()
    lost.acts(says="flies\n")

    def reached_later() -> None:
        stop.cancel()
        threading.Timer(0.3, fleet.listen, (lost,)).start()

    heard.when("robot 1 | flies", lambda: fleet.cut(lost))
    heard.when("robot 1 | the connection is lost", reached_later)
    done = deploy(fleet, heard, cancellation=stop)
    assert lost.noted("signals") == ["TERM"]
    assert done.statuses[1].ran == 2


def test_who_is_not_reached_any_more_is_named(
    fleet: FakeFleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-SSH-END) (P-SSH-GATHER)"""
    monkeypatch.setattr(computers, "REACH_S", 0.5)
    heard, lost = Heard(), fleet.computers[1]
    lost.waits()
    lost.acts(says="flies\n")
    heard.when("robot 1 | flies", lambda: fleet.cut(lost))
    done = deploy(fleet, heard, logs=fleet.folder / "logs")
    assert not done.is_complete
    assert "its computer is not reached any more" in done.processes[1].story
    [untold] = done.unmerged
    assert untold.message.startswith("deploy.log of robot 1 was not fetched")
    assert untold.hint is not None
    assert "127.0.0.2:.koord/runs/" in untold.hint
    assert (fleet.folder / "logs" / "0.log").exists()
    assert lost.noted("signals") == []
    lost.acts(go="")


def test_who_cannot_take_part_is_heard_and_the_others_stop(fleet: FakeFleet) -> None:
    """(P-SSH-END)"""
    wrong = {"severity": "error", "code": "K932", "message": "no such driver", "hint": "this one"}
    fleet.computers[1].acts(code="2", **{"deploy.json": json.dumps({"diagnostics": [wrong]})})
    for pid in (0, 2):
        fleet.computers[pid].waits()
    with pytest.raises(KoordError) as caught:
        deploy(fleet)
    [error] = caught.value.diagnostics
    assert error.message == "robot 1 cannot take part: no such driver [K932]"
    assert error.hint == "this one"
    assert [one.noted("signals") for one in fleet.computers] == [["TERM"], [], ["TERM"]]


def test_without_a_majority_the_others_stop(fleet: FakeFleet) -> None:
    """(P-SSH-END)"""
    for pid in (0, 1):
        fleet.computers[pid].acts(code="70", says="koord: internal error\n", **{"deploy.json": ""})
    fleet.computers[2].waits()
    done = deploy(fleet)
    story = "its process ended with exit code 70: koord: internal error"
    assert [done.processes[pid].story for pid in (0, 1)] == [story, story]
    assert fleet.computers[2].noted("signals") == ["TERM"]
    assert not done.is_complete


def test_with_one_they_go_on(fleet: FakeFleet) -> None:
    """(P-SSH-END)"""
    fleet.computers[0].acts(code="137", **{"deploy.json": ""})
    done = deploy(fleet)
    assert "killed (signal 9)" in done.processes[0].story
    assert done.statuses[2].is_over
    assert fleet.computers[2].noted("signals") == []


# --- before anything is armed ---------------------------------------------------------------------


def test_all_are_looked_at_and_one_question_is_asked(fleet: FakeFleet) -> None:
    """(P-SSH-ARM)"""
    asked: list[Preflight] = []

    def approve(found: Preflight) -> bool | None:
        asked.append(found)
        return True if len(asked) > 1 else None

    done = deploy(fleet, arm=True, approve=approve)
    assert done.is_complete
    assert sorted(asked[0].checks) == [0, 1, 2]
    words = fleet.computers[0].noted("words")
    looks, runs = words[: words.index("deploy", 1)], words[words.index("deploy", 1) :]
    assert "--preflight" in looks
    assert "--arm" not in looks
    assert runs[-3:] == ["--arm", "--yes", "--json"]


@pytest.mark.parametrize("finding", ["bad", "good"])
def test_without_a_yes_nothing_is_armed(fleet: FakeFleet, finding: str) -> None:
    """(P-SSH-ARM)"""
    fleet.computers[2].acts(**{"preflight.json": checks(2, finding, "the pose is old")})
    with pytest.raises(KoordError, match="not armed") as caught:
        deploy(fleet, arm=True, approve=lambda found: finding == "bad")
    told = "robot 2: pose: the pose is old" if finding == "bad" else "nobody has said yes"
    assert told in str(caught.value)
    assert not any("--arm" in one.noted("words") for one in fleet.computers)


def test_who_only_looks_arms_nothing(fleet: FakeFleet) -> None:
    """(P-SSH-ARM)"""
    done = deploy(fleet, preflight=True, arm=True)
    assert done.preflight is not None
    assert done.preflight.is_good
    assert not any("--arm" in one.noted("words") for one in fleet.computers)
