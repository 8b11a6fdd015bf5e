"""Compiled programs on the protocol: what they do, and how they come back."""

from __future__ import annotations

import errno
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from koord.cli.deployed import story
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.deploy.ideal import IdealHost, unanswered
from koord.runtime.deploy.job import CannotTakePartError, Job
from koord.runtime.deploy.journal import AnyRecord, DamagedError, Entered, Journal
from koord.runtime.deploy.local import hears_itself, local_plan
from koord.runtime.deploy.member import DivergedError, Member
from koord.runtime.deploy.resuming import come_back, enter
from koord.runtime.deploy.running import Runner
from koord.runtime.deploy.slots import BLOCK_BYTES, SLOT_BYTES, SlotFile
from koord.runtime.deploy.status import Tally, status_of
from koord.runtime.engine import Deployed, RoundEngine
from koord.runtime.motion.world import World
from koord.runtime.node import Peer
from koord.runtime.proposals import Decision, Proposal
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.messages import INCARNATION_STEP, LogEntry
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import fresh, returning
from koord.runtime.robot import Robot, Turn
from koord.runtime.transports.udp import Delivery
from koord.runtime.wire.codec import Channel
from koord.runtime.wire.frames import run_key
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


def member(name: str, pid: int, robots: int) -> Member:
    kinds = tuple(i % len(classes(name)) for i in range(robots))
    made = host(name, pid, robots)
    robot = classes(name)[kinds[pid]](pid, kinds, DELTA_S, made)
    return Member(robot, made)


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
    journals: dict[int, Journal] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.hub = Hub(self.robots)
        for pid in range(self.robots):
            self.on(pid)

    def on(self, pid: int, start: int = 1) -> None:
        """Switch a robot on: with its journal, if it has one; after the first start without."""
        made = self.members[pid] = member(self.name, pid, self.robots)
        timing = Timing.of(DELTA_S, self.robots)
        setup = Setup(self.robots, timing, rounds=self.rounds, decide=made.decided)
        journal = self._journal(pid)
        kept = None if journal is None else journal.read()
        if journal is not None and kept is not None:
            state, start = come_back(setup, made, journal, kept)
        else:
            incarnation = 0 if start == 1 else start * INCARNATION_STEP
            enter(made, journal, Entered(bytes(16), pid, "", incarnation), start)
            made.mute = start > 1
            state = fresh(setup, pid) if start == 1 else returning(setup, pid, incarnation)
        self.hub.inboxes[pid].clear()
        transport = self.hub.transport(pid)
        channel = Channel(run_key(b"a key", bytes(16)), self.robots, pid, start)
        peer = self.peers[pid] = Peer(channel, setup, state, made, transport, lambda: self.now)
        peer.start()

    def _journal(self, pid: int) -> Journal | None:
        if self.folder is None:
            return None
        if pid in self.journals:
            self.journals[pid].close()
        journal = self.journals[pid] = Journal(self.folder / f"{pid}.journal")
        return journal

    def back(self, pid: int) -> None:
        self.on(pid, start=2)

    def off(self, pid: int) -> None:
        del self.peers[pid]

    def turn(self) -> None:
        for peer in self.peers.values():
            peer.turn(0.0)
        if not any(self.hub.inboxes[pid] for pid in self.peers):
            due = [peer.node.due for peer in self.peers.values() if peer.node.due is not None]
            self.now = max(self.now, min(due, default=self.now))

    def run(self, until: int) -> None:
        for _ in range(50_000):
            self.turn()
            if all(peer.node.state.round >= until for peer in self.peers.values()):
                return
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
    """(R-RESUME): all of it from the journal, and what it missed from the others."""
    deployment = Deployment(name, 3, tmp_path)
    deployment.run(until=6)
    before, was = deployment.values(2), deployment.peers[2].node.state
    deployment.off(2)
    deployment.run(until=deployment.peers[0].node.state.round + 5)
    deployment.back(2)
    assert deployment.values(2) == before
    state = deployment.peers[2].node.state
    assert (state.round, state.chain, state.mine) == (was.round, was.chain, was.mine)
    assert (state.promised, state.roster, state.last_ran) == (
        was.promised,
        was.roster,
        was.last_ran,
    )
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
    deployment.back(0)
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
    deployment.back(2)
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


def unwritable(deployment: Deployment) -> list[int]:
    return [pid for pid, peer in deployment.peers.items() if peer.node.is_unwritable]


