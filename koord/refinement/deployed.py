"""Runs of deployed robots, checked like those of the engine. (R-COMMIT)

They run on the protocol in virtual time, or as processes that talk over UDP on this machine.

Both are the robots of ``koord deploy``: the same protocol, wire, journal and program. Only what
carries their messages differs, and where the time comes from.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.refinement.hearing import Heard
from koord.refinement.instrumented_robot import (
    GAVE_UP,
    GaveUpError,
    InstrumentedRobot,
    Witness,
)
from koord.refinement.part_reading import read_part
from koord.refinement.parts import PartWriter, Whose
from koord.refinement.reports import Told
from koord.refinement.running import Compiled, CompiledRun
from koord.refinement.sampling_hosts import SeededHost, settled_starts
from koord.refinement.trace_merge import gathered
from koord.runtime.chaos.network import CALM, Faults, Network, Newborn, SwitchedOn
from koord.runtime.chaos.unreliable import Unreliable
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.deploy.ideal import IdealHost, unanswered
from koord.runtime.deploy.job import Job
from koord.runtime.deploy.journal import Entered, Journal
from koord.runtime.deploy.local import Launch, LocalProcesses, launched, local_plan
from koord.runtime.deploy.member import Platform
from koord.runtime.deploy.resuming import come_back, enter
from koord.runtime.ports import is_place, point_of
from koord.runtime.protocol.handshake import RUN_BYTES
from koord.runtime.protocol.messages import INCARNATION_STEP, Message
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import fresh, returning
from koord.runtime.transports.transport import Transport
from koord.runtime.transports.udp import Plan, Udp
from koord.runtime.wire.bodies import kind_and_body, message_of
from koord.syntax import core
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.traces.codec import Subject
from koord.traces.trace import Sources

#: The identity of runs in virtual time.
_RUN = bytes(RUN_BYTES)

#: A run that is not over after so long is stuck: virtual seconds, and real ones.
_VIRTUAL_S, _REAL_S = 300.0, 60.0

#: Others who are not there have so long when the first has come to the end.
_GRACE_S = 3.0

#: It blows for so many rounds, then the network is calm until the run is over.
_STORM_ROUNDS = 40


#: What variables start with, by robot and attribute.
Starts = Mapping[tuple[int | None, str], Any]


class StuckError(Exception):
    """Raised where robots make no progress, though nothing hinders them any more."""


class BrokenError(Exception):
    """Raised where a robot's process crashed."""


class Expedition(Struct, frozen=True):
    """A run of deployed robots, as data."""

    made: Compiled
    system: System
    sources: Sources
    rounds: int | None
    seed: int
    faults: Faults = CALM
    largest: int | None = None  #: the size of values at which the run ends

    @property
    def is_seeded(self) -> bool:
        """True if hosts answer at random: the program is generated, or needs a platform."""
        functions = [unanswered(program.EXTERNALS) for program in self.made.classes]
        return not self.sources.program.text or any(functions)

    def host(self, pid: int) -> SeededHost:
        return SeededHost(self.system, self.made.names, str(self.seed), pid)

    def job(self, journals: Path, pace_s: float) -> Job:
        """The run in the form of ``koord deploy``."""
        robots = self.system.robots
        configuration = load_configuration(
            Source("generated.yaml", f"num_robots: {robots}\nseed: {self.seed}\n")
        )
        delta_s = float(self.system.delta_s)
        kinds, run = self.system.kinds, f"check {self.seed}"
        key = self.seed.to_bytes(16, "big", signed=True)
        classes = self.made.classes
        return Job(classes, kinds, configuration, key, run, delta_s, pace_s, self.rounds, journals)

    def starts(self) -> Starts:
        """Find starts that meet the assumptions. Raises KoordError if there are none."""
        return settled_starts(self.system, self.made.names, self.seed)

    def member(
        self, job: Job, pid: int, starts: Starts, tell: Callable[[Told], None]
    ) -> InstrumentedRobot:
        """Make a robot that reports its actions. A deployed program has its real host."""
        made = self.made
        program = job.classes[job.kinds[pid]]
        body: Platform
        if self.is_seeded:
            body = self.host(pid)
        else:
            place = next(
                (point_of(v) for (i, name), v in starts.items() if i == pid and is_place(name)),
                None,
            )
            body = IdealHost(program, pid, job.robots, job.delta_s, self.seed, place)
        host = Witness(body, made, self.system, starts, tell)
        robot = program(pid, job.kinds, job.delta_s, host)
        return InstrumentedRobot(robot, host, self.largest)

    def part(self, folder: Path, pid: int) -> PartWriter:
        """The part of a robot in a process of its own."""
        subject = Subject(self.sources, self.system, Fraction(0))
        return PartWriter(_part_in(folder, pid), lambda: Whose("a check", pid, subject))

    def told(self, folder: Path) -> list[tuple[Told, ...]]:
        """What robots in processes have told, by pid."""

        def load(_: Sources) -> core.Program:
            return self.system.program

        files = [_part_in(folder, pid) for pid in range(self.system.robots)]
        return [
            read_part(file.read_bytes(), file.name, load).told if file.exists() else ()
            for file in files
        ]

    def ran(self, told: Sequence[Sequence[Told]]) -> CompiledRun:
        library = self.host(0).answer if self.is_seeded else None
        heard = Heard.of(enumerate(told))
        return gathered(self.sources, self.system, heard, self.rounds, library).run


