"""Compiled programs on the protocol: what they do, and how they come back."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from koord.cli.deployed import story
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.deploy.ideal import IdealHost, unanswered
from koord.runtime.deploy.journal import Journal, Page
from koord.runtime.deploy.local import hears_itself, local_plan
from koord.runtime.deploy.member import DivergedError, Member
from koord.runtime.deploy.running import Job, Runner
from koord.runtime.deploy.status import Tally, status_of
from koord.runtime.engine import Deployed, RoundEngine
from koord.runtime.node import Peer
from koord.runtime.proposals import Attempt, Decision, Proposal, Write
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.messages import LogEntry
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import State, fresh, returning
from koord.runtime.robot import Robot, Turn
from koord.runtime.transports.udp import Delivery
from koord.runtime.wire.codec import RunKey
from koord.runtime.wire.frames import Drop
from koord.syntax.source import Source
from tests.loading import example_program
from tests.runtime.hub import Hub

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"
DELTA_S = 0.1


@cache
def classes(name: str) -> tuple[type[Robot], ...]:
    program = example_program(name)
    return loaded(compiled(program))


def host(name: str, pid: int, robots: int) -> IdealHost:
    program = classes(name)[pid % len(classes(name))]
    return IdealHost(program, pid, robots, DELTA_S, seed=1)


def member(name: str, pid: int, robots: int, folder: Path | None = None) -> Member:
    kinds = tuple(i % len(classes(name)) for i in range(robots))
    made = host(name, pid, robots)
    robot = classes(name)[kinds[pid]](pid, kinds, DELTA_S, made)
    journal = None if folder is None else Journal(folder / f"{pid}.journal")
    return Member(robot, made, journal, name)


@dataclass
class Deployment:
    """Robots in one process, in virtual time. ``peers`` lacks those that are switched off."""

    name: str
    robots: int
    folder: Path | None = None
    rounds: int | None = None
    now: float = 0.0
    peers: dict[int, Peer] = field(default_factory=dict)
    members: dict[int, Member] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.hub = Hub(self.robots)
        for pid in range(self.robots):
            self.on(pid, partial(fresh, pid=pid, spare=1_000 + pid))

    def on(self, pid: int, state: Callable[[Setup], State], *, back: bool = False) -> None:
        made = self.members[pid] = member(self.name, pid, self.robots, self.folder)
        if back:
            made.come_back()
        timing = Timing.of(DELTA_S, self.robots)
        setup = Setup(self.robots, timing, rounds=self.rounds, decide=made.decided)
        self.hub.inboxes[pid].clear()
        transport = self.hub.transport(pid)
        run = RunKey("a run", b"a key", self.robots)
        peer = self.peers[pid] = Peer(run, setup, state(setup), made, transport, lambda: self.now)
        peer.start()

    def back(self, pid: int, incarnation: int) -> None:
        self.on(pid, lambda setup: returning(setup, pid, incarnation), back=True)

    def off(self, pid: int) -> None:
        del self.peers[pid]

    def run(self, until: int) -> None:
        for _ in range(50_000):
            for peer in self.peers.values():
                peer.turn(0.0)
            if all(peer.node.state.round >= until for peer in self.peers.values()):
                return
            if not any(self.hub.inboxes[pid] for pid in self.peers):
                due = [peer.node.due for peer in self.peers.values() if peer.node.due is not None]
                self.now = max(self.now, min(due))
        raise AssertionError(f"{ {i: p.node.state.round for i, p in self.peers.items()} }")

    def values(self, pid: int) -> dict[str, Any]:
        return dict(vars(self.members[pid].robot))


def engine(name: str, robots: int, rounds: int) -> RoundEngine:
    """The same in one loop, without messages."""

    class Hosts:
        """Each robot's host, by pid."""

        def __init__(self) -> None:
            self.own = [host(name, pid, robots) for pid in range(robots)]

        def start(self, robot: int | None, variable: str) -> Any:
            return self.own[robot or 0].start(robot, variable)

        def read(self, robot: Robot) -> Any:
            return self.own[robot.pid].read(robot)

        def ask(self, turn: Any, robot: int, key: Any, function: str, given: Any) -> Any:
            return self.own[robot].ask(turn, robot, key, function, given)

        def choose(self, turn: Any, robot: int, key: Any, low: Any, high: Any) -> Any:
            return self.own[robot].choose(turn, robot, key, low, high)

    kinds = [i % len(classes(name)) for i in range(robots)]
    fleet = RoundEngine(classes(name), kinds, DELTA_S, Hosts())
    fleet.begin()
    for round_ in range(rounds):
        if round_:
            fleet.environment_turn()
        fleet.program_turns(Deployed())
    return fleet


PROGRAMS = ["sum_of_ids", "leader_elect", "lineform", "task", "waypoints", "cars_and_drones"]