def test_a_robot_whose_disk_is_full_holds_until_it_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(R-SAVE): it says nothing meanwhile, and to the others it is slow."""
    deployment = Deployment("lineform", 3, tmp_path)
    deployment.run(until=5)
    broken = deployment.journals[2]
    add = Journal.add

    def full(journal: Journal, *records: AnyRecord, sync: bool = True) -> None:
        if journal is broken:
            raise OSError(errno.ENOSPC, "No space left on device")
        add(journal, *records, sync=sync)

    peer, others = deployment.peers[2], (deployment.peers[0], deployment.peers[1])
    with monkeypatch.context() as patch:
        patch.setattr(Journal, "add", full)
        while any(other.node.state.round < 12 for other in others):
            deployment.turn()
        sent = peer.counts.sent
        for _ in range(100):
            deployment.turn()
        assert unwritable(deployment) == [2]
        assert peer.counts.sent == sent
        assert deployment.members[2].unwritable == "No space left on device"
        status = status_of(peer, deployment.members[2], Tally())
        assert status.holding is Reason.UNWRITABLE
    deployment.run(until=40)
    assert unwritable(deployment) == []
    assert deployment.members[2].robot.ran is not None
    assert not deployment.members[2].host.holding


def test_all_robots_crash_and_go_on(tmp_path: Path) -> None:
    """(R-RESUME): the store, the locals and what was decided are on their disks."""
    deployment = Deployment("sum_of_ids", 4, tmp_path)
    deployment.run(until=3)
    rounds = [peer.node.state.round for peer in deployment.peers.values()]
    for pid in range(4):
        deployment.off(pid)
    for pid in range(4):
        deployment.back(pid)
    assert [peer.node.state.round for peer in deployment.peers.values()] == rounds
    deployment.run(until=60)
    assert deployment.members[0].store.values["sum"] == 4 * 3
    # Two syncs a round are a block each, or two.
    written = status_of(deployment.peers[0], deployment.members[0], Tally()).written
    assert 2 * 4096 <= written / (60 - rounds[0]) <= 4 * 4096
    assert not any(made.mute for made in deployment.members.values())


def test_a_journal_that_is_long_is_cut_down(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(R-SNAPSHOT): to a checkpoint, from which the robot is the same."""
    begun: list[int] = []
    begin = SlotFile.begin

    def counted(file: SlotFile, body: bytes) -> None:
        begun.append(len(body))
        begin(file, body)

    monkeypatch.setattr(SlotFile, "begin", counted)
    monkeypatch.setattr(SlotFile, "is_long", property(lambda file: file._size > 2_000))
    deployment = Deployment("lineform", 3, tmp_path)
    deployment.run(until=60)
    assert len(begun) > 3 + 6
    assert max(begun) < 1_000
    assert (tmp_path / "1.journal").stat().st_size == BLOCK_BYTES + 2 * SLOT_BYTES
    before, was = deployment.values(1), deployment.peers[1].node.state
    deployment.off(1)
    deployment.back(1)
    assert deployment.values(1) == before
    state = deployment.peers[1].node.state
    assert (state.round, state.chain) == (was.round, was.chain)


# --- the journal ----------------------------------------------------------------------------------


def test_another_program_s_journal_is_not_believed(tmp_path: Path) -> None:
    deployment = Deployment("lineform", 1, tmp_path)
    deployment.run(until=3)
    deployment.journals[0].close()
    kept = Journal(tmp_path / "0.journal").read()
    assert kept is not None
    with pytest.raises(DamagedError, match="does not fit the program"):
        member("sum_of_ids", 0, 1).recall(kept)


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


def test_tasks_are_where_the_world_has_them_and_nobody_s_yet() -> None:
    world = World(tasks=((1, 2, 0), (3.0, -1.0, 0.5)))
    own = IdealHost(classes("task")[0], 0, 2, DELTA_S, seed=1, world=world)
    first, second, *others = own.start(None, "list")
    assert (first[0], second[0]) == ((1.0, 2.0, 0.0), (3.0, -1.0, 0.5))
    assert others == list(own.start(None, "list")[2:])
    assert all(task[1:] == first[1:] for task in others)


def test_variables_begin_as_they_are_told_to() -> None:
    own = IdealHost(classes("task")[0], 0, 2, DELTA_S, seed=1, starts={(None, "list"): ("x",)})
    assert own.start(None, "list") == ("x",)


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


def test_robots_with_other_programs_name_each_other() -> None:
    """(R-NAME): writes of another program would be nonsense."""
    hub, now = Hub(2), [0.0]
    runners = []
    for pid, name in enumerate(("lineform", "sum_of_ids")):
        configuration = load_configuration(Source("c.yaml", "num_robots: 2\n"))
        kinds = (0, 0)
        program = (("program", name),)
        job = Job(classes(name), kinds, configuration, b"key", "run", 0.1, 0.0, 5, None)
        job = replace(job, program=program)
        runners.append(Runner(job, pid, hub.transport(pid), lambda: now[0]))
    refused = None
    while refused is None:
        now[0] += 0.1
        assert now[0] < 2.0
        runners[0].step()
        try:
            runners[1].step()
        except CannotTakePartError as error:
            refused = str(error)
    what = "robot 1 runs something else than robot 0: program: sum_of_ids here, lineform there"
    assert refused == what
    told = "robot 1 runs something else (program: lineform here, sum_of_ids there)"
    assert runners[0].status.notes == (told,)
    assert runners[0].status.holding is Reason.GATHERING


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