def _part_in(folder: Path, pid: int) -> Path:
    return folder / f"{pid}.jsonl"


# --- in virtual time ----------------------------------------------------------------------------


class _Crew:
    """The robots of a run, with their reports, also from before a crash."""

    def __init__(self, expedition: Expedition, job: Job, starts: Starts) -> None:
        self.expedition = expedition
        self.job = job
        self.starts = starts
        self.members: dict[int, InstrumentedRobot] = {}
        self.told: list[list[Told]] = [[] for _ in range(self.job.robots)]
        self._journals: dict[int, Journal] = {}

    def switch_on(self, pid: int, start: int, how: SwitchedOn) -> Newborn:
        job = self.job
        member = self.expedition.member(job, pid, self.starts, self.told[pid].append)
        self.members[pid] = member
        timing = Timing.of(job.delta_s, job.robots)
        setup = Setup(job.robots, timing, owing=job.owing, rounds=job.rounds, decide=member.decided)
        journal = self._journal(pid, has_disk=how is not SwitchedOn.LOST)
        kept = journal.read()
        if kept is not None:
            state, _ = come_back(setup, member, journal, kept)
            return Newborn(member, setup, state)
        incarnation = 0 if how is SwitchedOn.FIRST else start * INCARNATION_STEP
        enter(member, journal, Entered(_RUN, pid, "", incarnation), start)
        if how is SwitchedOn.FIRST:
            return Newborn(member, setup, fresh(setup, pid))
        member.mute = True
        return Newborn(member, setup, returning(setup, pid, incarnation))

    def _journal(self, pid: int, *, has_disk: bool) -> Journal:
        """The journal of a robot whose process before, if there was one, is dead."""
        before = self._journals.get(pid)
        if before is not None:
            before.close()
            if not has_disk:
                before.forget()
        journal = self.job.journal(pid)
        assert journal is not None
        self._journals[pid] = journal
        return journal


def over_network(expedition: Expedition) -> CompiledRun:
    """Run over a simulated network: a storm, and then a calm until the run is over.

    Raises StuckError, DisagreementError.
    """
    try:
        return expedition.ran(told_over_network(expedition))
    except KoordError as error:  # no start that the program allows
        return replace(expedition.ran([]), gave_up=error)