@pytest.mark.parametrize("name", PROGRAMS)
def test_deployed_robots_do_what_the_engine_does(name: str) -> None:
    """The protocol adds nothing: nobody is late, so every round is that of the engine."""
    deployment = Deployment(name, 4)
    deployment.run(until=15)
    rounds = deployment.peers[0].node.state.round
    reference = engine(name, 4, rounds)
    for pid, robot in enumerate(reference.robots):
        assert deployment.values(pid) == vars(robot)
        assert deployment.members[pid].store.digest() == reference.store.digest()


@pytest.mark.parametrize("name", ["lineform", "task", "sum_of_ids"])
def test_a_robot_comes_back_as_the_one_that_it_was(name: str, tmp_path: Path) -> None:
    """(R-REJOIN) (R-SNAPSHOT): its locals and ports from the journal, the store from the others."""
    deployment = Deployment(name, 3, tmp_path)
    deployment.run(until=6)
    before = deployment.values(2)
    deployment.off(2)
    deployment.run(until=deployment.peers[0].node.state.round + 5)
    deployment.back(2, incarnation=7)
    own = {*deployment.members[2].robot.LOCALS, *deployment.members[2].robot.PORTS}
    after = deployment.values(2)
    assert {n: after[n] for n in own} == {n: before[n] for n in own}
    deployment.run(until=deployment.peers[0].node.state.round + 4)
    assert deployment.peers[2].node.state.is_voter
    assert not deployment.members[2].mute
    rounds = {pid: peer.node.state.round for pid, peer in deployment.peers.items()}
    deployment.run(until=max(rounds.values()) + 1)
    digests = {
        (deployment.peers[pid].node.state.round, m.store.digest())
        for pid, m in deployment.members.items()
    }
    assert len(digests) == len({round_ for round_, _ in digests})


def test_the_coordinator_s_death_is_survived_with_its_journal(tmp_path: Path) -> None:
    deployment = Deployment("lineform", 3, tmp_path)
    deployment.run(until=5)
    deployment.off(0)
    deployment.run(until=10)
    assert {peer.node.state.leader for peer in deployment.peers.values()} == {1}
    deployment.back(0, incarnation=9)
    deployment.run(until=20)
    positions = [deployment.values(pid)["x"] for pid in range(3)]
    assert positions[0] == positions[1] == positions[2]
    assert deployment.members[0].robot.ran is not None


def test_a_robot_that_lost_its_journal_runs_nothing_and_still_counts(tmp_path: Path) -> None:
    deployment = Deployment("lineform", 3, tmp_path)
    deployment.run(until=5)
    deployment.off(2)
    deployment.run(until=8)
    (tmp_path / "2.journal").unlink()
    deployment.back(2, incarnation=7)
    assert deployment.members[2].mute
    deployment.run(until=14)
    assert deployment.peers[2].node.state.is_voter
    assert deployment.members[0].store.values["x"][2] == deployment.members[2].store.values["x"][2]


def test_a_run_ends_and_nobody_can_come_back_to_it(tmp_path: Path) -> None:
    deployment = Deployment("sum_of_ids", 3, tmp_path, rounds=5)
    deployment.run(until=5)
    assert all(peer.node.over for peer in deployment.peers.values())
    for made in deployment.members.values():
        made.forget()
    assert list(tmp_path.iterdir()) == []


# --- the journal ----------------------------------------------------------------------------------


def test_a_page_is_read_as_it_was_written(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "0.journal")
    assert journal.read() is None
    proposal = Proposal(0, 3, (Attempt(1, (Write(0, (1,), (2**70, "x", None)),), (0,)),), True)
    attributes = (1, 2.5, (True, None), "text", -(2**80))
    page = Page("p", 3, 0, 1, attributes, (1.0, 2.0, 3.0), proposal, ((1, attributes),))
    journal.write(page)
    assert journal.read() == page
    journal.forget()
    assert journal.read() is None


@pytest.mark.parametrize("damage", [b"", b"\x93", b"\xc0", bytes(100)])
def test_a_damaged_journal_is_none(tmp_path: Path, damage: bytes) -> None:
    journal = Journal(tmp_path / "0.journal")
    journal.path.write_bytes(damage)
    assert journal.read() is None


def test_another_program_s_journal_is_not_believed(tmp_path: Path) -> None:
    deployment = Deployment("lineform", 1, tmp_path)
    deployment.run(until=3)
    other = member("sum_of_ids", 0, 1, tmp_path)
    assert not other.come_back()
    assert other.mute


def test_a_robot_holds_until_it_is_told_to_go_on() -> None:
    """(R-HOLD)"""
    one = member("waypoints", 0, 1)
    one.hold(Reason.UNDECIDED)
    assert one.host.holding
    one.hold(None)
    assert not one.host.holding


# --- the store and the host -----------------------------------------------------------------------


def test_a_store_that_differs_is_noticed() -> None:
    one = member("sum_of_ids", 0, 1)
    one.propose(-1)
    decision = Decision(-1, (), (0,), (), digest=b"another")
    with pytest.raises(DivergedError):
        one.commit(LogEntry(decision), None)


def test_ideal_robots_go_where_they_are_told_at_their_speed() -> None:
    one = member("waypoints", 0, 1)
    own = IdealHost(type(one.robot), 0, 1, DELTA_S, seed=1, position=(0.0, 0.0, 0.0), speed_mps=2.0)
    own._move(((1.0, 0.0, 0.0), (1.0, 1.0, 0.0)))
    assert own.position == pytest.approx((0.2, 0.0, 0.0))
    for _ in range(5):
        own._move(((1.0, 0.0, 0.0), (1.0, 1.0, 0.0)))
    assert own.position == pytest.approx((1.0, 0.2, 0.0))
    own.holding = True
    own._move(((1.0, 0.0, 0.0), (1.0, 1.0, 0.0)))
    assert own.position == pytest.approx((1.0, 0.2, 0.0))


def test_paths_that_come_near_each_other_are_not_clear() -> None:
    own = host("task", 0, 2)

    def ask(*paths: Any) -> Any:
        return own.ask(Turn.PROG, 0, (), "pathsClear", paths)

    near = ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0)), ((2.0, -2.0, 0.0), (2.0, 2.0, 0.0))
    far = ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0)), ((0.0, 3.0, 0.0), (4.0, 3.0, 0.0))
    assert not ask(*near)
    assert ask(*far)
    assert ask(*far) == ask(*reversed(far))


def test_functions_that_only_a_platform_has_are_told() -> None:
    assert unanswered(classes("task")[0].EXTERNALS) == ()
    assert "pickFrontierPos" in unanswered(classes("mapping")[0].EXTERNALS)


# --- what is told of robots -----------------------------------------------------------------------


def test_a_round_that_waits_says_for_whom() -> None:
    """(R-OWED)"""
    deployment = Deployment("lineform", 3)
    deployment.off(2)
    peer = deployment.peers[0]
    for _ in range(300):
        for one in deployment.peers.values():
            one.turn(0.0)
        deployment.now += 0.01
    status = status_of(peer, deployment.members[0], Tally())
    assert status.round == -1
    assert status.holding is Reason.ROUND_OPEN
    assert status.waiting_for == (2,)
    assert story(status) == "holds: the round waits for robots that may not skip: 2"


def test_what_happens_on_this_machine_is_heard_on_it_or_goes_round() -> None:
    port = 20_000 + time.time_ns() % 20_000
    configuration = load_configuration(Source("c.yaml", "num_robots: 3\n"))
    plan = local_plan(configuration, 3)
    assert (plan.reach is Delivery.GROUP) == hears_itself(port + 10)
    alone = load_configuration(Source("c.yaml", "num_robots: 3\nnetwork: {transport: unicast}\n"))
    assert local_plan(alone, 3).reach is Delivery.EACH


def test_robots_with_other_programs_do_not_hear_each_other() -> None:
    """Writes of another program would be nonsense; so its datagrams are as good as forged."""
    hub = Hub(2)
    runners = []
    for pid, name in enumerate(("lineform", "sum_of_ids")):
        configuration = load_configuration(Source("c.yaml", "num_robots: 2\n"))
        kinds = (0, 0)
        job = Job(classes(name), kinds, configuration, b"key", "run", 0.1, 0.0, 5, None)
        runners.append(Runner(job, pid, hub.transport(pid), lambda: 0.0))
    for runner in runners:
        runner.peer.start()
    for _ in range(20):
        for runner in runners:
            runner.peer.turn(0.0)
    assert runners[0].peer.drops[Drop.FORGED] > 0
    assert [runner.peer.node.state.round for runner in runners] == [-1, -1]


def test_a_robot_whose_store_differs_stops_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    configuration = load_configuration(Source("c.yaml", "num_robots: 1\n"))
    job = Job(classes("sum_of_ids"), (0,), configuration, b"key", "run", 0.1, 0.0, 5, None)
    honest = Member.decided

    def mistaken(self: Member, round_: int, proposals: Sequence[Proposal | None]) -> Decision:
        made = honest(self, round_, proposals)
        return replace(made, digest=b"another") if round_ == 0 else made

    monkeypatch.setattr(Member, "decided", mistaken)
    runner = Runner(job, 0, Hub(1).transport(0))
    ended = runner.run(lambda: False, lambda status: None)
    assert ended.trouble == "the store differs after round 0"
    assert runner.member.host.holding