def told_over_network(expedition: Expedition) -> list[list[Told]]:
    """As :func:`over_network`: what robots tell, by pid. Raises StuckError, KoordError."""
    with TemporaryDirectory() as folder:
        job = expedition.job(Path(folder), 0.0)
        crew = _Crew(expedition, job, expedition.starts())
        setup = Setup(job.robots, Timing.of(job.delta_s, job.robots))
        faults = expedition.faults
        if job.owing:  # who has lost its locals is mute, and the others would wait for it
            faults = replace(faults, losses=0.0)
        carry = _over_the_wire(job.robots)
        network = Network(setup, faults, expedition.seed, crew.switch_on, carry)
        storm_s = _STORM_ROUNDS * job.delta_s
        with suppress(GaveUpError):
            _play(network, storm_s)
        for pid, node in enumerate(network.nodes):
            if node is not None:
                crew.members[pid].finish()
        return crew.told


def _play(network: Network, storm_s: float) -> None:
    while not _is_over(network):
        network.step()
        if network.now > storm_s:
            network.faults = CALM
        if network.now > _VIRTUAL_S:
            rounds = {state.pid: state.round for state in network.running()}
            raise StuckError(f"after {network.now:.0f} s robots are at rounds {rounds}")


def _is_over(network: Network) -> bool:
    return all(node is not None and node.state.ended for node in network.nodes)


def _over_the_wire(robots: int) -> Callable[[Message], Message]:
    """A function that encodes and decodes a message, as the wire does."""

    def carry(message: Message) -> Message:
        read = message_of(*kind_and_body(message), robots)
        assert isinstance(read, Message), message
        return read

    return carry


# --- in processes -------------------------------------------------------------------------------


def over_udp(expedition: Expedition) -> CompiledRun:
    """Run processes over UDP, with injected network faults.

    Raises StuckError, BrokenError, DisagreementError, TransportError.
    """
    faults, system = expedition.faults, expedition.system
    with TemporaryDirectory() as name:
        folder = Path(name)
        pace_s = 0.0 if faults == CALM else float(system.delta_s)
        job = expedition.job(folder, pace_s)

        try:
            starts = expedition.starts()
        except KoordError as error:
            return replace(expedition.ran([]), gave_up=error)

        def make(job: Job, pid: int) -> InstrumentedRobot:
            return expedition.member(job, pid, starts, expedition.part(folder, pid).tell)

        def carry(plan: Plan, pid: int) -> Transport:
            udp = Udp(plan, pid)
            return udp if faults == CALM else Unreliable(udp, faults, expedition.seed + pid)

        plan = local_plan(job.configuration, job.robots)
        fleet = launched(Launch(job, plan, make, carry))
        try:
            _watch(fleet, faults, Random(expedition.seed))
        finally:
            fleet.kill()
            fleet.join()
        return expedition.ran(expedition.told(folder))


def _watch(fleet: LocalProcesses, faults: Faults, draw: Random) -> None:
    """Watch processes until the run is over; robots are killed and restarted now and then."""
    begun = looked_at = time.monotonic()
    over_at: float | None = None
    while not fleet.is_over:
        for _ in fleet.news(0.05):
            pass
        fleet.check()
        for status in fleet.statuses.values():
            if status.trouble is not None and GAVE_UP not in status.trouble:
                raise BrokenError(status.trouble)
            if status.trouble is not None:
                return
        now = time.monotonic()
        stormy = now - begun < _REAL_S / 4
        for pid, process in enumerate(fleet.processes):
            falls = draw.random() < faults.crashes_per_s * (now - looked_at)
            if stormy and falls and process.is_alive() and spare(fleet) > 0:
                fleet.replace(pid)
        looked_at = now
        if over_at is None and any(status.is_over for status in fleet.statuses.values()):
            over_at = now
        if over_at is not None and now - over_at > _GRACE_S:
            return  # who has come to the end leaves; who was down then has nobody to ask
        if now - begun > _REAL_S:
            rounds = {pid: status.round for pid, status in fleet.statuses.items()}
            raise StuckError(f"after {_REAL_S:.0f} s robots are at rounds {rounds}")


def spare(fleet: LocalProcesses) -> int:
    """The number of robots that may crash so that a majority remains that knows everything."""
    robots = len(fleet.processes)
    voters = sum(status.is_voter and status.round >= 0 for status in fleet.statuses.values())
    return voters - (robots // 2 + 1)
